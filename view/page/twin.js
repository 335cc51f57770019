// The rule and elasticity, side by side or under a divider: one quantity, one colour scale, one
// magnification, one cursor; their difference; and a ruler that reads the profiles of both.
import { ticksOf } from "./charts.js";
import { button, draw, make, MODES, picker, segments } from "./controls.js";
import { cornersOf } from "./deformation.js";
import { RIGID, ROLLER } from "./lattice.js";
import { FONT, paintCells, paintLegend, paintNumbers, paintPick, paintWord, View } from "./paint.js";
import { hand } from "./scene.js";
import { general, largest, local, quantity, roundDown } from "./words.js";

const NOTHING = 1 / 400, SHADES = 4;              // of a scale: what looks like nothing; steps of a difference below and above it
const footOf = (page) => (page.lesson || settings(page).ruler ? 64 : 48);   // room for the numbers of columns
const settings = ({ look }) => (look.twin?.layout ? look.twin : (look.twin = { show: "along", layout: "swipe", split: null, ruler: null, ...look.twin }));   // a lesson names some

/** Both answers at this generation, and the ends and the magnification that both are drawn with. */
export function bothOf(page, show = settings(page).show) {
  const { run, look } = page, { elasticity: answer } = page, L = run.lattice, unit = BOTH[show];
  const ruled = () => fieldsOf(run, page.deformed().pressure, page.deformed().displacement);
  if (answer) answer.fields ??= fieldsOf(run, answer.stress.slice(0, L.dimension).map((s) => s.map((x) => -x)), answer.displacement);
  if (!page.scales.has("twin")) {              // from the end of the run, so that generations compare
    const keep = page.g, ends = {};
    page.goTo(Infinity);
    // loads beyond all bounds would make elasticity look like nothing
    for (const [name, values] of Object.entries(ruled())) ends[name] = Math.max(largest(run.grown && answer && name !== "move" ? [] : values), largest(answer?.fields[name] ?? [])) || 1;
    page.goTo(keep);
    page.scales.set("twin", ends);
  }
  const ends = page.scales.get("twin"), high = ends[show], log = unit !== "m";
  const factor = look.deformed ? roundDown(10 ** look.magnify * 0.066 * Math.max(...L.shape) * L.h / ends.move) : 0;
  return { quantity: show, unit, factor, scale: { low: log ? high * NOTHING : 0, high, log, beyond: run.grown && answer }, small: high * NOTHING, rule: ruled()[show], elastic: answer?.fields[show] ?? null };
}

/** What the rule's cells show: all agents have a colour, those too that loads across have woken. */
export const agentsOf = ({ run: { spawn }, g }, { rule, small }) => rule.map((v, k) => (Math.abs(v) > small ? Math.abs(v) : spawn[k] > 0 && spawn[k] <= g ? small : NaN));

function paintAnswer(page, canvas, name, both) {
  const { run, look, inks, t } = page, { lattice: L, kinds } = run, { scale, small, factor, unit } = both, values = both[name];
  const u = name === "rule" ? page.deformed().displacement : page.elastic.answer.displacement;
  const moved = factor ? { displacement: u, corners: L.dimension === 2 ? cornersOf(L, kinds, u) : null } : null;
  const view = new View(canvas, L, look.camera, { foot: footOf(page) });
  paintCells(view, kinds, name === "rule" ? agentsOf(page, both) : values.map((v) => (Math.abs(v) > small ? Math.abs(v) : NaN)), scale, inks, { moved, factor, cut: L.dimension === 3 ? look.cut : null });
  if (L.dimension === 2 && view.u >= 9) L.each((k) => { if (values[k] < -small) paintWord(view.ctx, "−", ...view.at(...L.cell(k).map((c) => c + 0.5)), inks.ink, inks, { align: "center" }); });
  if (name === "elastic") canvas.ariaLabel = `${t("elastic")}: ${t(both.quantity)}`;
  if (name === "rule" || !page.twin.elastic.classList.contains("over")) paintLegend(view, scale, `${t(both.quantity)}${unit === "N" && view.w > 430 ? ` (${t("pullMark")})` : ""}`, t(scale.log ? "log" : "linear"), (v) => quantity(v, unit), inks);
  page.drawnWith.push({ answer: name, quantity: both.quantity, unit, scale, factor });
  return view;
}

/** The rule less elasticity in steps, as far apart as on the common scale: what is small there looks like nothing, in both directions alike. */
export function stepsOf({ rule, elastic, small, scale }) {
  const gap = rule.map((v, k) => v - elastic[k]), most = Math.max(largest(gap), small * 2);
  const part = (size) => (scale.log ? Math.log(size / small) / Math.log(most / small) : size / most);
  return { gap, most, steps: gap.map((d) => (Math.abs(d) <= small ? 0 : Math.sign(d) * Math.min(SHADES, 1 + Math.floor(SHADES * part(Math.abs(d)))))) };
}
function paintDifference(page, canvas, both) {
  const { run, look, inks, t } = page, { lattice: L, kinds } = run, { steps, most } = stepsOf(both), view = new View(canvas, L, look.camera, { foot: footOf(page) }), scale = { low: -4.5, high: 4.5, log: false };
  paintCells(view, kinds, steps.map((s) => s || (s === 0 ? 1e-9 : NaN)), scale, inks, { cut: L.dimension === 3 ? look.cut : null });
  canvas.ariaLabel = `${t("less")}: ${t(both.quantity)}`;
  paintLegend(view, scale, t("less"), t(both.scale.log ? "log" : "linear"), null, inks, [[scale.low, quantity(-most, both.unit)], [0, both.scale.log ? `± ${quantity(both.small, both.unit)}` : "0"], [scale.high, quantity(most, both.unit)]]);
  return view;
}

// -------------------------------------------------------------------------------------- ruler

/** What lies under the ruler: keys and places (m), both profiles with largest value and half width, the force through it. */
export function profileOf(page, both) {
  const { run, look } = page, { ruler } = look.twin, { h } = run.lattice, { keys, at } = cellsOn(run, ruler), places = at.map((x) => x * h), { axis } = loadAxis(run.scene);
  const told = (values) => { if (!values) return null; const list = keys.map((k) => values[k]); return { list, largest: list.length ? Math.max(...list) : 0, half: halfWidth(places, list) }; };
  const through = (values) => (values && both.quantity === "along" && ruler.axis !== axis ? cutsOf(run, values).find((cut) => cut.at === ruler.at)?.carried ?? 0 : null);
  return { keys, at: places, rule: { ...told(both.rule), through: through(both.rule) }, elastic: both.elastic && { ...told(both.elastic), through: through(both.elastic) } };
}
function csvOfRuler(page) {
  const both = bothOf(page), { keys, at, rule, elastic } = profileOf(page, both), { lattice: L } = page.run, name = `${both.quantity} (${both.unit})`;
  const rows = keys.map((k, i) => [at[i], ...L.cell(k).map((c) => (c + 0.5) * L.h), rule.list[i], elastic?.list[i] ?? ""].join(","));
  return [`distance (m),x (m),y (m),rule ${name},elasticity ${name}`, ...rows].join("\n") + "\n";
}
function paintRuler(page, view) {
  const { ctx } = view, { inks, look: { twin: { ruler: { axis, at } } } } = page, [a, b] = [0, view.lattice.shape[axis]].map((end) => view.at(...(axis ? [at + 0.5, end] : [end, at + 0.5])));
  for (const [ink, width] of [[inks.paper, 5], [inks.ink, 2]]) {
    ctx.strokeStyle = ink; ctx.lineWidth = width; ctx.beginPath(); ctx.moveTo(...a); ctx.lineTo(...b); ctx.stroke();
    for (const p of [a, b]) { ctx.beginPath(); ctx.arc(...p, 6, 0, 7); ctx.stroke(); if (width < 5) { ctx.fillStyle = inks.paper; ctx.fill(); } }
  }
}
/** The ruler is moved; it snaps to rows and columns. */
function rulerTo(page, at) {
  const { look: { twin: { ruler } }, run: { lattice: { shape } } } = page;
  ruler.at = Math.max(0, Math.min(shape[1 - ruler.axis] - 1, at));
  page.later();
}
const lay = (page, { offsetX, offsetY }, { x0, y0, u } = page.view) => rulerTo(page, Math.floor((page.look.twin.ruler.axis ? offsetX - x0 : y0 - offsetY) / u));

/** Both profiles over the length of the ruler, as a drawing: solid and dots, dashed and squares, half widths marked. */
function profileChart(page, both, { at, rule, elastic }) {
  const { t } = page, [w, h, x, y] = [340, 170, 46, 20], lists = [rule, elastic].filter(Boolean), top = Math.max(0, ...lists.map((l) => l.largest)) || both.scale.high, low = Math.min(0, ...lists.flatMap((l) => l.list));
  const end = Math.max(...at, page.run.lattice.h), X = (s) => x + (w - x - 12) * s / end, Y = (v) => y + (h - y - 24) * (top - v) / (top - low), parts = [];
  for (const v of ticksOf(low, top, 3)) parts.push(draw("path", { class: "hair", d: `M${x} ${Y(v)}H${w - 12}` }), draw("text", { x: x - 4, y: Y(v) + 4, "text-anchor": "end" }, quantity(v, both.unit)));
  for (const s of ticksOf(0, 100 * end, 4)) parts.push(draw("text", { x: X(s / 100), y: h - 6, "text-anchor": "middle" }, `${s}${s ? "" : " cm"}`));
  lists.forEach(({ list, half }, n) => {
    const name = n ? "elastic" : "rule";
    parts.push(draw("polyline", { class: name, points: list.map((v, i) => `${X(at[i])},${Y(v)}`).join(" ") }));
    parts.push(...list.map((v, i) => (n ? draw("rect", { class: name, x: X(at[i]) - 2.5, y: Y(v) - 2.5, width: 5, height: 5 }) : draw("circle", { class: name, cx: X(at[i]), cy: Y(v), r: 2.5 }))));
    if (half) parts.push(draw("path", { class: `${name} bracket`, d: `M${X(half.low)} ${Y(half.half) - 5}v10m0 -5H${X(half.high)}m0 -5v10` }));
  });
  return draw("svg", { class: "chart", viewBox: `0 0 ${w} ${h}`, role: "img", "aria-label": `${t(both.quantity)}: ${t("theRule")}, ${t("elastic")}` }, draw("text", { x: 0, y: 12 }, `${t(both.quantity)}`), ...parts);
}
function rulerCard(page, both) {
  const { t, look: { twin: { ruler } }, run: { lattice: { h, shape } } } = page, profile = profileOf(page, both), { rule, elastic } = profile;
  const title = t(ruler.axis ? "columnAt" : "rowAt", { n: ruler.at, c: t("inCells", { n: local(String(ruler.axis ? ruler.at + 0.5 : shape[1] - ruler.at - 0.5)) }), side: t(ruler.axis ? "left" : "top") });
  const wide = ({ half, largest }) => (half ? `${general(100 * half.width, 3)} cm (${t("inCells", { n: general(half.width / h, 3) })})` : largest > 0 ? t("widest") : "–"), known = [["theRule", "rule", rule], ["elastic", "elastic", elastic]].filter(([, , one]) => one);
  const row = (word, show) => make("tr", {}, make("th", { scope: "row", textContent: t(word) }), ...known.map(([, className, one]) => make("td", { className, textContent: show(one) })));
  const table = make("table", {}, make("tr", {}, make("td"), ...known.map(([word, className]) => make("th", { scope: "col", className, textContent: t(word) }))),
    row("largestValue", (one) => quantity(one.largest, both.unit)), row("halfWidth", wide), ...(rule.through === null ? [] : [row("throughIt", (one) => quantity(one.through, "N"))]));
  page.ruled = `${title} · ${t("halfWidth")}: ${known.map(([word, , one]) => `${t(word)} ${one.half ? t("inCells", { n: general(one.half.width / h, 3) }) : "–"}`).join(", ")}`;
  return [make("h2", { textContent: title }), table, profileChart(page, both, profile)];
}
/** Its buttons stand beside what every picture writes anew: a click on what is replaced would be lost. */
function rulerTools(page) {
  const { t, look, run: { lattice: { shape } } } = page, turn = () => { const axis = 1 - look.twin.ruler.axis; look.twin.ruler = { axis, at: shape[1 - axis] >> 1 }; page.past.note(); page.later(); };
  const save = () => page.announce(t("saved", { name: hand("ruler.csv", new Blob([csvOfRuler(page)], { type: "text/csv" })) }));
  return make("div", { className: "tools" }, button(t("saveProfile"), save), button(t("turnRuler"), turn));
}

// --------------------------------------------------------------------------------------- mode

function numbersCard(page, both, k) {
  const { t, run: { lattice: L, kinds }, elastic: { why, old }, elasticity: answer } = page, lines = [];
  if (k >= 0 && kinds[k] >= 0) lines.push(`${t("cellOf", { c: `(${L.cell(k).join(", ")})` })}: ${linesAt(page, both, k).join(", ")}`);
  if (!answer) lines.push(...(page.ruleAlone ? [] : [why ? t("noAnswer", { why }) : t("solving")]));
  else if (!page.lesson) {                     // there it would tell what is asked
    const { displacement: mine } = page.deformed(), theirs = answer.displacement;
    let sum = 0, count = 0, own = 0, high = 0;
    L.each((i) => {
      if (kinds[i] < 0) return;
      sum += Math.hypot(...mine.map((u, a) => u[i] - theirs[a][i])); count++;
      own = Math.max(own, Math.hypot(...mine.map((u) => u[i]))); high = Math.max(high, Math.hypot(...theirs.map((u) => u[i])));
    });
    lines.push(...(page.run.grown ? [t("grown")] : [t("twinSee") + (page.twin.gap.hidden ? "" : t("gapSee")), t("misfit", { a: quantity(own, "m"), b: quantity(high, "m"), n: general(100 * sum / count / (high || 1), 2) })]), old ? t("solving") : t("solvedIn", { n: general(answer.seconds, 2) }));
    if (page.g < page.run.generation) lines.push(t("noTime"));
  }
  return lines.map((text) => make("p", { textContent: text }));
}
const linesAt = ({ t }, { rule, elastic, unit }, k) => [`${t("theRule")} ${quantity(rule[k], unit)}`, ...(elastic ? [`${t("elastic")} ${quantity(elastic[k], unit)}`, `${t("less")} ${quantity(rule[k] - elastic[k], unit)}`] : [])];

/** Both answers in a cell, for a caption. */
export const readingAt = (page, both, k) => `(${page.run.lattice.cell(k).join(", ")}): ${linesAt(page, both, k).slice(0, 2).join(", ")}`;
/** The key of the body's cell under a pointer, or -1; a tip tells both answers in it. */
export function cellUnder(page, event, view, show) {
  const cell = view?.cellAt?.(event.offsetX, event.offsetY), { lattice: L, kinds } = page.run, k = cell ? L.key(cell) : -1, inside = kinds[k] >= 0;
  event.target.parentElement.append(page.parts.tip);
  page.tip(inside ? cell : null, event, inside ? linesAt(page, bothOf(page, show), k) : []);
  page.later();
  return inside ? k : -1;
}
const hover = (page, event, view) => { page.twin.at = cellUnder(page, event, view); };

MODES.push({
  name: "twin", letter: "r",
  offered: (page) => page.comparable && (!page.ruleAlone || page.lesson.question.show.mode === "twin"),
  open(page) {
    const main = page.canvas.parentElement, box = () => make("div", {}, make("canvas", { role: "img" }));
    const twin = page.twin = { at: -1, elastic: box(), gap: box(), line: make("span", { className: "soft" }), profile: make("div"), numbers: make("section", { className: "card", role: "status" }),
      handle: make("div", { className: "divider", role: "slider", tabIndex: 0, ariaLabel: page.t("divider"), ariaValueMin: 0 }) };
    const split = (x) => { settings(page).split = Math.max(0, Math.min(page.run.lattice.shape[0], x)); page.later(); };
    twin.handle.onpointerdown = (event) => { twin.handle.setPointerCapture(event.pointerId); twin.held = event.clientX; };
    twin.handle.onpointermove = (event) => { if (event.buttons) split((event.clientX - main.getBoundingClientRect().left - page.view.x0) / page.view.u); };
    twin.handle.onclick = ({ clientX, clientY }) => { const { left, top } = main.getBoundingClientRect(); if (Math.abs(clientX - twin.held) < 4) { twin.at = -1; page.touch(page.view.cellAt(clientX - left, clientY - top)); } };   // not drawn: the cell below is meant
    twin.handle.onkeydown = (event) => {
      const to = { ArrowLeft: Math.ceil(settings(page).split) - 1, ArrowRight: Math.floor(settings(page).split) + 1, Home: 0, End: Infinity }[event.key];
      if (to !== undefined) { split(to); event.preventDefault(); event.stopPropagation(); }
    };
    for (const name of ["elastic", "gap"]) {
      const canvas = twin[name].firstChild;
      canvas.onpointermove = (event) => hover(page, event, twin.views?.[name]);
      canvas.onpointerleave = () => { page.parts.tip.hidden = true; twin.at = -1; page.later(); };
      new ResizeObserver(() => page.later()).observe(canvas);
    }
    main.append(twin.handle); page.stageBox.append(twin.elastic, twin.gap);
    askElastic(page);
  },
  close(page) {
    page.canvas.parentElement.append(page.parts.tip);
    for (const name of ["elastic", "gap", "handle"]) page.twin?.[name].remove();
  },
  changed: askElastic,
  /** The ruler is laid, or taken away. */
  called(page) {
    const two = settings(page);
    two.ruler = two.ruler || page.solid ? null : { axis: 0, at: Math.floor(0.83 * page.run.lattice.shape[1]) };
    page.past.note(); page.refresh();
  },
  tools(page) {
    const { t, look, lesson } = page, two = settings(page), put = (part) => { look.twin = Object.assign(two, part); page.past.note(); page.refresh(); };
    const narrow = page.solid || page.stageBox?.clientWidth <= 560, free = !lesson || (lesson.step === "try" && !narrow), shown = Object.keys(BOTH).filter((name) => name !== "across" || page.run.lattice.dimension === 2).map((name) => [name, t(name)]);
    return [...(narrow || page.ruleAlone ? [] : [segments(t("views"), two.layout, [["swipe", t("swipe")], ["beside", t("sideBySide")]], (layout) => put({ layout }))]), ...(free ? [picker(t("colour"), two.show, shown, (show) => put({ show }))] : []),   // a question says itself what is read
      ...(page.solid || page.ruleAlone || (narrow && lesson?.question?.show?.look?.twin?.ruler) ? [] : [button(t("ruler"), () => this.called(page), { ariaPressed: String(Boolean(two.ruler)) })]), ...(two.ruler ? [-1, 1].map((way) => button((two.ruler.axis ? "◀▶" : "▼▲")[(way + 1) / 2], () => { rulerTo(page, two.ruler.at + way); page.past.note(); }, { title: t(way < 0 ? "rulerBack" : "rulerOn"), ariaLabel: t(way < 0 ? "rulerBack" : "rulerOn") })) : []),
      ...(free ? [button(t("shape"), () => { look.deformed = !look.deformed; put({}); }, { ariaPressed: String(look.deformed) })] : []), page.twin?.line ?? ""];
  },
  cards: (page) => (page.twin ? [page.twin.card = make("section", { className: "card", hidden: true }, page.twin.profile, rulerTools(page)), page.twin.numbers] : []),
  draw(page) {
    const { twin, canvas, inks, t, look } = page, two = settings(page), both = bothOf(page), main = canvas.parentElement, wide = page.stageBox.clientWidth > 560;
    const swipe = !page.solid && (two.layout === "swipe" || !wide), { elasticity: answer } = page, read = twin.at >= 0 ? twin.at : page.picked;
    (swipe ? main : page.stageBox)[swipe ? "append" : "insertBefore"](...(swipe ? [twin.elastic] : [twin.elastic, twin.gap]));
    twin.elastic.classList.toggle("over", swipe); twin.gap.hidden = swipe || !answer; twin.elastic.hidden = swipe && !answer; twin.handle.hidden = !swipe || !answer;
    page.drawnWith = [];
    const views = twin.views = { rule: paintAnswer(page, canvas, "rule", both) };
    page.view = views.rule;
    const { x0, u } = views.rule, [nx] = page.run.lattice.shape, x = x0 + u * (two.split ??= nx / 2);
    if (swipe && answer) views.rule.ctx.clearRect(x, 0, views.rule.w, Math.min(views.rule.y0 + 16, views.rule.h - 50));   // elasticity is seen there, through paper that is clear
    if (answer) { views.elastic = paintAnswer(page, twin.elastic.firstChild, "elastic", both); if (!twin.gap.hidden) views.gap = paintDifference(page, twin.gap.firstChild, both); }
    page.loads.paint(views.rule);
    for (const view of Object.values(views)) {
      if (two.ruler || page.lesson) paintNumbers(view, inks);
      if (two.ruler) paintRuler(page, view);
      if (read >= 0) paintPick(view, page.run.lattice.cell(read), inks);
    }
    for (const [name, align] of [["rule", "right"], ["elastic", "left"]]) if (views[name]) paintWord(views[name].ctx, t(name === "rule" ? "theRule" : "elastic"), swipe ? x + (name === "rule" ? -26 : 26) : views[name].w / 2, page.solid ? 16 : views[name].y0 - 14, inks[name], inks, { align: swipe ? align : "center", font: `600 ${FONT}` });
    if (!answer) twin.elastic.firstChild.ariaLabel = twin.gap.firstChild.ariaLabel = t("solving");
    twin.elastic.style.clipPath = swipe ? `inset(0 0 0 ${x}px)` : "";
    twin.handle.style.left = `${x - 22}px`; twin.handle.style.top = page.solid ? "" : `${views.rule.y0 - u * views.rule.height - 2}px`; twin.handle.ariaValueMax = nx; twin.handle.ariaValueNow = String(Number((two.split).toFixed(3)));
    const [drawn] = page.drawnWith;
    twin.line.textContent = page.ruleAlone ? "" : t(drawn.factor ? "inBoth" : "flatBoth", { q: t(drawn.quantity), n: drawn.factor.toLocaleString("en").replaceAll(",", " ") });
    twin.numbers.replaceChildren(...numbersCard(page, both, read)); twin.numbers.hidden = !twin.numbers.childElementCount;
    twin.card.hidden = !two.ruler;
    if (two.ruler) twin.profile.replaceChildren(...rulerCard(page, both));
    page.parts.cap.textContent = page.told || (two.ruler ? page.ruled : page.run.kinds[read] >= 0 ? readingAt(page, both, read) : "");
  },
  press(page, event) {
    if (!settings(page).ruler) return false;
    page.hold = { laying: true };
    lay(page, event);
    return true;
  },
  move(page, event) {
    if (page.hold?.laying && event.buttons) { lay(page, event); return true; }
    if (page.hold && event.buttons) return false;
    hover(page, event, page.view);
    return true;
  },
  release(page) { if (settings(page).ruler) page.past.note(); return false; },
  key(page, event) {
    const { ruler } = settings(page), by = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [1, -1], ArrowRight: [1, 1] }[event.key];
    if (!ruler || !event.shiftKey || !by || by[0] !== ruler.axis) return false;
    rulerTo(page, ruler.at + by[1]); page.past.note();
    return true;
  },
});

// ------------------------------------------------------------------------- the elastic answer

/** What both answers tell of a cell, with its unit. */
export const BOTH = { along: "N", across: "N", stress: "Pa", move: "m" };
const HEIGHT = 1e-9;                           // of a cell: rounding

/** Ask for the elastic answer: from a worker. What is known is shown until then. */
export function askElastic(page) {
  const elastic = page.elastic ??= { answer: null, why: "" };
  clearTimeout(elastic.asking);
  elastic.worker?.terminate();
  elastic.old = true;
  elastic.asking = setTimeout(() => { elastic.worker = atWork(page); }, elastic.answer ? 60 : 0);
}
/** A worker that answers a page with elasticity to its scene as it stands. */
function atWork(page) {
  const { scene, cells, stage } = page, url = URL.createObjectURL(new Blob([ELASTIC], { type: "text/javascript" })), worker = new Worker(url), part = (load) => Math.min(1, stage / load.steps);
  worker.onmessage = ({ data: { answer = null, error = "" } }) => {
    URL.revokeObjectURL(url);
    Object.assign(page.elastic, { answer, why: error, old: false });
    page.scales.clear(); page.later();
  };
  worker.postMessage({ scene, cells, loads: scene.loads.map((load) => ({ ...load, force: load.force.map((f) => f * part(load)) })) });
  return worker;
}
/** The axis along which the loads press most, and the sense of their sum on it. */
export function loadAxis({ loads, lattice }) {
  const forces = lattice.shape.map((_, a) => loads.reduce((sum, { force }) => sum + Math.abs(force[a]), 0)), most = Math.max(...forces);
  const axis = most ? forces.findIndex((f) => f >= most * (1 - 1e-9)) : forces.length - 1;
  return { axis, sense: loads.reduce((sum, { force }) => sum + force[axis], 0) < 0 ? -1 : 1 };
}

/** What one answer tells of every cell, by key: pressures by axis (Pa) become squeezes (N), below 0 where it pulls. */
export function fieldsOf({ lattice: L, kinds, scene }, pressure, displacement) {
  const { axis } = loadAxis(scene), area = L.faceArea(scene.thickness), other = axis ? 0 : 1;
  const made = (f) => { const v = new Float64Array(L.size).fill(NaN); L.each((k) => { if (kinds[k] >= 0) v[k] = f(k); }); return v; };
  return { along: made((k) => area * pressure[axis][k]), ...(L.dimension === 2 ? { across: made((k) => area * pressure[other][k]) } : {}),
    stress: made((k) => pressure.reduce((top, p) => Math.max(top, Math.abs(p[k])), 0)), move: made((k) => Math.hypot(...displacement.map((u) => u[k]))) };
}

/** Force handed on through every layer of cells across the load (N): carried, and what equilibrium needs (NaN: not known). */
export function cutsOf(run, along) {
  const { lattice: L, kinds, scene, stage } = run, { axis, sense } = loadAxis(scene), n = L.shape[axis];
  const sums = new Float64Array(n), body = new Uint8Array(n);
  let highest = -Infinity, lowest = Infinity;  // where supports hold the force along the axis
  L.each((k) => {
    if (kinds[k] < 0) return;
    const at = L.cell(k)[axis];
    sums[at] += along[k]; body[at] = 1;
    for (let arm = 0; arm < L.D; arm++) {
      const kind = kinds[L.neighbour(k, arm)], square = arm >> 1 === axis;
      if (kind !== RIGID && !(kind === ROLLER && square)) continue;
      const place = at + 0.5 + (square ? (arm & 1 ? 0.5 : -0.5) : 0);
      highest = Math.max(highest, place); lowest = Math.min(lowest, place);
    }
  });
  const forces = scene.loads.map(({ cell, force, face, steps }) => [cell[axis] + 0.5 + (face >> 1 === axis && face >= 0 ? (face & 1 ? 0.5 : -0.5) : 0), force[axis] * Math.min(1, stage / steps)]);
  return Array.from({ length: n }, (_, at) => at).filter((at) => body[at]).map((at) => {
    const beyond = (place) => Math.max(0, Math.min(1, place - at)), add = (f) => forces.reduce((sum, [place, force]) => sum + f(place) * force, 0);
    const above = add(beyond), below = add((place) => beyond(place) - 1), all = add(() => 1);
    const freeAbove = !(highest > at + HEIGHT), freeBelow = !(lowest < at + 1 - HEIGHT);
    const turn = sense * (freeAbove || (!freeBelow && 2 * Math.abs(above) >= Math.abs(all)) ? 1 : -1);
    return { at, carried: -turn * sums[at] + 0, needed: freeAbove ? turn * above : freeBelow ? turn * below : NaN, loaded: Math.abs(turn > 0 === sense > 0 ? above : below) };
  });
}

/** The cells of a row or column: keys, and how far along each lies (in cells). */
export function cellsOn({ lattice: L, kinds }, { axis, at }) {
  const line = Array.from({ length: L.shape[axis] }, (_, i) => L.key(axis ? [at, i] : [i, at])), keys = line.filter((k) => kinds[k] >= 0);
  return { keys, at: keys.map((k) => L.cell(k)[axis] + 0.5) };
}

/** Half the width at half the largest value, both sides averaged; null where a side never falls so far. */
export function halfWidth(at, values) {
  const top = values.reduce((best, v, i) => (v > values[best] ? i : best), 0), half = values[top] / 2;
  if (!(half > 0)) return null;
  const ends = [-1, 1].map((turn) => {
    for (let i = top; values[i + turn] !== undefined; i += turn) if (values[i + turn] <= half) {
      return at[i] + (at[i + turn] - at[i]) * (values[i] - half) / (values[i] - values[i + turn]);
    }
    return NaN;
  });
  return Number.isNaN(ends[0] + ends[1]) ? null : { low: ends[0], high: ends[1], half, width: (ends[1] - ends[0]) / 2 };
}
