// A lesson on paper: the rule in one labelled cell, the questions, what has been ticked and typed.
// Printed from the page; without colour, and an answer of the teacher never on a pupil's sheet.
import { draw, make } from "./controls.js";
import { inline, rendered } from "./markdown.js";
import { quantity } from "./words.js";

/** Lay the sheet out and print it. */
export function worksheet(page) {
  laySheet(page);
  print();
}

/** The sheet stands beside the page and is seen on paper only. */
export function laySheet(page) {
  const { root, lesson } = page;
  root.querySelector(".sheet")?.remove();
  if (lesson) root.append(make("div", { className: "sheet", lang: page.language }, ...paperOf(page)));
}

function paperOf(page) {
  const { lesson, t } = page, line = (word, size) => make("span", {}, `${word} `, make("i", { className: `blank ${size}` }));
  const head = make("div", { className: "top" }, make("div", {}, make("h1", { textContent: page.say(page.title) }), make("p", { textContent: [t("worksheet"), lesson.minutes && t("minutes", { t: lesson.minutes }), loadWords(page)].filter(Boolean).join(" · ") })),
    make("div", { className: "who" }, line(t("name"), "long"), make("div", {}, line(t("course"), "short"), " ", line(t("date"), "short"))));
  const questions = lesson.questions.map((q, i) => make("section", {}, make("b", { className: "number", textContent: i + 1 }),
    make("div", { className: "asked" }, make("p", {}, make("span", {}, ...inline(page.say(q.question))), make("small", { textContent: q.minutes ? t("minutes", { t: q.minutes }) : "" })), ...(q.note ? [rendered(page.say(q.note))] : []), ...answerOf(page, q))));
  const foot = make("div", { className: "bottom" }, make("span", { textContent: `kaju · ${page.say(page.title)}` }), make("span", { textContent: t("asSaved", { d: new Date().toLocaleString(page.language) }) }));
  const answers = lesson.teacher ? [make("div", { className: "teachers" }, make("h1", { textContent: `${t("answers")}: ${page.say(page.title)}` }),
    ...lesson.questions.map((q, i) => make("section", {}, make("b", { className: "number", textContent: i + 1 }), make("div", { className: "asked" }, ...solution(page, q)))),
    ...(lesson.notes ? [rendered(page.say(lesson.notes))] : []))] : [];
  return [head, ...(page.scene?.rule?.kind === "prescribed" ? [ruleBox(page)] : []), ...questions, foot, ...answers];
}

function loadWords({ scene }) {
  return scene?.loads?.length ? [...scene.loads.slice(0, 3).map((l) => quantity(Math.hypot(...l.force), "N")), scene.rule.threshold && `γ = ${quantity(scene.rule.threshold, "N")}`].filter(Boolean).join(", ") : "";
}
const solution = (page, q) => [make("p", { textContent: (q.fields ?? []).map((f) => `${page.say(f.label) ?? ""}: ${f.answer} ${page.say(f.unit) ?? ""}${f.tolerance ? ` (± ${f.tolerance})` : ""}`).join(" · ") }), ...(q.answer ? [rendered(page.say(q.answer))] : [])];

/** What has been answered, in italics; lines where nothing has. */
function answerOf(page, q) {
  const { lesson, t } = page, given = lesson.answers[q.key], lines = (n) => Array.from({ length: n }, () => make("div", { className: "ruled" }));
  const written = q.kind === "number" ? given?.[q.fields.length] : given, text = written?.trim() ? [make("p", { className: "given", textContent: written })] : null;
  if (q.kind === "number") return [make("table", {}, make("tr", {}, ...q.fields.map((f) => make("th", {}, page.say(f.label) ?? ""))),
    make("tr", {}, ...q.fields.map((f, i) => make("td", {}, make("em", { textContent: given?.[i] ?? "" }), ` ${page.say(f.unit) ?? ""}`)))), ...(q.lines ? text ?? lines(q.lines) : [])];
  if (q.draws && !text) return [make("img", { className: "drawn", alt: "", src: page.unmarked }), ...lines(1)];
  if (q.kind !== "cells" || page.run.lattice?.dimension !== 2) return text ?? lines(q.lines ?? 3);
  const guess = lesson.guesses[q.key] ?? {}, first = lesson.firsts[q.key], spawned = {};
  page.run.lattice.each((k) => { if (first && page.run.spawn[k] > 0 && page.run.spawn[k] <= q.until) spawned[k] = page.run.spawn[k]; });
  return [make("div", { className: "grids" }, grid(page, t("myGuess"), first ?? guess, { ...guess, ...spawned }), grid(page, t("whatHappened"), spawned, { ...guess, ...spawned })), ...(text ?? lines(2))];
}

/** The part of the body round the loads, with a number in every cell that has one. */
function grid(page, title, numbers, all) {
  const { run: { lattice: L, kinds }, scene } = page, u = 15, at = scene.loads.map((l) => l.cell).concat(Object.keys(all).map((k) => L.cell(Number(k))));
  const range = (a, more) => [Math.max(0, Math.min(...at.map((c) => c[a])) - more), Math.min(L.shape[a] - 1, Math.max(...at.map((c) => c[a])) + more)];
  const [x0, x1] = L.shape[0] <= 20 ? [0, L.shape[0] - 1] : range(0, 9), [y0, y1] = range(1, 4), w = (x1 - x0 + 1) * u, h = (y1 - y0 + 1) * u;
  const svg = draw("svg", { viewBox: `-24 -34 ${w + 28} ${h + 56}`, width: w + 28, height: h + 56, role: "img", "aria-label": title });
  const word = (x, y, text, anchor = "middle", size = 10) => svg.append(draw("text", { x, y, "text-anchor": anchor, "font-size": size }, text));
  for (let x = x0; x <= x1; x++) for (let y = y0; y <= y1; y++) {
    const k = L.key([x, y]), px = (x - x0) * u, py = (y1 - y) * u;
    if (kinds[k] < 0) continue;
    svg.append(draw("rect", { x: px, y: py, width: u, height: u, fill: numbers[k] ? "#d5dade" : "#fff", stroke: "#8a929c", "stroke-width": 0.7 }));
    if (numbers[k]) word(px + u / 2, py + u / 2 + 4, String(numbers[k]), "middle", 11);
  }
  for (let x = x0; x <= x1; x++) if (x % 5 === 0 || x === x1) word((x - x0 + 0.5) * u, h + 14, String(x));
  for (let y = y0; y <= y1; y++) if (y % 2 === y1 % 2) word(-6, (y1 - y + 0.5) * u + 4, String(y), "end");
  for (const { cell: [x, y], force } of scene.loads) if (force[1] < 0 && y === y1) {
    const px = (x - x0 + 0.5) * u;
    svg.append(draw("path", { d: `M${px} -22V-2M${px - 4} -8L${px} -2L${px + 4} -8`, fill: "none", stroke: "#000", "stroke-width": 1.6 }));
    word(px + 8, -12, quantity(Math.hypot(...force), "N"), "start", 11);
  }
  return make("figure", {}, make("figcaption", { textContent: title }), svg);
}

/** The rule in one cell, with the names of its shares. */
function ruleBox(page) {
  const { t, scene } = page, { rule, materials: [{ poissons_ratio: nu }] } = scene, [a1, a2, a3] = rule.alpha ?? [0.5, 0.5, 0.25];
  const svg = draw("svg", { viewBox: "0 0 280 170", width: 280, height: 170, role: "img", "aria-label": t("cell") });
  const word = (x, y, text, anchor = "start") => svg.append(draw("text", { x, y, "text-anchor": anchor, "font-size": 12 }, text));
  const shaft = (d, dashed) => svg.append(draw("path", { d, fill: "none", stroke: "#000", "stroke-width": 1.8, ...(dashed ? { "stroke-dasharray": "3 3" } : {}) }));
  svg.append(draw("rect", { x: 100, y: 50, width: 80, height: 72, fill: "#d5dade", stroke: "#000" }), draw("rect", { x: 100, y: 46, width: 80, height: 80, fill: "none", stroke: "#000", "stroke-dasharray": "3 3" }));
  shaft("M140 4V42M135 34L140 42L145 34"); word(152, 18, `P ${t("comesIn")}`);
  shaft("M140 126V156M135 148L140 156L145 148"); word(152, 150, `${t("ahead")} α₂P`);
  shaft("M82 66V104M77 96L82 104L87 96"); word(72, 92, "α₃P", "end");
  shaft("M198 66V104M193 96L198 104L203 96"); word(210, 92, "α₃P");
  shaft("M98 56H56M64 51L56 56L64 61", true); word(4, 42, "(1−β)να₁P"); shaft("M182 56H224M216 51L224 56L216 61", true); word(196, 42, "(1−β)να₁P");
  word(140, 84, t("keeps"), "middle"); word(140, 102, "α₁P", "middle");
  const values = `α₁ = ${a1}, α₂ = ${a2}, α₃ = ${a3}, β = ${rule.beta}, ν = ${nu}, γ = ${quantity(rule.threshold, "N")}`;
  return make("div", { className: "rulebox" }, svg, make("div", {}, make("h2", { textContent: t("cell") }), make("p", { textContent: t("ruleInWords") }), make("p", { textContent: values })));
}
