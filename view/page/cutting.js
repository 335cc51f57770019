// Equilibrium at a glance: the force through every cut, rule beside elasticity; the part beyond a cut
// as a free body; and where the force of the loads has gone.
import { agentsOf, askElastic, bothOf, cellUnder, cutsOf, loadAxis, readingAt } from "./twin.js";
import { ticksOf } from "./charts.js";
import { button, draw, make, MODES } from "./controls.js";
import { FONT, paintLegend, paintNumbers, paintWord } from "./paint.js";
import { hand } from "./scene.js";
import { general, halvesUp, local, prefixOf, quantity } from "./words.js";

const SAME = 1e-9, NUMBERS = 46;               // of the load: what rounding leaves; pixels for the numbers beside bars
const inOneUnit = (v, { needed, carried }) => quantity(v, "N", Math.max(Math.abs(needed) || 0, Math.abs(carried)));   // the forces of a cut
const depthOf = (page) => page.run.lattice.shape[loadAxis(page.scene).axis];
/** The row (or column) that is cut: near the load, until a reader moves the cut. */
const rowOf = (page) => page.look.row ??= Math.floor(0.82 * depthOf(page));
const moveTo = (page, row) => page.set("row", Math.max(0, Math.min(depthOf(page) - 1, row)));

/** The cuts of both answers at this generation, from one end of the axis to the other. */
export function balanceOf(page) {
  const { run, elasticity: answer } = page, { rule, elastic } = bothOf(page, "along");
  if (answer) answer.cuts ??= cutsOf(run, elastic);
  return cutsOf(run, rule).map((cut, i) => ({ ...cut, elastic: answer?.cuts[i]?.carried ?? NaN }));
}
function csvOfCuts(page) {
  const { lattice: { h } } = page.run, name = "xyz"[loadAxis(page.scene).axis];
  return [`${name} (m),rule (N),elasticity (N),needed (N)`, ...balanceOf(page).map((cut) => [(cut.at + 0.5) * h, cut.carried, cut.elastic, cut.needed].map((v) => (Number.isNaN(v) ? "" : v)).join(","))].join("\n") + "\n";
}

// ------------------------------------------------------------------------------------- the bars

/** Bars beside the rows of the body (or below its columns), elasticity as a mark a row. */
function paintBars(page, view, cuts, box, upright) {
  const { ctx, u } = view, { inks, t } = page, row = rowOf(page), known = cuts.flatMap((cut) => [cut.carried, cut.elastic, cut.needed]).filter((v) => !Number.isNaN(v));
  const high = Math.max(...known, 1e-300), low = Math.min(0, ...known), from = upright ? box.x : box.y, long = upright ? box.w - NUMBERS : box.h, F = (v) => from + long * (v - low) / (high - low);
  const P = (at) => (upright ? view.y0 - u * at : view.x0 + u * at), point = (v, at) => (upright ? [F(v), P(at)] : [P(at), F(v)]);
  const [first, last] = [cuts[0].at, cuts.at(-1).at + 1], [factor, prefix] = prefixOf(high, "N"), by = Math.max(1, factor), digits = Math.max(0, Math.min(12, 3 - Math.floor(Math.log10(high / by))));
  ctx.lineWidth = 1; ctx.font = FONT; ctx.fillStyle = inks.soft; ctx.strokeStyle = inks.hair;
  for (const v of ticksOf(low, high, upright && box.w > 190 ? 4 : 2)) {
    ctx.beginPath(); ctx.moveTo(...point(v, first)); ctx.lineTo(...point(v, last)); ctx.stroke();
    ctx.textAlign = upright ? "center" : "right"; ctx.textBaseline = upright ? "bottom" : "middle";
    ctx.fillText(`${general(v / factor, 3)} ${prefix}N`, ...(upright ? [F(v), P(last) - 4] : [P(first) - 4, F(v)]));
  }
  paintWord(ctx, t("throughEach"), box.x + box.w, upright ? P(last) - 28 : box.y - 14, inks.ink, inks, { font: `600 ${FONT}`, align: "right" });
  for (const { at, carried, elastic } of cuts) {
    const [a, b] = [point(0, at + 0.18), point(carried, at + 0.82)];
    ctx.fillStyle = inks.rule; ctx.fillRect(Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.abs(b[0] - a[0]), Math.abs(b[1] - a[1]));
    if (!Number.isNaN(elastic)) {
      const [x, y] = point(elastic, at + 0.5), s = Math.min(7, 0.5 * u);
      ctx.strokeStyle = inks.elastic; ctx.lineWidth = 2; ctx.fillStyle = inks.paper; ctx.fillRect(x - s / 2, y - s / 2, s, s); ctx.strokeRect(x - s / 2, y - s / 2, s, s);
    }
  }
  const ends = upright ? [[view.left, P(row + 0.5)], [box.x + long + 4, P(row + 0.5)]] : [[P(row + 0.5), view.y0 - u * view.height], [P(row + 0.5), box.y + box.h]], [hx, hy] = upright ? [view.right + 16, ends[0][1]] : [ends[0][0], view.y0 + 26];
  Object.assign(ctx, { strokeStyle: inks.ink, lineWidth: 2.5, fillStyle: inks.wash }); ctx.beginPath(); ctx.moveTo(...ends[0]); ctx.lineTo(...ends[1]); ctx.stroke();
  ctx.lineWidth = 1.5; ctx.beginPath(); ctx.roundRect(hx - 11, hy - 10, 22, 20, 6); ctx.fill(); ctx.stroke();
  paintWord(ctx, upright ? "↕" : "↔", hx, hy, inks.ink, { ...inks, paper: "transparent" }, { align: "center" });
  // Beside small rows only the one that is cut has room for its number.
  if (upright) for (const { at, carried } of cuts) if (u >= 13 || at === row) paintWord(ctx, Math.abs(carried) < SAME * high ? "0" : local(halvesUp(carried / by).toFixed(digits)), box.x + box.w, P(at + 0.5), inks.ink, inks, { align: "right" });
  if (!page.elastic.answer) paintWord(ctx, page.elastic.why ? t("noAnswer", { why: page.elastic.why }) : t("solving"), upright ? box.x : view.x0, upright ? P(first) + 16 : box.y + box.h + 14, inks.elastic, inks);
}

// ------------------------------------------------------------------------------------- the cards

/** Whether a lesson asks for what a card would tell. */
const asks = ({ lesson }) => Boolean(lesson) && !lesson.teacher && !lesson.isDone(lesson.question ?? lesson.questions.at(-1));
/** The free body at the chosen cut: what presses, what holds, what is missing or too much; arrows to one scale. */
function freeBody(page, cut) {
  const { t, ruleAlone, lesson } = page, { carried, needed } = cut, gap = needed - carried, asked = asks(page) && lesson.step !== "try";   // pupils subtract first
  const n = asked ? "?" : inOneUnit(Math.abs(gap), cut), long = (v) => 44 * v / Math.max(Math.abs(needed), Math.abs(carried), 1e-300);
  const arrow = (x, from, v, name, text, y) => {   // from its end at the body; up is above 0
    const far = long(v), tip = Math.sign(far) * Math.min(7, Math.abs(far));
    return [...(Math.abs(far) < 0.5 ? [] : [draw("path", { class: `arrow ${name}`, d: `M${x} ${from + far}V${from}m-${Math.abs(tip)} ${tip}l${Math.abs(tip)} ${-tip}l${Math.abs(tip)} ${tip}` })]), draw("text", { class: name, x: x + 12, y }, text)];
  };
  return draw("svg", { class: "chart", viewBox: "0 0 340 146", role: "img", "aria-label": t("partAbove") }, ...arrow(120, 46, -needed, "load", t("pressIt", { n: inOneUnit(needed, cut) }), 26),
    draw("rect", { class: "part", x: 30, y: 50, width: 180, height: 40, rx: 4 }), draw("text", { x: 120, y: 74, "text-anchor": "middle" }, t("partAbove")),
    ...arrow(46, 96, carried, "rule", t("holdIt", { n: inOneUnit(carried, cut) }), 116),
    ...(ruleAlone || Math.abs(gap) <= SAME * Math.abs(needed) ? [] : gap > 0 ? arrow(204, 96, gap, "bad", t("missingIt", { n }), 116)
      : [draw("path", { class: "arrow bad", d: `M46 ${96 + long(needed)}V${96 + long(carried)}` }), draw("text", { class: "bad", x: 58, y: 138 }, t("tooMuchIt", { n }))]));   // a part of what holds it
}
function cutCard(page, cuts) {
  const { t, run: { lattice: L }, scene } = page, { axis } = loadAxis(scene), cut = cuts.find(({ at }) => at === rowOf(page));
  if (!cut) return [];
  const x = `${general(100 * L.h * (axis ? L.shape[1] - cut.at - 0.5 : cut.at + 0.5), 3)} cm`, big = (word, value, name) => make("div", { className: name }, t(word), make("b", { textContent: inOneUnit(value, cut) }));
  return [make("h2", { textContent: t("cutAtPlace", { x, side: t(axis ? "top" : "left"), n: cut.at }) }), make("div", { className: "pair" }, big("theRule", cut.carried, "rule"), ...(page.ruleAlone ? [] : [big("elastic", cut.elastic, "elastic")])),
    Number.isNaN(cut.needed) ? make("p", { textContent: t("bothHeld") }) : freeBody(page, cut)];
}
/** On its way + ended + ground − made by the shares is what was put on, in every generation. */
function whereCard(page) {
  const { t, run, g } = page, { ledger } = run;
  if (!ledger) return [make("summary", { textContent: t("onlyTwin") })];
  if (run.grown) return [make("summary", { textContent: t("whereWent", { n: quantity(ledger.applied, "N") }) }), make("p", { textContent: t("grown") })];
  const { applied, rows } = ledger, now = rows[g], parts = (row) => [["way", row.way], ["ended", row.ended], ["ground", row.ground], ["made", -row.made]], high = Math.max(...rows.slice(0, page.limit + 1).map((row) => parts(row).reduce((sum, [, v]) => sum + Math.max(0, v), 0)));
  const [w, h, x, y] = [340, 118, 40, 8], X = (i) => x + (w - x - 10) * i / Math.max(1, rows.length - 1), Y = (v) => y + (h - y - 22) * (1 - v / (high || 1)), shown = rows.slice(0, Math.min(rows.length, page.limit + 1)), areas = [];
  const below = shown.map(() => 0);
  for (const [n, [name]] of parts(now).entries()) {
    const from = [...below];
    shown.forEach((row, i) => { below[i] += Math.max(0, parts(row)[n][1]); });
    areas.push(draw("polygon", { class: name, points: [...below.map((v, i) => `${X(i)},${Y(v)}`), ...from.map((v, i) => `${X(i)},${Y(v)}`).reverse()].join(" ") }));
  }
  const ticks = [...ticksOf(0, high, 2).map((v) => draw("text", { x: x - 4, y: Y(v) + 4, "text-anchor": "end" }, quantity(v, "N"))), ...ticksOf(0, rows.length - 1, 4).filter(Number.isInteger).map((i) => draw("text", { x: X(i), y: h - 4, "text-anchor": "middle" }, String(i)))];
  const words = { way: "onItsWay", ended: "itEnded", ground: "toGround", made: now.made > 0 ? "madeBy" : "lostBy" }, list = parts(now).filter(([name, v]) => name === "ground" || name === "way" || Math.abs(v) > SAME * applied);
  const { own, out } = page.deformable ? { own: run.transfer.shares[0].own, out: run.transfer.emitted[0] } : {};
  return [make("summary", { textContent: t("whereWent", { n: quantity(applied, "N") }) }), make("p", { className: "small soft", textContent: t("overGenerations") }),
    draw("svg", { class: "chart where", viewBox: `0 0 ${w} ${h}`, role: "img", "aria-label": t("whereWent", { n: quantity(applied, "N") }) }, ...areas, draw("path", { class: "now", d: `M${X(g)} ${y}V${h - 20}` }), ...ticks),
    make("ul", { className: "where" }, ...list.map(([name, v]) => make("li", { className: name }, `${t(words[name])} `, make("data", { value: String(name === "made" ? -v : v), textContent: quantity(name === "made" ? Math.abs(v) : v, "N") }))), make("li", {}, t("wholeSum", { n: quantity(parts(now).reduce((sum, [, v]) => sum + v, 0), "N") }))),
    make("p", { className: "small soft", textContent: `${Math.abs(now.ground) > SAME * applied ? `${t("groundTwice")} ` : ""}${Math.min(now.way, now.ended, now.ground) < -SAME * applied ? `${t("belowZero")} ` : ""}${page.scene.materials.length === 1 ? t("squeezeApart", { own: general(own, 3), out: general(out, 3) }) : ""}` })];
}

// --------------------------------------------------------------------------------------- mode

/** The row under a pointer, and whether that is near the cut. */
function under(page, { offsetX, offsetY }) {
  const { view } = page, x = loadAxis(page.scene).axis ? (view.y0 - offsetY) / view.u : (offsetX - view.x0) / view.u;
  return { at: Math.floor(x), near: Math.abs(rowOf(page) + 0.5 - x) < Math.max(0.7, 14 / view.u) };
}

MODES.push({
  name: "cuts", letter: "c",
  offered: (page) => page.comparable && page.run.taken,
  open(page) {
    page.cutCards = ["section", "section", "details"].map((tag) => make(tag, { className: "card" }));   // one sum of forces at a time: that of the cut
    page.cutCards[1].classList.add("warn");
    askElastic(page);
  },
  changed: askElastic,
  tools(page) {
    const { t } = page, by = (step) => moveTo(page, rowOf(page) + step), [back, on] = loadAxis(page.scene).axis ? "▼▲" : "◀▶";
    return [make("span", { className: "push" }), button(back, () => by(-1), { title: t("cutBack"), ariaLabel: t("cutBack") }), button(on, () => by(1), { title: t("cutOn"), ariaLabel: t("cutOn") }),
      ...(page.lesson ? [] : [button("CSV", () => page.announce(t("saved", { name: hand("cuts.csv", new Blob([csvOfCuts(page)], { type: "text/csv" })) })))])];
  },
  cards: (page) => page.cutCards ?? [],
  draw(page) {
    const { canvas: { clientWidth: w, clientHeight: h }, t } = page, upright = loadAxis(page.scene).axis === 1, cuts = balanceOf(page), side = upright ? Math.min(0.44 * w, 300) : Math.min(0.34 * h, 200);
    const both = bothOf(page, "along");
    const top = upright && w < 520 ? 34 : 0, legend = upright && !top, [nx, ny] = page.run.lattice.shape, across = w - (upright ? side + 20 : 0);   // on a phone words stand above the body
    const n = top ? Math.min(nx, Math.max(5, Math.floor((across - 72) * ny / Math.max(60, h - top - 92)))) : nx, from = Math.max(0, Math.min(nx - n, page.scene.loads[0].cell[0] - (n >> 1)));   // and only columns at the load, so that rows are as high as they can be
    page.drawBody({ x: upright ? 20 : 0, y: top, w: across, h: h - (upright ? top : side), window: [from, 0, n, ny], foot: legend ? 64 : 20 }, agentsOf(page, both), both.scale);
    const { view, view: { ctx } } = page;
    if (n < nx) { ctx.clearRect(0, 0, view.left, h); ctx.clearRect(view.right, view.y0 - view.u * ny, w, h); }
    paintNumbers(view, page.inks);
    if (legend) paintLegend({ ctx, w: across, h }, both.scale, t("along"), t("log"), (v) => quantity(v, "N"), page.inks);
    if (cuts.length) paintBars(page, view, cuts, upright ? { x: w - side + 20, w: side - 48, y: 0, h } : { x: 0, w, y: h - side + 24, h: side - 44 }, upright);
    const kept = cuts.every(({ carried, needed }) => Number.isNaN(needed) || Math.abs(carried - needed) <= 1e-9 * Math.abs(needed));
    const [cut, say, where] = page.cutCards, read = cuts.find(({ at }) => at === rowOf(page));
    if (read) page.parts.cap.textContent = page.told || `${t("rowOf", { n: read.at })}: ${t("theRule")} ${inOneUnit(read.carried, read)}${page.ruleAlone ? "" : `, ${t("elastic")} ${inOneUnit(read.elastic, read)}`}${page.run.kinds[page.pointed] >= 0 ? ` · ${readingAt(page, both, page.pointed)}` : ""}`;
    say.replaceChildren(make("p", { textContent: t(kept ? "isBalanced" : "noBalance") })); say.hidden = Boolean(page.lesson) && (page.lesson.step !== "try" || asks(page));   // it would answer what is asked
    cut.replaceChildren(...cutCard(page, cuts));
    if (!page.playing) where.replaceChildren(...whereCard(page));
  },
  press(page, event) {
    const { at, near } = under(page, event);
    if (!near && event.pointerType !== "touch" && page.view.cellAt(event.offsetX, event.offsetY)) return false;   // a cell is read
    page.hold = { cut: true };
    page.pointed = cellUnder(page, event, page.view, "along");
    moveTo(page, at);
    return true;
  },
  move(page, event) {
    page.pointed = cellUnder(page, event, page.view, "along");
    if (page.hold?.cut && event.buttons) moveTo(page, under(page, event).at);
    return true;
  },
  key(page, event) {
    const by = (loadAxis(page.scene).axis ? { ArrowUp: 1, ArrowDown: -1 } : { ArrowRight: 1, ArrowLeft: -1 })[event.key];
    if (!event.shiftKey || !by) return false;
    moveTo(page, rowOf(page) + by);
    return true;
  },
});
