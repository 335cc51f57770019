// How a host opens a page: a file, or an iframe in a notebook.
import { bytesOf, Recorded, through, unpack } from "./history.js";
import { MotionPage } from "./motion.js";
import { Page } from "./page.js";

function sheetOf(text) {                       // made by script, so that the content policy needs no styles
  const sheet = new CSSStyleSheet();
  sheet.replaceSync(text);
  return sheet;
}

/** Draw a page into an element; a header as README.md describes it. */
export function mount(element, header, View = Page) {
  const root = element.shadowRoot ?? element.attachShadow({ mode: "open" });
  root.adoptedStyleSheets = [sheetOf(STYLE)];
  return new View(element, header);
}

/** Give an element all of the window: its style, and the keys that nobody else takes. */
export function takeWindow(element) {
  element.whole = true;
  document.adoptedStyleSheets = [sheetOf("html, body { margin: 0; height: 100%; } body > main { height: 100%; }")];
  document.addEventListener("keydown", (event) => { if (event.target === document.body) element.page?.key(event); });
}

/** A page in a file, or in a frame of a notebook: everything is in the text. */
export async function openPage(element, base64) {
  takeWindow(element);
  const { header, columns } = await unpack(bytesOf(base64));
  const { cells } = columns;
  if (header.python) header.python.blob = new TextDecoder().decode(await through(bytesOf(document.getElementById("kaju-python").textContent), new DecompressionStream("deflate")));
  if (header.kind === "pictures") return mount(element, { ...header, columns }, MotionPage);
  const run = columns.offset ? Object.assign(new Recorded(header.scene, cells), { late: header.late, states: header.states }).append(columns) : null;
  const presets = (header.presets ?? []).map((preset, n) => ({ ...preset, cells: columns[`cells${n}`] ?? cells }));
  return mount(element, { ...header, cells, run, presets });
}
