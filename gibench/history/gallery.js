function plot(rows, key, label) {
  const width = 560, height = 330, left = 62, right = 14, top = 10, bottom = 42;
  const range = values => {
    const low = Math.log10(Math.min(...values)), high = Math.log10(Math.max(...values)), room = Math.max((high - low) * 0.1, 0.15);
    return [low - room, high + room];
  };
  const [x0, x1] = range(rows.map(r => r[key])), [y0, y1] = range(rows.map(r => r.gi_ms));
  const x = v => left + (Math.log10(v) - x0) / (x1 - x0) * (width - left - right);
  const y = v => height - bottom - (Math.log10(v) - y0) / (y1 - y0) * (height - top - bottom);
  const svg = element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `GI time over ${label}` });
  const some = (low, high, steps) => steps.flatMap(m => Array.from({ length: 12 }, (_, e) => m * 10 ** (e - 4)))
    .filter(v => Math.log10(v) >= low && Math.log10(v) <= high);
  const ticks = (low, high) => {
    const few = some(low, high, [1, 2, 5]);
    return few.length > 1 ? few : some(low, high, [1, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 9]);
  };
  for (const v of ticks(x0, x1)) svg.append(element("line", { x1: x(v), x2: x(v), y1: top, y2: height - bottom }),
    element("text", { x: x(v), y: height - bottom + 16, "text-anchor": "middle", class: "soft" }, figure(v)));
  for (const v of ticks(y0, y1)) svg.append(element("line", { x1: left, x2: width - right, y1: y(v), y2: y(v) }),
    element("text", { x: left - 6, y: y(v) + 4, "text-anchor": "end", class: "soft" }, figure(v)));
  svg.append(element("text", { x: (left + width - right) / 2, y: height - 6, "text-anchor": "middle" }, label),
    element("text", { x: 4, y: top + 8, class: "soft" }, "GI ms"));
  for (const r of rows) svg.append(tip(element("circle", { cx: x(r[key]), cy: y(r.gi_ms), r: 6, tabindex: 0,
    fill: r.variant === "published" ? "var(--ground)" : DATA.colors[r.technique], stroke: DATA.colors[r.technique],
    "stroke-width": 2 }), `${r.technique} (${r.variant}) on ${r.machine}: ${figure(r.gi_ms)} ms at ${figure(r[key])} ${label}`));
  return element("div", {}, element("h3", {}, `Over ${label}`), svg);
}

const group = r => `${r.scene}, ${r.image}, profile ${r.profile}`;
const timed = DATA.rows.filter(r => r.gi_ms > 0);
table($("#winners .table"), ["run", "machine", "scene", "profile", "image", "technique", "GI ms", "times ahead of the next"],
  DATA.winners.map(r => [r.run, r.machine, r.scene, r.profile, r.image, r.technique, r.gi_ms, r.lead]));
table($("#all .table"), ["run", "machine", "scene", "profile", "image", "technique", "variant", "GI ms", "frame ms", "memory MiB",
  "GB/s", "GFLOP/s", "conform"], DATA.rows.map(r => [r.run, r.machine, r.scene, r.profile, r.image, r.technique, r.variant,
  r.gi_ms, r.frame_ms, r.memory_mib, r.gb_per_s, r.gflop_per_s, r.conform]));
for (const name of Object.keys(DATA.colors).filter(n => timed.some(r => r.technique === n))) {
  const key = element("span", {}, name);
  key.style.setProperty("--c", DATA.colors[name]);
  $("#scaling .legend").append(key);
}
$("#scaling .legend").append(element("span", { class: "key" }, "hollow: published"));
const groups = [...new Set(timed.map(group))];
for (const name of groups) $("#which").append(element("option", { value: name }, name));
const draw = () => {
  const rows = timed.filter(r => group(r) === $("#which").value);
  $("#scaling .plots").replaceChildren(...(rows.length ? [plot(rows, "gb_per_s", "GB/s"), plot(rows, "gflop_per_s", "GFLOP/s")]
    : ["No run measured any GI."]));
};
$("#which").addEventListener("change", draw);
draw();
