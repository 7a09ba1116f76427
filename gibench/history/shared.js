"use strict";
// What the pages of this folder draw with.
const $ = (selector, from = document) => from.querySelector(selector);
const SVG = ["svg", "line", "text", "circle", "path"];

// An element with attributes and children. A link inside a drawing is made by svgLink.
function element(name, attributes = {}, ...children) {
  const made = SVG.includes(name) ? document.createElementNS("http://www.w3.org/2000/svg", name)
    : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

function svgLink(href, child) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", "a");
  made.setAttribute("href", href);
  made.append(child);
  return made;
}

const figure = value => value === null ? "" : value === 0 ? "0"
  : Math.abs(value) >= 1000 ? value.toFixed(0) : +value.toPrecision(4) + "";

function tip(made, text) {
  const show = () => { $("#tip").textContent = text; $("#tip").hidden = false; };
  const hide = () => { $("#tip").hidden = true; };
  for (const event of ["mouseenter", "focus"]) made.addEventListener(event, show);
  for (const event of ["mouseleave", "blur"]) made.addEventListener(event, hide);
  made.setAttribute("aria-label", text);
  return made;
}

function table(place, heads, rows) {
  const head = element("tr"), body = element("tbody");
  let by = -1, up = true;
  const draw = sorted => body.replaceChildren(...sorted.map(row => element("tr", {}, ...row.map(cell =>
    element("td", typeof cell === "number" ? { class: "n" } : {}, typeof cell === "number" ? figure(cell) : cell ?? "")))));
  heads.forEach((name, i) => {
    const button = element("button", { type: "button" }, name), cell = element("th", { scope: "col" }, button);
    button.addEventListener("click", () => {
      up = by === i ? !up : true;
      by = i;
      for (const other of head.children) other.removeAttribute("aria-sort");
      cell.setAttribute("aria-sort", up ? "ascending" : "descending");
      draw([...rows].sort((a, b) => (a[i] === null) - (b[i] === null) ||
        (up ? 1 : -1) * (typeof a[i] === "string" ? a[i].localeCompare(b[i]) : a[i] - b[i])));
    });
    head.append(cell);
  });
  draw(rows);
  place.append(element("table", {}, element("thead", {}, head), body));
}
