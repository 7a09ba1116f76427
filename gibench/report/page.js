"use strict";
const $ = (selector, from = document) => from.querySelector(selector);

function element(name, attributes = {}, ...children) {
  const svg = ["svg", "g", "rect", "line", "text", "circle", "path", "title", "defs", "pattern"].includes(name);
  const made = svg ? document.createElementNS("http://www.w3.org/2000/svg", name)
                   : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

const passNames = [...new Set(DATA.configurations.flatMap(c => c.passes.map(p => p.name)))];
// A pass's own, whatever the technique (gibench.report.plots).
const color = name => DATA.pass_colors[name];
// A technique's own, the same in every plot (gibench.report.plots).
const techniqueColor = name => DATA.colors[name];
// Around (0, 0), about 12 wide.
const SHAPES = ["M-5 0a5 5 0 1 0 10 0a5 5 0 1 0-10 0Z", "M-5-5H5V5H-5Z", "M0-7L7 0L0 7L-7 0Z", "M0-7L7 5H-7Z",
  "M0 7L7-5H-7Z", "M-2-6H2V-2H6V2H2V6H-2V2H-6V-2H-2Z", "M-6-3L-3-6L0-3L3-6L6-3L3 0L6 3L3 6L0 3L-3 6L-6 3L-3 0Z",
  "M-7 0L5-7V7Z", "M7 0L-5-7V7Z", "M-6 0L-3-5.5H3L6 0L3 5.5H-3Z", "M-6-6H6L-6 6H6Z",
  "M0-7L1.6-2.2H6.7L2.6.8L4.1 5.7L0 2.7L-4.1 5.7L-2.6.8L-6.7-2.2H-1.6Z"];
const digits = value => Math.abs(value) >= 1000 ? 0 : Math.abs(value) >= 100 ? 1 : 3;
const figure = value => Number.isInteger(value) ? value.toLocaleString("en")
  : value.toLocaleString("en", { minimumFractionDigits: digits(value), maximumFractionDigits: digits(value) });
const many = DATA.runs.length > 1;
const title = c => many ? `${c.run}: ${c.label}` : c.label;

function tip(node, text) {
  const shown = $("#tip");
  const show = () => { shown.textContent = text; shown.hidden = false; };
  const hide = () => { shown.hidden = true; };
  node.setAttribute("tabindex", "0");
  node.setAttribute("role", "img");
  node.setAttribute("aria-label", text);
  for (const event of ["mouseenter", "focus"]) node.addEventListener(event, show);
  for (const event of ["mouseleave", "blur"]) node.addEventListener(event, hide);
  return node;
}

function legend(place, names, colorOf = color) {
  for (const name of names) {
    const entry = element("span", {}, name);
    entry.style.setProperty("--c", colorOf(name));
    place.append(entry);
  }
}

function runs() {
  for (const run of DATA.runs) {
    const made = element("div", { class: "run" }, element("b", {}, run.name),
      `measured on ${run.measured_on}; modelled: ${run.modelled}; ${run.when} UTC`);
    for (const text of run.warnings)
      made.append(element("p", { class: "warn" }, text.replaceAll("**", "")));
    $("#runs").append(made);
  }
  for (const section of document.querySelectorAll("main section"))
    $("nav").append(element("a", { href: `#${section.id}` }, $("h2", section).textContent));
}

// Which configurations have samples to be shown, and how to show them.
const sampled = DATA.configurations.filter(c => c.passes.length);
let showSamples = () => {};

function toSamples(run, label, text) {
  const at = sampled.findIndex(c => c.run === run && c.label === label);
  if (at < 0) return text;
  const link = element("a", { href: "#distributions", title: "its samples", tabindex: -1 }, text);
  link.addEventListener("click", () => showSamples(at));
  return link;
}

// What a cell sorts by: its own value, or that beside its text.
const worth = cell => cell !== null && typeof cell === "object" ? cell.value : cell;

function table(place, { columns, rows }, hidden = []) {
  const filled = columns.map((_, i) => hidden.includes(i) ? false
    : i < 2 ? i > 0 || many : rows.some(r => !["", null].includes(r[i]?.text ?? worth(r[i]))));
  const head = element("tr"), body = element("tbody");
  let by = -1, up = true;
  const draw = sorted => {
    body.replaceChildren(...sorted.map(row => {
      const bad = row.includes("failed") || row.includes("skipped");
      return element("tr", bad ? { class: "bad" } : {}, ...row.map((value, i) => {
        const number = typeof worth(value) === "number";
        const text = value === null ? "" : value.text ?? (number ? figure(value)
          : typeof value === "boolean" ? (value ? "yes" : "no") : value);
        const shown = number && / ms$/.test(columns[i]) ? toSamples(row[0], row[1], text) : text;
        const kind = /^PROJECTED/.test(columns[i]) ? "guess" : number || text === "-" ? "n"
          : i === 1 ? "name" : "";
        return filled[i] ? element("td", kind ? { class: kind } : {}, shown) : "";
      }));
    }));
    // By keyboard a row is one stop, where it is one configuration.
    if (columns[2] !== "pass") for (const row of body.children) $("a", row)?.removeAttribute("tabindex");
  };
  columns.forEach((name, i) => {
    if (!filled[i]) return;
    const button = element("button", { type: "button" }, name);
    const cell = element("th", { scope: "col", "data-title": name }, button);
    button.addEventListener("click", () => {
      up = by === i ? !up : true;
      by = i;
      for (const other of head.children) other.removeAttribute("aria-sort");
      cell.setAttribute("aria-sort", up ? "ascending" : "descending");
      draw([...rows].sort((a, b) => {
        const [one, two] = [worth(a[i]), worth(b[i])];
        if (one === null || two === null) return (one === null) - (two === null); // blanks last
        const order = typeof one === "string" ? one.localeCompare(two) : one - two;
        return up ? order : -order;
      }));
    });
    head.append(cell);
  });
  draw(rows);
  place.append(element("table", {}, element("thead", {}, head), body));
}

function ticks(most, wanted = 6) {
  const rough = most / wanted, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map(f => f * power).find(s => s >= rough);
  return Array.from({ length: Math.floor(most / step + 1e-9) + 1 }, (_, k) => +(k * step).toPrecision(12));
}

function bars() {
  const shown = DATA.configurations.filter(c => c.median !== null);
  const names = [...passNames];
  legend($("#bars .legend"), names);
  const rest = element("span", {}, "outside kernels");
  rest.style.setProperty("--c", "var(--line)");
  $("#bars .legend").append(rest);
  const most = Math.max(...shown.map(c => c.median)), left = 16, width = 1100, row = 46;
  const x = value => left + value / most * (width - 90);
  const svg = element("svg", { viewBox: `0 0 ${width} ${row * shown.length + 30}` });
  for (const value of ticks(most)) svg.append(
    element("line", { x1: x(value), x2: x(value), y1: 0, y2: row * shown.length }),
    element("text", { x: x(value), y: row * shown.length + 18, "text-anchor": "middle", class: "soft" },
      `${value} ms`));
  shown.forEach((c, k) => {
    const y = row * k;
    svg.append(element("text", { x: left, y: y + 15 }, title(c)));
    let from = 0;
    for (const pass of c.passes) {
      svg.append(tip(element("rect", { x: x(from), y: y + 20, height: 18, fill: color(pass.name),
        width: Math.max(x(from + pass.median) - x(from), 0.5) }), `${pass.name}: ${figure(pass.median)} ms`));
      from += pass.median;
    }
    if (c.median > from) svg.append(tip(element("rect", { x: x(from), y: y + 20, height: 18,
      width: x(c.median) - x(from), fill: "var(--line)" }),
      `outside kernels: ${figure(c.median - from)} ms`));
    svg.append(element("text", { x: Math.max(x(c.median), x(from)) + 6, y: y + 34 }, `${figure(c.median)} ms`));
  });
  $("#bars .plot").append(svg);
}

function distributions() {
  const choice = $("#distributions select"), place = $("#distributions .plot");
  const shown = sampled;
  shown.forEach((c, k) => choice.append(element("option", { value: k }, title(c))));
  const draw = () => {
    const c = shown[choice.value], width = 1100, row = 30, left = 170;
    const lines = [...c.passes, ...(c.times.length && c.median !== null
      ? [{ name: "whole frame", median: c.median, times: c.times }] : [])];
    const svg = element("svg", { viewBox: `0 0 ${width} ${row * lines.length + 10}` });
    lines.forEach((one, k) => {
      const low = one.times[0], high = one.times[one.times.length - 1], span = high - low || 1;
      const x = value => left + 90 + (value - low) / span * (width - left - 210), y = row * k + 18;
      svg.append(element("text", { x: left - 8, y: y + 4, "text-anchor": "end" }, one.name),
        element("line", { x1: x(low), x2: x(high), y1: y, y2: y }),
        element("text", { x: x(high) + 8, y: y + 4, class: "soft" }, `${figure(high)} ms`),
        element("text", { x: x(low) - 8, y: y + 4, "text-anchor": "end", class: "soft" }, figure(low)));
      const fill = passNames.includes(one.name) ? color(one.name) : "var(--soft)";
      one.times.forEach((value, i) => svg.append(element("circle",
        { cx: x(value), cy: y + (i * 7 % 11) - 5, r: 2.6, fill, class: "dot" })));
      svg.append(tip(element("rect", { x: x(one.median) - 1.5, y: y - 12, width: 3, height: 24, fill: "var(--ink)" }),
        `${one.name}: median ${figure(one.median)} ms, ${figure(low)} to ${figure(high)} ms`));
    });
    place.replaceChildren(svg);
  };
  choice.addEventListener("change", draw);
  showSamples = at => { choice.value = at; draw(); };
  if (shown.length) draw();
}

function answers() {
  if (!DATA.answers.length) return hide("which");
  for (const one of DATA.answers) {
    const place = element("div", { class: "table" });
    $("#which .answers").append(element("h3", {}, many ? `${one.title} (${one.run})` : one.title),
      element("p", { class: "answer" }, one.sentence), place);
    if (one.projected) place.after(element("p", { class: "guess" }, one.projected));
    table(place, one, [0, 1]);
  }
}

function faults() {
  if (!DATA.faults.length) return hide("faults");
  for (const one of DATA.faults) {
    const row = 20, left = 96, width = 380, wide = 200;
    const svg = element("svg", { viewBox: `0 0 ${width} ${row * one.bars.length + 6}` });
    one.bars.forEach((bar, k) => {
      const y = row * k + 3;
      svg.append(element("text", { x: left - 8, y: y + 12, "text-anchor": "end" }, bar.name),
        tip(element("rect", { x: left, y: y + 2, height: 13, width: Math.max(bar.length * wide, 0.5),
          fill: bar.bad ? techniqueColor(one.technique) : "var(--line)" }),
          `${one.label}: ${bar.name} ${bar.text} (${bar.limit} is a fault): ${bar.meaning}`),
        element("text", { x: left + wide + 10, y: y + 12, class: bar.bad ? "" : "soft" }, bar.text));
    });
    svg.append(element("line", { class: "limit", x1: left + wide / 2, x2: left + wide / 2, y1: 0,
      y2: row * one.bars.length + 6 }));
    $("#faults .profiles").append(element("figure", {}, element("figcaption", {}, one.label), svg));
  }
}

// Ranges that nobody measured: hatched in one colour that no measured figure has.
function projected() {
  if (!DATA.projected.length) return hide("projected");
  $("#projected .warning").textContent = DATA.projected_warning;
  DATA.projected.forEach((one, n) => {
    const place = element("div", { class: "table" }), plot = element("div", { class: "plot" });
    $("#projected .devices").append(element("h3", {}, many ? `${one.title} (${one.run})` : one.title), plot, place);
    if (one.bars.length) {
      const row = 24, left = 70, width = 1100, right = 210, foot = 26;
      const low = Math.log10(Math.min(...one.bars.map(b => b.low))), high = Math.log10(Math.max(...one.bars.map(b => b.high)));
      const near = low - 0.1, far = Math.max(high, low + 0.5) + 0.1;
      const x = v => left + (Math.log10(v) - near) / (far - near) * (width - left - right);
      const labels = [...new Set(one.bars.map(b => b.label))], bottom = row * (one.bars.length + labels.length);
      const svg = element("svg", { viewBox: `0 0 ${width} ${bottom + foot}` });
      svg.append(element("defs", {}, element("pattern", { id: `hatch${n}`, width: 6, height: 6,
        patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" },
        element("rect", { width: 2.2, height: 6, class: "hatch" }))));
      for (let e = Math.floor(near); e <= far; e++) for (const f of [1, 2, 5]) {
        const v = +(f * 10 ** e).toPrecision(3);
        if (Math.log10(v) < near || Math.log10(v) > far) continue;
        svg.append(element("line", { x1: x(v), x2: x(v), y1: 0, y2: bottom }),
          element("text", { x: x(v), y: bottom + 16, "text-anchor": "middle", class: "soft" }, `${v} ms`));
      }
      one.bars.forEach((bar, k) => {
        const above = labels.indexOf(bar.label) + 1, y = row * (k + above), told = bar.verdict === "cannot tell";
        if (bar.label !== one.bars[k - 1]?.label) svg.append(element("text", { x: 16, y: y - 4 }, bar.label));
        svg.append(element("text", { x: left - 8, y: y + 16, "text-anchor": "end" }, bar.whole),
          tip(element("rect", { x: x(bar.low), y: y + 5, height: 14, width: Math.max(x(bar.high) - x(bar.low), 2),
            class: told ? "range unknown" : "range", fill: told ? "none" : `url(#hatch${n})` }),
            `${bar.label}, ${bar.whole}: projected ${bar.text}`),
          element("text", { x: x(bar.high) + 8, y: y + 16, class: "soft" }, bar.text));
      });
      plot.append(svg);
    }
    table(place, one, [0]);
  });
}

function roofline() {
  const points = DATA.configurations.flatMap(c => c.passes.filter(p => p.intensity && p.gflop_per_s)
    .map(p => ({ ...p, of: title(c), run: c.run, technique: c.technique, hollow: c.variant === "published" })));
  const place = $("#roofline .plot");
  if (!points.length) { place.append("No pass of these runs declares both bytes and flops."); return; }
  const techniques = [...new Set(points.map(p => p.technique))]; // the n-th has the n-th shape
  const mark = (p, fill = color(p.name)) => element("path", {
    d: SHAPES[techniques.indexOf(p.technique) % SHAPES.length], fill: p.hollow ? "var(--ground)" : fill,
    "stroke-width": p.hollow ? 2 : 1, stroke: p.hollow ? fill : "var(--ground)" });
  legend($("#roofline .legend"), [...new Set(points.map(p => p.name))], color);
  const key = (p, text) => $("#roofline .legend").append(element("span", { class: "key" },
    element("svg", { viewBox: "-8 -8 16 16", width: 16, height: 16, "aria-hidden": "true" }, mark(p, "var(--soft)")), text));
  for (const technique of techniques) key({ technique, hollow: false }, technique);
  const published = points.find(p => p.hollow);
  if (published) key(published, "hollow: published");
  const width = 1100, height = 460, left = 66, bottom = 44;
  const roofs = DATA.runs.map(r => r.roofs);
  const top = Math.log10(Math.max(...roofs.map(r => r.gflop_per_s), ...points.map(p => p.gflop_per_s)) * 2);
  const low = Math.log10(Math.min(...points.map(p => p.gflop_per_s)) / 2);
  const ridge = roofs.map(r => r.gflop_per_s / r.gb_per_s);
  const near = Math.log10(Math.min(...points.map(p => p.intensity), ...ridge) / 3);
  const far = Math.log10(Math.max(...points.map(p => p.intensity), ...ridge) * 3);
  const x = v => left + (Math.log10(v) - near) / (far - near) * (width - left - 12);
  const y = v => height - bottom - (Math.log10(v) - low) / (top - low) * (height - bottom - 10);
  const svg = element("svg", { viewBox: `0 0 ${width} ${height}` });
  for (let e = Math.ceil(near); e <= far; e++) svg.append(
    element("line", { x1: x(10 ** e), x2: x(10 ** e), y1: 10, y2: height - bottom }),
    element("text", { x: x(10 ** e), y: height - bottom + 18, "text-anchor": "middle", class: "soft" }, +(10 ** e).toPrecision(3)));
  for (let e = Math.ceil(low); e <= top; e++) svg.append(
    element("line", { x1: left, x2: width - 12, y1: y(10 ** e), y2: y(10 ** e) }),
    element("text", { x: left - 8, y: y(10 ** e) + 4, "text-anchor": "end", class: "soft" }, +(10 ** e).toPrecision(3)));
  svg.append(element("text", { x: width / 2, y: height - 6, "text-anchor": "middle" }, "flops per byte"),
    element("text", { x: 14, y: height / 2, transform: `rotate(-90 14 ${height / 2})`, "text-anchor": "middle" }, "GFLOP/s"));
  DATA.runs.forEach((r, k) => {
    const { gb_per_s: b, gflop_per_s: f } = r.roofs, start = 10 ** near, end = 10 ** far;
    const floor = Math.max(start, 10 ** low / b);
    svg.append(element("path", { class: "roof", d: `M${x(floor)} ${y(floor * b)} L${x(f / b)} ${y(f)} L${x(end)} ${y(f)}` }),
      element("text", { x: x(end) - 4, y: y(roofs[0].gflop_per_s) + 18 + 17 * k, "text-anchor": "end", class: "soft" }, `${r.name}: ${figure(f)} GFLOP/s, ${figure(b)} GB/s`));
  });
  for (const p of points) svg.append(tip(
    element("g", { transform: `translate(${x(p.intensity)} ${y(p.gflop_per_s)})` }, mark(p)),
    `${p.name} (${p.of}): ${figure(p.gflop_per_s)} GFLOP/s at ${figure(p.intensity)} flops per byte`));
  place.append(svg);
}

function hide(id) {
  $(`#${id}`).hidden = true;
  $(`nav a[href="#${id}"]`).remove();
}

function errors() {
  if (!DATA.errors.length) return hide("errors");
  legend($("#errors .legend"), [...new Set(DATA.errors.map(e => e.technique))], techniqueColor);
  const width = 1100, height = 420, left = 66, bottom = 44;
  const range = name => {
    const values = DATA.errors.map(e => Math.log10(e[name]));
    return [Math.min(...values) - 0.25, Math.max(...values) + 0.25];
  };
  const [near, far] = range("time"), [low, top] = range("error");
  const x = v => left + (Math.log10(v) - near) / (far - near) * (width - left - 12);
  const y = v => height - bottom - (Math.log10(v) - low) / (top - low) * (height - bottom - 10);
  const steps = (from, to) => [1, 2, 5].flatMap(f => Array.from({ length: 14 }, (_, e) => f * 10 ** (e - 7)))
    .filter(v => Math.log10(v) >= from && Math.log10(v) <= to).map(v => +v.toPrecision(3));
  const svg = element("svg", { viewBox: `0 0 ${width} ${height}` });
  for (const v of steps(near, far)) svg.append(
    element("line", { x1: x(v), x2: x(v), y1: 10, y2: height - bottom }),
    element("text", { x: x(v), y: height - bottom + 18, "text-anchor": "middle", class: "soft" }, v));
  for (const v of steps(low, top)) svg.append(
    element("line", { x1: left, x2: width - 12, y1: y(v), y2: y(v) }),
    element("text", { x: left - 8, y: y(v) + 4, "text-anchor": "end", class: "soft" }, `${+(100 * v).toPrecision(3)} %`));
  svg.append(element("text", { x: width / 2, y: height - 6, "text-anchor": "middle" }, "median ms of a frame"),
    element("text", { x: 14, y: height / 2, transform: `rotate(-90 14 ${height / 2})`, "text-anchor": "middle" }, "relative L2 error"));
  for (const e of DATA.errors) svg.append(tip(element("circle", { cx: x(e.time), cy: y(e.error), r: 7,
    fill: techniqueColor(e.technique), stroke: "var(--ground)", "stroke-width": 1.5 }),
    `${e.label}${e.settings ? ` (${e.settings})` : ""}: ${figure(100 * e.error)} % off, bias ${figure(100 * e.bias)} %, ` +
    `${figure(e.time)} ms, ${figure(e.memory_mib)} MiB`));
  $("#errors .plot").append(svg);
}

function images() {
  const section = $("#images"), [left, right] = section.querySelectorAll("select");
  if (!DATA.images.length) return hide("images");
  const slider = $("input", section), over = $(".over", section), [under, above] = section.querySelectorAll("img");
  DATA.images.forEach((image, k) => [left, right].forEach(s => s.append(element("option", { value: k }, image.title))));
  right.value = Math.min(1, DATA.images.length - 1);
  const cut = () => { over.style.clipPath = `inset(0 ${100 - slider.value}% 0 0)`; };
  const pick = () => {
    above.src = DATA.images[left.value].src;
    under.src = DATA.images[right.value].src;
    above.alt = DATA.images[left.value].title;
    under.alt = DATA.images[right.value].title;
  };
  const drag = event => {
    if (event.type === "pointermove" && !event.buttons) return;
    const box = over.getBoundingClientRect();
    slider.value = 100 * (event.clientX - box.left) / box.width;
    cut();
  };
  const frame = $(".compare", section);
  frame.addEventListener("pointerdown", drag);
  frame.addEventListener("pointermove", drag);
  frame.addEventListener("dragstart", event => event.preventDefault());
  slider.addEventListener("input", cut);
  [left, right].forEach(s => s.addEventListener("change", pick));
  pick();
  cut();
  if (DATA.left_out) section.append(element("p", {}, "Further images were left out to keep this page small."));
}

runs();
answers();
bars();
table($("#frames .table"), DATA.frames);
table($("#passes .table"), DATA.passes);
distributions();
roofline();
errors();
faults();
projected();
images();
