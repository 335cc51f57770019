// A lesson in the page: predict, step, explain, try. Questions are asked one by one; what is typed
// and ticked is kept on this computer; the page shows no further than the question has got.
import { ticksOf } from "./charts.js";
import { button, draw, icon, inline, labelled, make, MODES, numberOf, rendered, segments, tick } from "./controls.js";
import { paintCells, paintNumbers, paintPick, View } from "./paint.js";
import { cardsBox, panelsOf, rulePanel, storyCard, tabList } from "./panels.js";
import { sharesOf, Twin } from "./rule.js";
import { general, local, quantity } from "./words.js";

export const STEPS = ["predict", "step", "explain", "try"];
const MOST_LETTERS = 2000, SMALL = 4, DRAWN = "✎";  // of an answer; so many generations have a small picture; the answer of who drew it

export class Lesson {
  constructor(page, { key, title, here, index, intro, opens, curves, minutes, questions, teacher, presets }) {
    this.wide = matchMedia("(min-width: 1100px)");     // room for curves beside the picture
    this.wide.onchange = () => page.rebuild();
    Object.assign(this, { page, key, title: title ?? page.title, here, intro, minutes, index, opens, curves, was: opens ?? 0, notes: teacher, questions: questions ?? [], answers: {}, guesses: {}, firsts: {}, done: [], at: -1, step: "predict", teacher: page.asked.has("teacher"), shown: "guess", pen: 1 });
    this.several = page.presets.length > 1 || /\.html\)/.test(JSON.stringify(this.questions));   // bodies, each with colours of its own
    (presets ?? []).forEach((names, n) => { if (page.presets[n]) Object.assign(page.presets[n], { ...names, word: "" }); });
    this.read();
    addEventListener("storage", ({ key }) => { if (key === this.place) { this.read(); page.rebuild(); } });   // answers typed in another page of the lesson
  }
  /** Open where the reader was, in this page or another one of the lesson; that one at the question that asks for it. */
  begin() {
    this.page.root.addEventListener("click", (event) => { const link = event.target.closest("a[target=kaju]"); if (link && !event.ctrlKey && !event.metaKey && this.to(link.getAttribute("href"))) event.preventDefault(); });
    if (this.was > 0) this.go(this.was); else this.open(0, true);
  }
  get place() { return `kaju:lesson:${this.key}`; }
  drawing(q) { return `kaju:drawing:${this.key}:${q.key}`; }   // what other pages of the lesson print for it
  read() {                                     // storage fails in private windows and in some files
    try {
      const kept = JSON.parse(localStorage.getItem(this.place) ?? "{}");
      localStorage.setItem(this.place, JSON.stringify(kept));
      Object.assign(this, { answers: kept.answers ?? {}, guesses: kept.guesses ?? {}, firsts: kept.firsts ?? {}, done: kept.done ?? [], was: Math.max(this.was, kept.at ?? 0), kept: Boolean(kept.when), keeps: true });
    } catch { this.keeps = false; }
  }
  keep() {
    const { answers, guesses, firsts, done, at } = this;
    try { localStorage.setItem(this.place, JSON.stringify({ answers, guesses, firsts, done, at, when: new Date().toISOString() })); this.keeps = this.kept = true; } catch { this.keeps = false; }
    if (this.saved) { this.saved.textContent = this.told; this.saved.classList.toggle("bad", !this.keeps); }
  }
  get told() { return this.keeps && !this.kept ? "" : this.page.t(this.keeps ? "savedHere" : "notSaved"); }
  forget() { Object.assign(this, { answers: {}, guesses: {}, firsts: {}, done: [], shown: "guess" }); this.keep(); this.open(0); }
  get question() { return this.questions[this.at]; }
  said(text) { return text?.replace(DRAWN, this.page.t("drawn")); }
  /** All that was written to a question; behind numbers that are judged whether they are right. */
  own(q) { return [this.answers[q.key] ?? []].flat().map((text, i) => text.trim() && `${this.said(text)} ${this.sign(q, i)}`.trim()).filter(Boolean).join(" · "); }
  /** A tick or a cross for a number that was typed. */
  sign(q, i) { return !q.fields?.[i] || q.step === "predict" || !this.answers[q.key]?.[i]?.trim() ? "" : isRight(q.fields[i], this.number(q, i)) ? "✓" : "✗"; }
  of(step) { return this.questions.filter((q) => q.step === step); }
  /** What of a question is still to be filled in or ticked, in its own words. */
  missing(q) {
    const { page, page: { t } } = this, given = [this.answers[q.key] ?? ""].flat(), ticked = Object.values(this.guesses[q.key] ?? {});
    if (q.kind === "cells") return Array.from({ length: q.until }, (_, i) => i + 1).filter((g) => !ticked.includes(g)).map((g) => t("generationOnly", { g }));
    const words = q.kind === "number" && !q.lines ? [] : [page.say(q.write) || t("yourAnswer")];
    return [...(q.guess ? this.missing(q.guess) : []), ...[...(q.fields ?? []).map(({ label }) => page.say(label)), ...words].filter((_, i) => !given[i]?.trim())];
  }
  answered(q) { return !this.missing(q).length; }
  /** Whether a guess has been made; of cells a part is enough for who was told what is open, or has seen what happened. */
  guessed(q) { return this.answered(q) || (q.kind === "cells" && this.begun(q) && ((this.asked === q && this.page.past.gesture > this.askedIn) || q.key in this.firsts)); }   // a slider that is drawn on does not ask again
  begun(q) { return Object.keys(this.guesses[q.key] ?? {}).length > 0; }
  /** Whether a guess in words or numbers stays as it is: more has been seen since. */
  get fixed() { const { question: q, done, teacher } = this; return !teacher && q.step === "predict" && q.kind !== "cells" && done.includes("predict"); }
  /** The last generation that is open: none before a guess, then the question's; where it is answered the next one's, or all; where a guess comes before numbers, all from the guess on. */
  get limit() { const { question: q, questions, at } = this; return this.teacher || q?.until === undefined || (q.guess && this.answered(q.guess)) ? Infinity : q.guess ? q.until : q.kind !== "cells" ? (this.answered(q) ? questions[at + 1] : q)?.until ?? Infinity : this.guessed(q) ? q.until : 0; }
  /** Whether a guess is still to be made: what would give it away is not shown. */
  get secret() { return this.hidden && this.page.g === 0; }
  /** Which way of looking a question asks for. */
  get home() { return this.question?.kind === "cells" ? "guess" : "body"; }

  /** Open a step at its first unanswered question. */
  open(n, quiet = false) {
    this.step = STEPS[n];
    const own = this.of(this.step);
    this.go(own.length ? this.questions.indexOf(own.find((q) => !this.answered(q)) ?? own[0]) : -1, quiet);
  }
  /** Open a step that a reader asks for: who has not guessed yet guesses first. */
  enter(n) {
    const open = this.of("predict").find((q) => !this.guessed(q));
    if (n && open && !this.teacher) { this.go(this.questions.indexOf(open)); this.ask(); return; }
    this.finish(); this.open(n); this.follow();
  }
  /** Go to a question, on a page where its numbers can be read. */
  visit(at) { this.go(at); this.follow(); }
  /** Go to the page that the question asks for, if this is another one. */
  follow() {
    const { here, question } = this, pages = question?.pages ?? [here];
    if (pages.includes(here)) return;
    this.keep();
    this.to(pages[0], "moved");   // there it is known where one was
  }
  /** To another page of the lesson, in the same tab if this computer keeps the answers. */
  to(file, ...signs) {
    if (this.keeps) this.questions.filter((q) => drawsBody(q) && q.pages?.includes(this.here)).forEach((q) => localStorage.setItem(this.drawing(q), bodyOf(this.page, q).src));
    if (this.keeps) location.href = [file, [...signs, ...(this.teacher ? ["teacher"] : [])].join("&")].filter(Boolean).join("#");
    return this.keeps;
  }
  /** Say what is still to be answered, beside the field that waits. */
  ask(word = this.begun(this.question) ? "stillOpen" : "answerFirst") {
    const { page, saved, question: q } = this, fields = [...page.root.querySelectorAll("aside .question ~ textarea, aside .question ~ .fields .field")];
    if (word === "stillOpen") Object.assign(this, { asked: q, askedIn: page.past.gesture });
    Object.assign(saved, { textContent: page.t(word === "answerFirst" && mayDraw(q) ? "drawOrSay" : word, { x: this.missing(word === "answerFirst" && q.guess ? q.guess : q).join(" · ") }), className: "saved bad" }).scrollIntoView({ block: "center" });
    if (q.kind !== "cells") fields.find(({ value }) => !value.trim())?.focus({ preventScroll: true });
  }
  /** On from a question; who has left something open hears of it first. */
  leave(go) {
    const { question: q, teacher } = this;
    if (!q || teacher || this.asked === q || this.answered(q) || (q.step === "predict" && !this.guessed(q))) { go(); this.follow(); } else this.ask("stillOpen");
  }
  go(at, quiet = false) {
    const { page } = this;
    this.at = at; this.step = this.question?.step ?? (at > 0 ? "try" : this.step);   // behind the last question there is the comparison
    page.playing = false; if (this.kept) this.keep();
    const { show, until } = this.question ?? {}, preset = page.presets[show?.preset];
    if (preset && (!quiet || show.preset)) page.load({ ...preset, generation: Math.min(show.generation ?? 0, this.limit) });
    if (show?.look) Object.assign(page.look, show.look);
    if (show?.cell) page.picked = page.run.lattice.key(show.cell);
    this.shown = this.question && this.guess && Object.keys(this.guess).length && this.firsts[this.question.key] ? "both" : "guess";
    page.setMode(show?.mode ?? (this.question ? this.home : page.look.mode), true);   // what was seen last stays beside the comparison
    const g = show?.generation ?? (quiet || until !== undefined ? 0 : page.g);
    page.seek(Math.min(g, this.limit));
    page.past?.begin();
    if (page.host) { page.root.querySelector("aside .body")?.scrollTo?.(0, 0); }
  }
  get next() {
    const own = this.of(this.step), more = this.question && own[own.indexOf(this.question) + 1], step = STEPS.indexOf(this.step) + 1, last = step === STEPS.length;
    if (more) return { word: "nextQuestion", go: () => this.go(this.questions.indexOf(more)) };
    if (last && this.question) return { word: "compare", go: () => { this.finish(); this.go(this.questions.length); } };
    return last && !this.index ? null : { step, word: last ? "lessons" : "nextStep", go: () => { if (!last) { this.enter(step); return; } this.finish(); location.href = this.index; } };
  }
  /** Whether a question is done: whole, and its numbers are right. */
  isDone(q) { return this.answered(q) && (q.kind !== "number" || q.step === "predict" || q.fields.every((field, i) => isRight(field, this.number(q, i)))); }
  /** The number in a field of a question. */
  number(q, i) { return numberIn(this.answers[q.key]?.[i] ?? "", this.page.say(q.fields[i].unit) ?? ""); }
  finish() {
    this.done = [...this.done.filter((name) => name !== this.step), ...(this.of(this.step).every((q) => this.isDone(q)) ? [this.step] : [])];
    if (this.kept) this.keep();
  }
  answer(q, value, field) {
    this.answers[q.key] = field === undefined ? value : Object.assign([...(this.answers[q.key] ?? q.fields.map(() => ""))], { [field]: value });
    this.keep();
    this.page.later();
  }

  // ------------------------------------------------------------------------------- the guess
  get guess() { return this.guesses[this.question?.key] ??= {}; }
  /** What a cell is at a generation: a hit where it woke in the one ticked; a tick counts from that on. */
  kindOf(k, g, guess = this.guess) {
    const at = this.page.run.spawn[k], awake = at > 0 && at <= g;
    return guess[k] <= g ? (awake && guess[k] === at ? "hit" : "false") : awake ? "miss" : null;
  }
  /** Hit, missed and false cells at a generation. */
  compared(g, guess = this.guess) {
    const { run: { kinds, lattice: L } } = this.page, found = { hit: [], miss: [], false: [] };
    L.each((k) => { if (kinds[k] >= 0) found[this.kindOf(k, g, guess)]?.push(k); });
    return found;
  }
  /** The cells in which something is guessed or happens, with two more around: [x, y, columns, rows]. */
  window() {
    const { run: { lattice: L }, scene } = this.page, found = this.compared(this.question?.until || Infinity);
    const cells = [...found.hit, ...found.miss, ...found.false].map((k) => L.cell(k)).concat(scene.loads.map((l) => l.cell)), low = [0, 1].map((a) => Math.max(0, Math.min(...cells.map((c) => c[a])) - 2)), high = [0, 1].map((a) => Math.min(L.shape[a], Math.max(...cells.map((c) => c[a])) + 3));
    return [low[0], low[1], high[0] - low[0], high[1] - low[1]];
  }
  /** On a phone the part of the body where something happens, as large as it goes. */
  part() { const { page: { canvas, run: { lattice: L } } } = this; return canvas.clientWidth < 520 && L.dimension === 2 && !L.hexagon && L.shape[0] > 12 && this.window()[3] < 0.6 * L.shape[1] ? { window: this.window() } : {}; }
  mark(cell, on) {
    const { page, guess, pen } = this, { lattice: L, kinds } = page.run, k = cell && L.key(cell);
    if (!cell || kinds[k] < 0 || (on && guess[k] === pen) || (!on && !(k in guess))) return;
    if (on) guess[k] = pen; else delete guess[k];
    this.keep(); page.past.note(); page.later();
  }
  show(what) {
    this.shown = what;
    if (what !== "guess" && this.question && this.guessed(this.question)) this.firsts[this.question.key] ??= { ...this.guess };
    this.keep(); this.page.rebuild();
  }
  /** What changes with every picture: counts, what is shut, small pictures. */
  tell() {
    const { page, tally, question: q } = this;
    if (q?.step === "predict" && q.kind !== "cells" && page.g > q.until && !this.teacher && !this.fixed) { this.finish(); page.rebuild(); }   // what has been seen is no guess any more
    if (this.home !== "guess" || !tally?.isConnected) return;
    const found = this.compared(page.g), shown = this.shown === "both";
    for (const kind of ["hit", "miss", "false"]) tally.querySelector(`.${kind} b`).textContent = shown ? found[kind].length : "–";
    for (const [i, canvas] of (this.small ?? []).entries()) {
      const at = i + 1, view = new View(canvas, page.run.lattice, null, { window: this.window(), tight: true });
      canvas.parentNode.ariaPressed = String(at === page.g);
      paintGuess(this, view, at, page.inks, at <= page.g ? this.shown : "guess");
    }
  }
}

/** What was typed as a number in a unit, "α₂ = " or *row* before it or not; of what has none, 1/2 and 50 % are 0.5, and a word may say what is counted. */
const numberIn = (typed, unit, text = typed.replace(/^[^=]*=|^\s*\p{L}{3,}\s+|^\s*[^\x00-\x7f]+(?=\d)/u, ""), [, a, b] = (!(unit && /[%％]/.test(text)) && text.replaceAll(",", ".").match(/^\s*([\d.]+)\s*(?:[/⁄:]\s*([\d.]+)|[%％])\s*$/)) || []) => (a ? a / (b ?? 100) : numberOf(unit ? text.replace(/newtons?$/i, "N").replace(/N\/mm[²2]$/, "MPa") : text.trim().replace(/(\d)\s*(\p{L}{3,}|[^\x00-\x7f]+)$/u, "$1"), unit));
const isRight = ({ answer, tolerance = 0 }, v) => Math.abs(v - answer) <= tolerance * (1 + 1e-9) + 1e-12 * Math.abs(answer);
/** Whether a question may be answered by a drawing on paper. */
const mayDraw = (q) => q.draws && q.kind === "text", drawsBody = (q) => mayDraw(q) && q.draws !== "paper";

/** The body with a guess, with what happened, or both: marks differ in form, never in colour alone. */
function paintGuess(lesson, view, g, inks, what) {
  const { page: { run } } = lesson, { ctx, u } = view, until = what === "guess" ? 0 : g;
  paintCells(view, run.kinds, Float64Array.from(run.spawn, (at) => (at > 0 && at <= until ? 1 : NaN)), { low: 0, high: 1 }, inks, { tone: inks.awake });
  const at = (k) => view.at(...view.centre(run.lattice.cell(k))), r = Math.max(2, 0.33 * u), each = (list, paint) => list.forEach((k) => paint(...at(k), k));
  ctx.lineCap = "round"; ctx.lineJoin = "round";
  if (what === "guess") {
    ctx.textAlign = "center"; ctx.textBaseline = "middle"; ctx.font = `700 ${Math.max(7, Math.min(15, 0.55 * u))}px system-ui, sans-serif`;
    for (const [k, gen] of Object.entries(lesson.guess)) if (u > 12 || gen <= g) {
      const [x, y] = at(Number(k));
      ctx.fillStyle = inks.accent; ctx.beginPath(); ctx.arc(x, y, 1.1 * r, 0, 7); ctx.fill();
      ctx.fillStyle = inks.onaccent; if (u > 9) ctx.fillText(gen, x, y + 0.5);
    }
    return;
  }
  if (what !== "both") return;
  const found = lesson.compared(g);
  each(found.hit, (x, y) => {
    ctx.fillStyle = inks.hit; ctx.beginPath(); ctx.arc(x, y, r, 0, 7); ctx.fill();
    ctx.strokeStyle = inks.onaccent; ctx.lineWidth = Math.max(1, 0.085 * u); ctx.beginPath();
    ctx.moveTo(x - 0.5 * r, y); ctx.lineTo(x - 0.12 * r, y + 0.42 * r); ctx.lineTo(x + 0.52 * r, y - 0.42 * r); ctx.stroke();
  });
  ctx.strokeStyle = inks.miss; ctx.lineWidth = Math.max(1.2, 0.09 * u); ctx.setLineDash([0.55 * r, 0.4 * r]);
  each(found.miss, (x, y) => { ctx.beginPath(); ctx.arc(x, y, 0.8 * r, 0, 7); ctx.stroke(); });
  ctx.setLineDash([]); ctx.strokeStyle = inks.false; ctx.lineWidth = Math.max(1.2, 0.1 * u);
  each(found.false, (x, y) => { const d = 0.58 * r; ctx.beginPath(); ctx.moveTo(x - d, y - d); ctx.lineTo(x + d, y + d); ctx.moveTo(x + d, y - d); ctx.lineTo(x - d, y + d); ctx.stroke(); });
}

MODES.push({
  name: "guess", alone: true,
  offered: (page) => page.lesson?.home === "guess" && page.run.lattice?.dimension === 2,
  tools(page) {
    const { lesson, t } = page, { until } = lesson.question;
    const pens = lesson.shown === "guess" && until > 1 ? [make("span", { className: "soft", textContent: t("timeline") }),
      segments(t("timeline"), lesson.pen, Array.from({ length: until }, (_, i) => [i + 1, String(i + 1)]), (pen) => { lesson.pen = pen; })] : [];
    const change = lesson.shown === "guess" ? button(t("clearTicks"), () => { lesson.guesses[lesson.question.key] = {}; lesson.keep(); page.past.note(); page.later(); })
      : button(t("changeGuess"), () => { lesson.shown = "guess"; page.seek(0); page.rebuild(); });
    return [segments(t("views"), lesson.shown, [["guess", t("myGuess")], ["happened", t("whatHappened")], ["both", t("both")]], (what) => lesson.show(what)), ...pens, make("span", { className: "push" }), change];
  },
  draw(page) {
    const { lesson, run, inks, canvas } = page, view = page.view = new View(canvas, run.lattice, null, { foot: 16, ...lesson.part() });
    if (page.g > 0 && lesson.shown === "guess" && lesson.at >= 0) { lesson.show("both"); return; }
    paintGuess(lesson, view, page.g, inks, lesson.shown);
    paintNumbers(view, inks); page.loads.paint(view);
    if (page.picked >= 0) paintPick(view, run.lattice.cell(page.picked), inks);
    page.parts.cap.textContent = page.told || "";
  },
  press(page, event) {
    const { lesson } = page, cell = page.view.cellAt(event.offsetX, event.offsetY);
    page.hold = { on: lesson.guess[cell ? page.run.lattice.key(cell) : -1] !== lesson.pen };
    if (cell) { page.picked = page.run.lattice.key(cell); page.later(); }
    if (lesson.shown === "guess") lesson.mark(cell, page.hold.on);
    return this.move(page, event);
  },
  move(page, event) {
    const cell = page.view?.cellAt(event.offsetX, event.offsetY), { lesson } = page;
    if (page.hold && event.buttons && lesson.shown === "guess") lesson.mark(cell, page.hold.on);
    page.tip(cell, event, cell ? [stateOfCell(lesson, page.run.lattice.key(cell))] : []);
    return true;
  },
  release: () => true,
  key(page, { key }) {
    const { lesson, picked, run: { lattice: L } } = page;
    if (key !== "Enter" || picked < 0) return false;
    if (lesson.shown === "guess") lesson.mark(L.cell(picked), lesson.guess[picked] !== lesson.pen);
    page.announce(`(${L.cell(picked).join(", ")}): ${stateOfCell(lesson, picked)}`);
    return true;
  },
});

/** A cell in words: awake or asleep, ticked or not, and what that means. */
export function stateOfCell(lesson, k) {
  const { page } = lesson, { t, g, run: { spawn } } = page, tick = lesson.guess[k], ticked = tick ? t("tickedFor", { n: tick }) : t("notTicked");
  if (lesson.shown === "guess") return ticked;
  const awake = spawn[k] > 0 && spawn[k] <= g, word = awake ? t("awakeSince", { n: spawn[k] }) : t("asleepNow"), kind = lesson.kindOf(k, g);
  return lesson.shown === "both" ? `${word}, ${ticked}${kind ? `: ${t(kind)}` : ""}` : word;
}

// --------------------------------------------------------------------------------------- side

export function lessonSide(page) {
  const { lesson, t, parts } = page, { question: q } = lesson;
  lesson.hidden = lesson.step === "predict" && lesson.limit !== Infinity && !Object.keys(lesson.guesses[q.key] ?? {}).length;
  const marked = (name) => name !== "predict" && lesson.of(name).some((q) => q.kind === "number"), kind = (name) => (lesson.done.includes(name) ? (marked(name) ? "tick" : "pen") : "");   // what was only written down is neither right nor wrong
  const face = (name) => make("span", { className: kind(name) }, make("i", {}, kind(name) ? icon(kind(name)) : String(STEPS.indexOf(name) + 1)), t(`step_${name}`));
  const tabs = tabList(page, STEPS, lesson.step, face, (name) => lesson.enter(STEPS.indexOf(name)));
  tabs.classList.add("steps");
  const panel = make("div", { role: "tabpanel", id: `panel-${lesson.step}`, ariaLabel: t(`step_${lesson.step}`) }, ...(q ? questionCards(lesson, q) : lesson.at > 0 ? endCards(lesson) : []), ...stepCards(page));
  if ((q?.show?.curve || !page.touchable) && panel.contains(parts.charts)) panel.querySelector(".fields")?.before(parts.charts);   // in a narrow window: what is read, above where it is written
  if (q?.show?.rod) panel.querySelector(".fields").before(parts.story);   // asked is what its parts do
  const teacher = tick(t(lesson.teacher ? "answersShown" : "answersHidden"), lesson.teacher, (on) => { lesson.teacher = on; page.rebuild(); page.root.querySelector("aside .body").scrollTo(0, 0); }, { role: "switch", className: "switch", ariaLabel: t("teacher") });
  const notes = lesson.teacher && lesson.notes ? [make("details", { className: "card answer", open: lesson.at <= 0 }, make("summary", { textContent: t("plan") }), rendered(page.say(lesson.notes)))] : [];
  const { at, next } = lesson, foot = [make("div", { className: "ends" }, ...(at > 0 ? [button(t("backOne"), () => lesson.visit(at - 1))] : []),
    labelled("print", t("worksheet"), () => print(), { className: "icon" }), make("span", { className: "push" }),
    ...(next ? [button(t(next.word, { step: STEPS[next.step] ? t(`step_${STEPS[next.step]}`) : "" }), () => lesson.leave(next.go), { className: "main" })] : []))];
  return { tabs, body: [...notes, panel, make("details", { className: "card teach", open: lesson.teacher }, make("summary", { textContent: t("teacher") }), teacher, button(t("forget"), ({ target }) => { if (target.textContent === t("forgetSure")) lesson.forget(); else target.textContent = t("forgetSure"); }, { className: "small" }))], foot };
}

/** The unit of what was typed, unless it brings one of its own. */
const unitFor = (text, unit) => (/\d\s*[^\d\s.,]+\s*$/.test(text) ? "" : unit ?? "");

function questionCards(lesson, q) {
  const { page } = lesson, { t } = page, say = (text) => page.say(text);
  const head = make("p", { className: "soft small" }, icon("clock"), t("questionOf", { n: lesson.at + 1, m: lesson.questions.length, t: q.minutes ?? "–" }));
  const list = [head, ...(lesson.intro && q.step === "predict" ? [rendered(say(lesson.intro))] : []), make("h2", { className: "question" }, ...inline(say(q.question)))];
  if (q.note) list.push(rendered(say(q.note)));
  const [guess] = lesson.questions, said = lesson.own(guess);
  if (q.fields && q.pages?.length === 1 && q.pages[0] !== lesson.here) list.push(make("p", { className: "recalled" }, ...inline(t("markedFor", { p: `[${say(lesson.title)}](${q.pages[0]})` }))));
  if (q.recalls && said) list.push(make("p", { className: "recalled", textContent: t("youGuessed", { x: `${said} ${unitFor(said, say(guess.fields?.[0].unit))}` }) }));
  if (q.kind === "cells") list.push(make("div", { className: "card sketch" }, ruleSketch(t, page.start.scene, true)), ...guessCards(lesson, q));
  if (lesson.opens && lesson.keeps && !lesson.teacher && !lesson.guessed(guess)) list.unshift(make("p", { className: "recalled" }, ...inline(t("beginHere", { to: `${lesson.key}.html` }))));   // who came by a link
  if (page.asked.has("moved") && lesson.at === lesson.was) list.unshift(make("p", { className: "recalled", textContent: t("movedHere", { p: say(page.title).split(" · ")[0] }) }));
  lesson.saved = make("small", { className: `saved${lesson.keeps ? "" : " bad"}`, role: "status", textContent: lesson.told });
  lesson.judges = [];
  if (q.kind === "number") {
    const words = q.lines ? textCard(lesson, q, q.fields.length) : [], numbers = make("div", { className: [3, 5, 8].includes(q.fields.length) ? "fields" : "fields pairs" }, ...q.fields.map((field, i) => numberCard(lesson, q, field, i)));
    list.push(...(q.guess ? [...textCard(lesson, q.guess), lesson.saved, numbers, ...words] : [numbers, ...words, lesson.saved]));   // what is said stands by what waits
  }
  else list.push(...(q.kind === "cells" && lesson.shown === "guess" ? [] : textCard(lesson, q)), lesson.saved);   // nothing surprises before it is seen
  if (lesson.fixed) list.push(button(t("changeGuess"), () => { lesson.done = lesson.done.filter((step) => step !== q.step); page.seek(q.until ?? 0); page.rebuild(); }, { className: "small" }));
  if (q.hint) list.push(make("details", { className: "card" }, make("summary", { textContent: t("hint") }), rendered(say(q.hint))));
  if (lesson.teacher && q.answer) list.push(make("div", { className: "card answer" }, make("h3", { textContent: t("answers") }), rendered(say(q.answer))));
  return list;
}

/** In the end, to each question: what was written, and below it what there was to see. An open one shows nothing, a guess waits for those that decide it. */
function endCards(lesson) {
  const { page, page: { t }, questions } = lesson, open = (list) => list.find((q) => !lesson.answered(q)), decided = questions.findLastIndex((q) => q.recalls) + 1 || questions.length;
  const own = (q) => [q.guess, q].filter((one) => one && lesson.own(one)).map((one) => make("p", {}, `${one === q ? t("yourAnswer") : page.say(q.guess.write)}: `, make("em", { textContent: lesson.own(one) })));
  const card = (q, waits) => own(q).concat(q.kind === "cells" && !waits ? answerOf(page, q, true)[0] : [], waits ? button(t("openQuestion", { n: questions.indexOf(waits) + 1 }), () => lesson.visit(questions.indexOf(waits))) : rendered(page.say(q.answer ?? "").split("\n\n")[0]));   // what follows is for the teacher
  return [make("h2", { className: "question", textContent: t("thereWas") }), make("p", { textContent: t("compareHow") }),
    ...questions.map((q, n) => make("section", { className: "card" }, make("h3", {}, `${n + 1}. `, ...inline(page.say(q.question))), ...card(q, open(q.step === "predict" ? questions.slice(0, decided) : [q]))))];
}

/** A field for words; `i`: behind so many numbers. */
function textCard(lesson, q, i) {
  const { page, page: { t } } = lesson, given = lesson.answers[q.key], own = q.kind === "cells" ? t("surprise") : page.say(q.write), label = own || t("yourAnswer");
  const area = make("textarea", { rows: Math.min(6, q.lines ?? 3), maxLength: MOST_LETTERS, readOnly: lesson.fixed, placeholder: t(mayDraw(q) ? "drawOrSay" : "yourAnswer"), value: lesson.said(i === undefined ? given : given?.[i]) ?? "", ariaLabel: label });
  area.oninput = () => lesson.answer(q, area.value, i);
  const add = () => { if (!area.value.includes(t("drawn"))) lesson.answer(q, [area.value.trim(), DRAWN].filter(Boolean).join(" · ")); page.rebuild(); };   // what was written stays
  return [...(own ? [make("h3", {}, ...inline(own))] : []), area, ...(mayDraw(q) && !lesson.fixed ? [button(t("drawn"), add, { className: "small" })] : [])];
}

function numberCard(lesson, q, field, i) {
  const { page } = lesson, { t } = page, label = page.say(field.label) ?? "", unit = page.say(field.unit) ?? "", verdict = make("small", { role: "status" });
  const input = make("input", { type: "text", inputMode: "decimal", className: "field", readOnly: lesson.fixed, value: lesson.answers[q.key]?.[i] ?? "", ariaLabel: `${label} ${unit}`.trim() || t("yourAnswer"), autocomplete: "off" });
  const judge = () => {
    const said = judged(lesson, q, i, input.value.trim()), right = said === t("correct");
    if (said === verdict.textContent) return;
    Object.assign(verdict, { textContent: said, className: right ? "right" : "bad" });
    if (said) verdict.prepend(icon(right ? "tick" : "cross"));
  };
  lesson.judges.push(judge);
  input.oninput = () => { lesson.answer(q, input.value, i); verdict.replaceChildren(); };   // judged when it is left
  input.onchange = input.onblur = () => lesson.judges.forEach((each) => each());   // one answer may tell of another
  judge();
  return make("label", { className: "card" }, make("span", { className: "small soft" }, ...inline(label)), make("span", { className: "typed" }, input, unit), verdict);
}

/** What is said of a number that was typed into a field: also which usual slip it shows, but never where the right one lies. */
function judged(lesson, q, i, text) {
  const { page, page: { t } } = lesson, field = q.fields[i], unit = page.say(field.unit) ?? "", asked = page.say(field.read_in) || unit, v = numberIn(text, unit);
  if (!text) return "";
  if (Number.isNaN(v)) return t(!/\d/.test(text) ? "noNumber" : asked && /\p{L}/u.test(text) ? "notIn" : "bareNumber", { u: asked });
  if (q.step === "predict") return "";
  if (isRight(field, v)) return t("correct");
  const off = Math.abs(v - field.answer), digits = text.replace(/^[^=]*=|\D*$/g, "").replace(/^[\s0.,−-]+|\D/g, "");
  if ((!q.rounds || digits.length > 1) && off < 0.4 * Math.abs(field.answer) && off <= 0.5000001 * Math.abs(v) / Number(digits)) return t("moreDigits");   // rounded well, but too far: to half a step of its last digit
  if (q.fields.some((other, j) => j !== i && isRight(other, v) && isRight(field, lesson.number(q, j)))) return t("exchanged");
  if (unit === "%" && !/[%％]/.test(text) && isRight(field, 100 * v)) return t("notIn", { u: t("percent") });
  if (!unit && Math.abs(field.answer) < 1 && isRight(field, v / 100)) return t("asShare");
  if (unit && field.answer && [0.001, 1000, ...(unit.includes("cm") ? [0.01, 100] : [])].some((f) => isRight(field, f * v))) return t("checkUnit", { u: unit });
  const run = page.presets[field.of];          // the one that its number is read from
  if (run && !page.isAs(run)) return `${t("lookAgain")} · ${t("markedFor", { p: page.nameOf(run) })}`;
  return t("lookAgain") + (field.tolerance > 0 && field.tolerance === Number(field.tolerance.toPrecision(2)) && !q.rounds && off < 2 * field.tolerance ? ` · ${t("within", { e: `${general(field.tolerance, 2)}${unit === "%" ? ` ${t("points")}` : ""}` })}` : "");
}

function guessCards(lesson, q) {
  const { page } = lesson, { t } = page, box = (kind, name) => make("div", { className: `card ${kind}` }, icon(name), make("b", { textContent: "–" }), make("span", { textContent: t(kind) }), make("small", { textContent: t(`${kind}Means`) }));
  lesson.tally = make("div", { className: "tally", role: "status" }, box("hit", "tick"), box("miss", "ring"), box("false", "cross"));
  lesson.small = q.until > SMALL ? [] : Array.from({ length: q.until }, (_, i) => make("canvas", { className: "small" }));
  const pictures = lesson.small.map((canvas, i) => make("button", { type: "button", onclick: () => page.seek(i + 1) }, canvas, make("small", { textContent: t("upTo", { g: i + 1 }) })));
  return [lesson.tally, ...(pictures.length ? [make("div", { className: "card pictures" }, ...pictures)] : [])];
}

/** What a step brings besides its questions. */
function stepCards(page) {
  const { lesson, t, parts, touchable } = page, panels = panelsOf(page), fold = (word, list, open = false) => make("details", { className: "card", open }, make("summary", { textContent: word }), ...list);
  const about = panels.about ? [fold(t("about"), panels.about())] : [], look = fold(t("look"), panels.look()), cards = [cardsBox(page)], alone = page.mode?.alone && page.look.mode !== "guess";
  const free = page.limit === Infinity, code = panels.code ? [fold(t("code"), panels.code(), true)] : [], story = alone ? [] : [storyCard(page)], charts = free || !touchable ? [parts.charts] : [];
  if (lesson.step === "predict") return lesson.secret ? [] : [...about, ...cards];
  if (!touchable && lesson.wide.matches) { page.stageBox.append(...charts.splice(0)); page.stageBox.classList.toggle("low", page.sides[0] > 1.6 * page.sides[1]); }   // curves to be read stand beside the picture, so that the fields are in reach
  parts.presets = page.presets.map((preset) => button(page.nameOf(preset), () => { const { generation = 0, mode } = lesson.question?.show ?? {}; if (!lesson.limit) { lesson.ask(); return; } page.load(preset); page.seek(Math.min(generation, lesson.limit)); if (mode) page.setMode(mode, true); }));
  const { fields, show: { rule: typed, sentence, curve, own, preset: its } = {} } = lesson.question ?? {}, [marked, other] = new Set(fields?.map(({ of }) => of)), few = (open) => fold(t("rule"), rulePanel(page, true), open), read = typed || curve || !touchable ? charts.splice(0) : [];   // below a question stands what is asked for
  const tries = touchable && page.presets.length > 1 ? [...(marked === undefined || other !== undefined ? [] : [make("small", { className: "soft", textContent: t("markedFor", { p: page.nameOf(page.presets[marked]) }) })]), make("div", { className: "presets" }, ...page.presets.flatMap((preset, n) => own && n !== its ? [] : make("div", {}, parts.presets[n], ...(page.say(preset.note) ? [rendered(page.say(preset.note))] : []))))] : [];
  const near = [...(sentence ? [parts.verdict] : []), ...(typed || sentence ? [few(true)] : []), ...(typed ? read.splice(0) : [])], first = [...near, ...tries, ...code, ...cards, ...read, ...story, ...about];
  if (lesson.step === "step") return [...first, ...(touchable && !near.length && !page.studio ? [few(false)] : []), look];
  const rest = lesson.step === "try" ? ["rule", "draw"].filter((name) => panels[name] && (name === "draw" || !near.length)).map((name) => fold(t(name), panels[name]())) : [];
  return [...first, ...(free && !sentence ? [parts.verdict] : []), ...rest, ...charts, look];
}

// ----------------------------------------------------------------------------------- on paper

/** The sheet stands beside the page and is seen on paper only. */
export function laySheet(page) {
  const { root, lesson } = page;
  root.querySelector(".sheet")?.remove();
  if (lesson) root.append(make("div", { className: "sheet", lang: page.language }, ...paperOf(page)));
}

function paperOf(page) {
  const { lesson, t } = page, line = (word, size) => make("span", {}, `${word} `, make("i", { className: `blank ${size}` }));
  const head = make("div", { className: "top" }, make("div", {}, make("h1", { textContent: page.say(lesson.title) }), make("p", { textContent: [t("worksheet"), lesson.minutes && t("minutes", { t: lesson.minutes }), loadWords(page.start)].filter(Boolean).join(" · ") })),
    make("div", { className: "who" }, line(t("name"), "long"), make("div", {}, line(t("course"), "short"), " ", line(t("date"), "short"))));
  const questions = lesson.questions.flatMap((q, i) => {
    const drawing = drawsBody(q) ? [bodyOf(page, q)] : [], wide = drawing[0]?.classList.contains("wide");
    return [...(wide ? [] : drawing), make("section", {}, make("b", { className: "number", textContent: i + 1 }),
      make("div", { className: "asked" }, make("p", {}, make("span", {}, ...inline(page.say(q.question))), make("small", { textContent: q.minutes ? t("minutes", { t: q.minutes }) : "" })), ...(q.note ? [rendered(page.say(q.note))] : []), ...(wide ? drawing : []), ...(q.show?.rod ? [page.rod(0)[0]] : []), ...answerOf(page, q)))];
  });
  const foot = make("div", { className: "bottom" }, make("span", { textContent: `kaju · ${page.say(lesson.title)}` }), make("span", { textContent: lesson.kept ? t("asSaved", { d: new Date().toLocaleDateString(page.language, { dateStyle: "long" }) }) : "" }));
  const answers = lesson.teacher ? [make("div", { className: "teachers" }, make("h1", { textContent: `${t("answers")}: ${page.say(lesson.title)}` }),
    ...(lesson.notes ? [rendered(page.say(lesson.notes))] : []),
    ...lesson.questions.map((q, i) => make("section", {}, make("b", { className: "number", textContent: i + 1 }), make("div", { className: "asked" }, ...solution(page, q)))))] : [];
  return [head, ...(lesson.intro ? [rendered(page.say(lesson.intro))] : []), ...(page.start?.scene.rule?.kind === "prescribed" ? [ruleBox(t, (page.presets[lesson.questions[0].show?.preset] ?? page.start).scene, !/[αβν]/.test(JSON.stringify(lesson.questions)))] : lesson.questions.some(drawsBody) ? [] : [bodyOf(page)]), ...questions, foot, ...answers];
}

function loadWords({ scene } = {}) {
  const sizes = (scene?.loads ?? []).map((l) => quantity(Math.hypot(...l.force), "N")), unlike = [...new Set(sizes)].slice(0, 3), times = (n) => (n > 1 ? `${n} × ` : "");
  return sizes.length ? [...unlike.map((size) => times(sizes.filter((other) => other === size).length) + size), scene.rule.threshold && `γ = ${quantity(scene.rule.threshold, "N")}`].filter(Boolean).join(", ") : "";
}
const solution = (page, q) => [make("p", { textContent: (q.fields ?? []).map((f) => `${page.say(f.label) ?? ""}: ${local(f.key ?? String(f.answer))} ${page.say(f.unit) ?? ""}`).join(" · ") }), ...(q.answer ? [rendered(page.say(q.answer))] : [])];

/** What has been answered, in italics; lines where nothing has. `open`: what happened is no secret any more. */
function answerOf(page, q, open) {
  const { lesson, t } = page, given = lesson.answers[q.key], lines = (n) => Array.from({ length: n }, () => make("div", { className: "ruled" }));
  const written = lesson.said(q.kind === "number" ? given?.[q.fields.length] : given), text = written?.trim() ? [make("p", { className: "given", textContent: written })] : null;
  if (q.kind === "number") {
    const table = make("table", {}, make("tr", {}, ...q.fields.map((f) => make("th", {}, page.say(f.label) ?? ""))),
    make("tr", {}, ...q.fields.map((f, i) => make("td", {}, make("em", { textContent: given?.[i] ?? "" }), ` ${unitFor(given?.[i], page.say(f.unit))} ${lesson.sign(q, i)}`))));
    const words = [...(q.write ? [make("p", {}, ...inline(page.say(q.write)))] : []), ...(q.lines ? text ?? lines(q.lines) : [])];
    return [...(q.guess ? [make("p", { className: "before" }, `${page.say(q.guess.write)} `, make("em", { textContent: lesson.own(q.guess) }))] : []), make("div", { className: "worked" }, table, make("div", {}, ...words)), ...(!q.draws ? [] : Array.isArray(q.draws[0]?.[0]) ? [make("div", { className: "plots" }, ...q.draws.map((ends) => axes(page, ends)))] : [axes(page, q.draws)])];
  }
  if (q.kind !== "cells" || page.run.lattice?.dimension !== 2) return text ?? lines(drawsBody(q) ? 1 : q.lines ?? 3);
  const guess = lesson.guesses[q.key] ?? {}, first = lesson.firsts[q.key], spawned = {}, { scene, cells = page.start.cells } = page.presets[q.show?.preset ?? 0];
  const run = page.touchable ? new Twin(scene, cells).run(q.until) : page.run, known = { run, scene };   // the question's own, whatever is loaded now
  run.lattice.each((k) => { if ((first || open) && run.spawn[k] > 0 && run.spawn[k] <= q.until) spawned[k] = run.spawn[k]; });
  return [make("div", { className: "grids" }, grid(known, t("myGuess"), first ?? guess, { ...guess, ...spawned }), grid(known, t("whatHappened"), spawned, { ...guess, ...spawned })), make("p", { textContent: t("surprise") }), ...(text ?? lines(1))];
}

/** The body as it begins, or as a question shows it, to draw on: questions stand beside it unless it is wide. */
function bodyOf(page, q) {
  const { lesson } = page, sheet = page.unmarked(page.presets?.[q?.show?.preset ?? 0], q?.draws === "ground"), kept = lesson.keeps && q?.pages?.includes(lesson.here) === false && localStorage.getItem(lesson.drawing(q));
  return make("img", { className: `drawn${!q ? "" : sheet.width > 1.6 * sheet.height ? " wide" : " large"}`, alt: "", src: kept || sheet.toDataURL() });
}

/** Two axes to draw a curve at: bare, or to the right and upwards from where to where, with lines between; each has a unit, or what a run goes along. */
function axes({ t }, ends) {
  const given = Array.isArray(ends), [[x, left, right], [y, low, high], height = 152] = given ? ends : [["", 0, 1], ["", 0, 1]], bottom = height - 20, named = t(`along_${x}`, { otherwise: "" });
  const X = (v) => 80 + 320 * (v - left) / (right - left), Y = (v) => bottom - (bottom - 14) * (v - low) / (high - low), zero = X(Math.max(0, left));
  const word = (v, unit, last, at) => draw("text", { "font-size": 12, ...at }, `${local(String(v)).replace("-", "−")}${v === last ? ` ${unit}` : ""}`), told = (list, unit, at) => list.map((v) => word(v, unit, list.at(-1), at(v)));
  const across = given ? ticksOf(left, right, 10) : [], up = given ? ticksOf(low, high, bottom / 26).filter((v) => v !== low) : [];
  return draw("svg", { viewBox: `0 0 420 ${height + (named && 16)}`, width: 420, height, class: height > 152 ? "tall" : "", "aria-hidden": "true" }, draw("path", { d: `${across.map((v) => `M${X(v)} ${bottom}V14`).join("")}${up.map((v) => `M80 ${Y(v)}H400`).join("")}`, fill: "none", stroke: "#c4cad0" }),
    draw("path", { d: `M${zero} ${bottom + 6}V4m-4 8l4 -8l4 8M8 ${bottom}H412m-8 -4l8 4l-8 4${across.map((v) => `M${X(v)} ${bottom}v5`).join("")}${up.map((v) => `M${zero} ${Y(v)}h-5`).join("")}`, fill: "none", stroke: "#000" }),
    ...told(across, named ? "" : x, (v) => ({ x: X(v), y: bottom + 18, "text-anchor": "middle" })), ...told(up, t(`along_${y}`, { otherwise: y }), (v) => ({ x: zero - 8, y: Y(v) + 4, "text-anchor": "end" })), draw("text", { x: 400, y: bottom + 34, "text-anchor": "end", "font-size": 12 }, named));
}

/** The part of the body round the loads, with a number in every cell that has one. */
function grid({ run: { lattice: L, kinds }, scene }, title, numbers, all) {
  const u = 15, at = scene.loads.map((l) => l.cell).concat(Object.keys(all).map((k) => L.cell(Number(k))));
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

/** The rule in one cell, drawn: its shares by name, or as numbers where a question says them so. */
function ruleSketch(t, { rule, materials: [material] }, numbers) {
  const { own, forward, friction, poisson } = sharesOf(rule, material, 2), share = (name, v) => `${numbers ? `${general(v, 3)} ` : name}P`;
  const svg = draw("svg", { viewBox: "0 3 280 154", width: 280, height: 154, role: "img", "aria-label": t("cell") });
  const word = (x, y, text, anchor = "start") => svg.append(draw("text", { x, y, "text-anchor": anchor, "font-size": 12 }, text));
  const shaft = (d, dashed) => svg.append(draw("path", { d, fill: "none", stroke: "#000", "stroke-width": 1.8, ...(dashed ? { "stroke-dasharray": "3 3" } : {}) }));
  svg.append(draw("rect", { x: 100, y: 50, width: 80, height: 72, fill: "#d5dade", stroke: "#000" }), draw("rect", { x: 100, y: 46, width: 80, height: 80, fill: "none", stroke: "#000", "stroke-dasharray": "3 3" }));
  shaft("M140 4V42M135 34L140 42L145 34"); word(152, 18, `P ${t("comesIn")}`);
  shaft("M140 126V156M135 148L140 156L145 148"); word(152, 150, `${t("ahead")} ${share("α₂", forward)}`);
  if (friction) { shaft("M82 66V104M77 96L82 104L87 96"); word(72, 92, share("α₃", friction), "end"); shaft("M198 66V104M193 96L198 104L203 96"); word(210, 92, share("α₃", friction)); }
  if (rule.beta !== 1) { shaft("M98 56H56M64 51L56 56L64 61", true); word(4, 42, share("(1−β)να₁", poisson)); shaft("M182 56H224M216 51L224 56L216 61", true); word(196, 42, share("(1−β)να₁", poisson)); }
  word(140, 84, t("keeps"), "middle"); word(140, 102, share("α₁", own), "middle");
  return svg;
}

/** On paper the rule stands in words, too, with all its numbers. */
function ruleBox(t, scene, numbers) {
  const { rule, materials: [material] } = scene, { own, forward, friction, poisson, beta } = sharesOf(rule, material, 2);
  const threshold = `γ = ${quantity(rule.threshold, "N")}`, words = `${rule.accumulate ? t("addsUp") : ""}${t("ruleInWords")}${friction ? t("ruleSides") : ""}${rule.sense ? t("rulePulls") : ""}${beta === 1 ? "" : t("ruleWidens")}`;
  const values = Object.entries({ "α₁": own, "α₂": forward, ...(friction ? { "α₃": friction } : {}), ...(beta === 1 ? {} : { "β": beta, "ν": material.poissons_ratio, "(1−β)να₁": poisson }) }).map(([name, v]) => `${name} = ${general(v, 4)}`).join(", ");
  const told = numbers ? words.replace(/α([₁₂₃])P/g, (_, n) => `${general([own, forward, friction]["₁₂₃".indexOf(n)], 3)} P`) : words;
  return make("div", { className: "rulebox" }, ruleSketch(t, scene, numbers), make("div", {}, make("h2", { textContent: t("cell") }), make("p", { textContent: told }), make("p", { textContent: numbers ? threshold : `${values}, ${threshold}` })));
}
