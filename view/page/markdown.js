// The little Markdown that lessons and presets are written in, as elements.
import { make } from "./controls.js";

const PIECES = /\*\*(.+?)\*\*|\*(.+?)\*|`([^`]+)`|\[([^\]]+)\]\(([^)\s]+)\)/g;

/** Words with **bold**, *emphasis*, `code` and [links](to pages). */
export function inline(words) {
  const list = [], text = words.replace(/(\d) (?=(?:[GMkmµn]?(?:Pa|J|N)|[kcmµn]?m|s|%)(?!\w))/g, "$1\u00a0");   // a number and its unit stay in one line
  let at = 0;
  for (const found of text.matchAll(PIECES)) {
    const [all, bold, emphasis, code, name, to] = found;
    list.push(text.slice(at, found.index));
    if (name !== undefined) list.push(/^(https?:|[\w./#-]+$)/.test(to) ? make("a", { href: to, textContent: name, target: self === top ? "_blank" : "", rel: "noopener" }) : name);
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
