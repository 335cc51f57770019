// What can be pressed, dragged and typed: elements, icons, choices, sliders with a field.
import { general, prefixOf, quantity } from "./words.js";

/** An element: properties, attributes (where it has no such property), children. */
export function make(tag, props = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(props)) {
    if (key in element && key !== "list") element[key] = value;
    else element.setAttribute(key, value);
  }
  element.append(...children);
  return element;
}

/** An element of a drawing: attributes only. */
export function draw(tag, props = {}, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [key, value] of Object.entries(props)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

const ICONS = { first: "M12 3L7 8l5 5M4 3v10", back: "M10 3L5 8l5 5", step: "M6 3l5 5-5 5", last: "M4 3l5 5-5 5M12 3v10",
  play: "M5 3l8 5-8 5z", pause: "M5 3v10M11 3v10", undo: "M6 3L3 6l3 3M3 6h6a4 4 0 010 8H7", redo: "M10 3l3 3-3 3M13 6H7a4 4 0 000 8h2",
  link: "M7 9a3 3 0 004 0l2-2a3 3 0 00-4-4L8 4M9 7a3 3 0 00-4 0L3 9a3 3 0 004 4l1-1", save: "M8 2v8M5 7l3 3 3-3M3 13h10",
  theme: "M8 2a6 6 0 100 12A6 6 0 008 2zM8 2v12M10 4v8M12 6v4", lessons: "M2 3h5v4H2zM9 3h5v4H9zM2 9h5v4H2zM9 9h5v4H9z", more: "M3 8h.01M8 8h.01M13 8h.01",
  print: "M4 6V2h8v4M4 12H2V6h12v6h-2M4 10h8v4H4z", tick: "M3 8.5l3.500 3.500L13 4.500", ring: "M8 3a5 5 0 100 10A5 5 0 008 3z", cross: "M4 4l8 8M12 4l-8 8",
  clock: "M8 2a6 6 0 100 12A6 6 0 008 2zM8 5v3l2 2", pen: "M3 13l1-3.500L11 2.500l2.500 2.500L6.500 12zM9.500 4l2.500 2.500", box: "M3 3h10v10H3zM5.500 8l2 2 3.500-4" };
export const icon = (name) => draw("svg", { viewBox: "0 0 16 16", "aria-hidden": "true", class: `icon ${name}` }, draw("path", { d: ICONS[name] }));

export const button = (text, onclick, props = {}) => make("button", { type: "button", textContent: text, onclick, ...props });
export const iconButton = (name, label, onclick, props = {}) => make("button", { type: "button", className: "icon", onclick, title: label, ariaLabel: label, ...props }, icon(name));
/** A button with an icon; narrow windows leave the word to readers and the tip. */
export const labelled = (name, text, onclick, props = {}) => make("button", { type: "button", onclick, title: text, ariaLabel: text, ...props }, icon(name), make("span", { className: "wide", textContent: text }));

export function picker(label, value, options, change) {
  const select = make("select", { ariaLabel: label, onchange: () => change(select.value) }, ...options.map(([key, text]) => make("option", { value: key, textContent: text })));
  select.value = value;
  return select;
}
export const choice = (label, value, options, change) => make("label", { className: "row" }, make("span", { textContent: label }), picker(label, value, options, change));
export function tick(label, checked, change, props = {}) {
  const box = make("input", { type: "checkbox", checked, onchange: () => change(box.checked), ...props });
  return make("label", { className: "tick" }, box, label);
}
/** One of several, all seen. */
export function segments(label, value, options, change) {
  const group = make("div", { className: "segments", role: "group", ariaLabel: label });
  const show = (chosen) => [...group.children].forEach((b, i) => { b.ariaPressed = String(options[i][0] === chosen); });
  group.append(...options.map(([key, text]) => button(text, () => { show(key); change(key); })));
  show(value);
  return group;
}

const FACTORS = { G: 1e9, M: 1e6, k: 1e3, c: 1e-2, m: 1e-3, "µ": 1e-6, u: 1e-6, n: 1e-9, p: 1e-12 }, BASES = ["", "N", "m", "Pa", "J", "s", "g", "°", "%"];
/** A unit as how many of its base: "mN" is [0.001, "N"]; a force times a length is work: "N·mm" is [0.001, "J"]; per length: "N/cm" is [100, "N/m"]. */
const split = (unit, [, force, length] = unit.match(/^([GMkmµu]?N)[·⋅*×]?([kcmµun]?m)$/) ?? [], [, what, per] = unit.match(/^(.+)\/([kcmµun]?m)$/) ?? []) => (force ? [split(force)[0] * split(length)[0], "J"] : per ? [split(what)[0] / split(per)[0], `${split(what)[1]}/m`] : BASES.includes(unit) || !FACTORS[unit[0]] ? [1, unit] : [FACTORS[unit[0]], unit.slice(1)]);
/** What a reader has typed, in a unit: "12 mN", "0.012", "0,012"; a bare number has the unit `shown`; NaN if it is no number of it. */
export function numberOf(text, unit = "", shown = unit) {
  const found = text.trim().replace(",", ".").replace("−", "-").replace(/\s*\/\s*/, "/").replace(/(N)\s*[·⋅*×]?\s*(?=[kcmµun]?m$)/, "$1·").match(/^([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(\S*)$/i);
  if (!found) return NaN;
  const [, digits, given] = found, [theirs, base] = split(given || shown), [ours, wanted] = split(unit);
  return base === wanted ? Number(digits) * (theirs / ours) : NaN;
}

/** A field for a number: Enter takes it, Escape gives it back, up and down step (Shift: ten). */
export function numberField({ label, value, min, max, unit = "", log = false, step = 0.01, show, t }, change) {
  const written = show ?? ((v) => (unit ? quantity(v, unit) : general(v, 4))), error = make("small", { className: "wrong", role: "alert", hidden: true });
  const field = make("input", { type: "text", className: "field", inputMode: "decimal", value: written(value), ariaLabel: t("typed", { name: label }), autocomplete: "off" });
  const put = (v) => { value = v; field.value = written(v); error.hidden = true; field.ariaInvalid = "false"; };
  const take = () => {
    const prefix = unit && unit !== "°" && value ? prefixOf(Math.abs(value), unit)[1] : "", v = numberOf(field.value, unit, prefix + unit), off = 1e-9 * Math.abs(v);   // beside "10 mN", 4.5 is 4.5 mN
    if (field.value === written(value)) { put(value); return; }
    if (v >= min - off && v <= max + off) { put(v); change(v); return; }
    error.textContent = Number.isNaN(v) ? t("noNumber") : t("outOfRange", { x: written(v), a: written(min), b: written(max), v: written(value) });
    error.hidden = false; field.ariaInvalid = "true";
  };
  field.onkeydown = (event) => {
    const turn = { ArrowUp: 1, ArrowDown: -1 }[event.key];
    if (event.key === "Enter") { take(); error.scrollIntoView({ block: "nearest" }); }
    else if (event.key === "Escape") { put(value); event.stopPropagation(); }
    else if (turn) {
      const by = turn * (event.shiftKey ? 10 : 1) * step, v = log ? value * 10 ** by : value + by;
      put(Number(Math.max(min, Math.min(max, v)).toPrecision(6)));
      change(value); event.preventDefault();
    }
  };
  field.onblur = take;
  return { field, error, put };
}

/** A slider and a field for one number; `log`: equal ways on it are equal factors. */
export function slider(label, options, change) {
  const { value, min, max, step = 0.01, log = false } = options, name = log ? (v) => Math.log10(v) : (v) => v, number = log ? (p) => Number((10 ** p).toPrecision(4)) : (p) => p;
  const input = make("input", { type: "range", min: name(min), max: name(max), step, value: name(value), ariaLabel: label });
  const { field, error, put } = numberField({ ...options, label, step }, (v) => { input.value = name(v); input.ariaValueText = field.value; change(v); });
  input.ariaValueText = field.value;
  input.oninput = () => { const v = number(Number(input.value)); change(v); put(v); input.ariaValueText = field.value; };
  return make("div", { className: "row" }, make("span", { textContent: label }), input, field, error);
}

// ---------------------------------------- the little Markdown that lessons and presets are written in

const PIECES = /\*\*(.+?)\*\*|\*(.+?)\*|`([^`]+)`|\[([^\]]+)\]\(([^)\s]+)\)/g;

/** A link: pages beside this one share one other tab, and the page that is shown is marked. */
function linkTo(to, textContent) {
  const here = location.pathname.endsWith(`/${to}`);
  return make("a", { href: to, textContent, target: here || self !== top ? "" : to.includes(":") ? "_blank" : "kaju", ...(here ? { ariaCurrent: "page" } : {}) });
}

/** Words with **bold**, *emphasis*, `code` and [links](to pages). */
export function inline(words) {
  const list = [], text = words.replace(/(\d) (?=(?:[GMkmµn]?(?:Pa|J|N)|[kcmµn]?m|s|%)(?!\w))/g, "$1\u00a0").replace(/\((\d+), (\d+)\)/g, "($1,\u00a0$2)");   // a number and its unit stay in one line, and a cell
  let at = 0;
  for (const found of text.matchAll(PIECES)) {
    const [all, bold, emphasis, code, name, to] = found;
    list.push(text.slice(at, found.index));
    if (name !== undefined) list.push(/^(https?:|[\w./#-]+$)/.test(to) ? linkTo(to, name) : name);
    else list.push(make(bold ? "strong" : emphasis ? "em" : "code", {}, ...(code ? [code] : inline(bold ?? emphasis))));
    at = found.index + all.length;
  }
  return [...list, text.slice(at)].filter((piece) => piece !== "");
}

const ROW = /^\|(.*)\|$/, BULLET = /^[-*] /, NUMBER = /^\d+\. /;
function block(lines) {
  const [first] = lines, each = (pattern) => lines.every((line) => pattern.test(line) || /^ +/.test(line));
  if (first.startsWith("#")) {
    const rest = lines.slice(1);
    return [make("h3", {}, ...inline(first.replace(/^#+\s*/, ""))), ...(rest.length ? block(rest) : [])];
  }
  if (each(ROW)) {
    const rows = lines.filter((line) => !/^\|[-: |]+\|$/.test(line)).map((line) => line.match(ROW)[1].split("|").map((cell) => cell.trim()));
    return [make("table", {}, ...rows.map((row, i) => make("tr", {}, ...row.map((cell) => make(i ? "td" : "th", {}, ...inline(cell))))))];
  }
  for (const [tag, pattern] of [["ul", BULLET], ["ol", NUMBER]]) if (each(pattern)) {
    const items = lines.join("\n").replace(/\n +/g, " ").split("\n");
    return [make(tag, {}, ...items.map((item) => make("li", {}, ...inline(item.replace(pattern, "")))))];
  }
  return [make("p", {}, ...inline(lines.join(" ")))];
}

/** A text as paragraphs, headings, lists and tables. */
export function rendered(text) {
  const blocks = text.trim().split(/\n{2,}/).filter(Boolean);
  return make("div", { className: "text" }, ...blocks.flatMap((lines) => block(lines.split("\n"))));
}

// ---------------------------------------------------------------------------- ways of looking

/** What may stand on the stage besides the body: {name, offered(page), open, close, tools, cards, draw, press, move, release, key …}. */
export const MODES = [];
/** The modes that a page offers now. */
export const offered = (page) => MODES.filter((mode) => mode.offered(page));
/** Those that a reader chooses: in a lesson only where it asks for one of them. */
export const waysOf = (page) => offered(page).filter((mode) => !mode.alone && (!page.lesson || page.lesson.questions.some(({ show }) => ["twin", "cuts"].includes(show?.mode))));
