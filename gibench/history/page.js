const short = revision => revision.replace(/^([0-9a-f]{12})[0-9a-f]+/, "$1");

function plot(series) {
  const width = 1100, height = 150, left = 62, right = 12, top = 8, bottom = 20;
  const values = series.values, n = values.length;
  const low = Math.min(...values), high = Math.max(...values), room = (high - low || high || 1) * 0.1;
  const x = i => left + (n > 1 ? i / (n - 1) : 0.5) * (width - left - right);
  const y = v => top + (high + room - v) / (high - low + 2 * room) * (height - top - bottom);
  const svg = element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": series.name });
  for (const v of [low, high]) svg.append(element("text", { x: left - 8, y: y(v) + 4, "text-anchor": "end", class: "soft" },
    figure(v)), element("line", { x1: left, x2: width - right, y1: y(v), y2: y(v) }));
  const days = series.runs.map(r => DATA.runs[r].when.slice(0, 10));
  svg.append(element("text", { x: left, y: height - 4, class: "soft" }, days[0]),
    element("text", { x: width - right, y: height - 4, "text-anchor": "end", class: "soft" }, days[n - 1]));
  series.runs.forEach((r, i) => {
    if (i && DATA.runs[r].changed.length) svg.append(tip(element("line", { x1: x(i - 0.5), x2: x(i - 0.5), y1: top,
      y2: height - bottom, class: "environment" }), `Environment: ${DATA.runs[r].changed.join("; ")}`));
  });
  svg.append(element("path", { class: "trend", d: values.map((v, i) => `${i ? "L" : "M"}${x(i).toFixed(1)} ${y(v).toFixed(1)}`).join("") }));
  const borders = [0, ...series.steps.map(s => s.at), n];
  for (let k = 0; k + 1 < borders.length && series.steps.length; k++) {
    const part = values.slice(borders[k], borders[k + 1]).sort((a, b) => a - b), level = part[part.length >> 1];
    svg.append(element("line", { class: "level", x1: x(borders[k]), x2: x(borders[k + 1] - 1), y1: y(level), y2: y(level) }));
  }
  for (const step of series.steps) svg.append(tip(element("line", { class: "step", x1: x(step.at - 0.5), x2: x(step.at - 0.5),
    y1: top, y2: height - bottom, tabindex: 0 }), `x ${figure(step.ratio)} after ${short(DATA.runs[series.runs[step.at - 1]].revision)} ` +
    `and by ${short(DATA.runs[series.runs[step.at]].revision)}`));
  const few = Math.max(1, Math.ceil(n / 250)); // more points than that lie on one another; steps' neighbours stay
  const near = new Set(series.steps.flatMap(s => [s.at - 1, s.at]));
  values.forEach((v, i) => {
    if (i % few && i !== n - 1 && !near.has(i)) return;
    const run = DATA.runs[series.runs[i]];
    const dot = tip(element("circle", { class: "point", cx: x(i), cy: y(v), r: 2.6 }),
      `${figure(v)} ${series.unit}; ${run.when} UTC; ${short(run.revision)}`);
    svg.append(run.link ? svgLink(encodeURI(run.link), dot) : dot);
  });
  return element("div", { class: "series" }, element("h3", {}, series.name),
    element("p", {}, `${series.machine}; ${n} ${n === 1 ? "run" : "runs"}, ${series.unit}`), svg);
}

function choose(id, name, first) {
  const values = [...new Set(DATA.series.map(s => s[name]))].filter(v => v !== "").sort();
  const select = $(id);
  select.append(element("option", { value: "" }, "all"));
  for (const value of values) select.append(element("option", { value }, value));
  select.value = values.includes(first) ? first : "";
  select.addEventListener("change", draw);
}

function draw() {
  const wanted = { technique: $("#technique").value, pass: $("#pass").value, machine: $("#machine").value };
  const shown = DATA.series.filter(s => Object.entries(wanted).every(([key, value]) => !value || s[key] === value));
  $("#trends .plots").replaceChildren(...(shown.length ? shown.map(plot) : ["No series of that kind."]));
}

const found = DATA.series.flatMap(s => s.steps.map(step => ({ s, step, age: s.runs.length - step.at })));
found.sort((a, b) => a.age - b.age);
if (found.length) table($("#steps .table"), ["what", "ratio", "from", "to", "after", "by", "runs since", "machine"],
  found.map(({ s, step, age }) => [s.name, step.ratio, step.low, step.high,
    short(DATA.runs[s.runs[step.at - 1]].revision), short(DATA.runs[s.runs[step.at]].revision), age, s.machine]));
else $("#steps .table").append("No step is established.");
const changed = DATA.runs.filter(r => r.changed.length);
if (changed.length) table($("#environment .table"), ["when", "revision", "what changed"],
  changed.map(r => [r.when, short(r.revision), r.changed.join("; ")]));
else $("#environment .table").append("Nothing changed between runs.");
choose("#technique", "technique", "");
choose("#pass", "pass", "(frame)");
choose("#machine", "machine", "");
draw();
