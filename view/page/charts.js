// Curves over the generations: agents, load on its way, the largest load, and where loads went.
import { make } from "./controls.js";
import { fitted, FONT } from "./paint.js";
import { local, prefixOf, quantity } from "./words.js";

/** The curves of a run: [word, unit, lists, names of the lists]. */
export function curvesOf(run) {
  const { offset, value } = run.taken, largest = Array.from({ length: run.generation }, (_, g) => value.subarray(offset[g], offset[g + 1]).reduce((top, load) => Math.max(top, load), 0));
  let sum = 0;
  const taken = Array.from(run.waits, (load) => (sum += load));
  return [["agents", "", [run.alive], []], ["onTheWay", "N", [run.waits], []], ["largest", "N", [largest], []],
    ...(run.absorbed ? [["absorbedInAll", "N", [run.absorbed], []]] : []), [run.ended ? "ledger" : "takenInAll", "N", run.ended ? [taken, run.ended] : [taken], ["takenInAll", "endedInAll"]]];
}

const LEFT = 40, RIGHT = 10, FOOT = 18, LINE = 14;

/** Draw charts into a box, each on a canvas of its own; curves are shown no further than their `limit`. */
export function paintGrid(box, charts, inks) {
  while (box.childElementCount < charts.length) box.append(make("canvas"));
  charts.forEach((chart, n) => {
    const canvas = box.children[n], { r, w, h } = fitted(canvas), ctx = canvas.getContext("2d"), shown = chart.over.filter((at) => at <= (chart.limit ?? Infinity)).length;
    ctx.setTransform(r, 0, 0, r, 0, 0); ctx.clearRect(0, 0, w, h);
    if (w) paintChart(ctx, { w: w - RIGHT, h }, { ...chart, shown: chart.lists.map((list) => list.slice(0, shown)) }, inks);
  });
}

/** Which part of a chart's axis a press is at, from 0 to 1. */
export const partOf = ({ offsetX, target }) => Math.max(0, Math.min(1, (offsetX - LEFT) / (target.clientWidth - LEFT - RIGHT)));

/** Three to five round numbers between two: 1, 2 or 5 times a power of ten apart; on a `log` axis powers of ten, where they are few also 2 and 5 times these. */
export function ticksOf(low, high, most = 4, log = false) {
  if (!(high > low)) return [low];
  const powers = (digits) => Array.from({ length: 2 + Math.log10(high / low) }, (_, k) => digits.map((f) => Number(`${f}e${Math.floor(Math.log10(low)) + k}`))).flat().filter((v) => v >= low && v <= high), fine = log ? powers([1, 2, 5]) : [];
  if (fine.length > 1) return fine.length < 7 ? fine : powers([1]);
  const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough)), step = power * [1, 2, 5, 10].find((f) => f * power >= rough * (1 - 1e-9));
  const list = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high * (1 + 1e-9); n++) list.push(Number((n * step).toPrecision(12)));
  return list;
}

/** Words one after another in lines as wide as a chart, a sample of its curve before each that belongs to one; returns how many lines. */
function paintHead(ctx, room, words) {
  let at = 0, line = 0;
  ctx.textAlign = "left"; ctx.textBaseline = "middle";
  for (const { text, ink, dash, bold } of words) {
    ctx.font = bold ? `600 ${FONT}` : FONT;
    const sample = dash ? 18 : 0, wide = sample + ctx.measureText(text).width;
    if (at && at + wide > room) { at = 0; line++; }
    const x = 3 + at, middle = 8 + LINE * line;
    if (dash) { Object.assign(ctx, { strokeStyle: ink, lineWidth: 1.8 }); ctx.setLineDash(dash); ctx.beginPath(); ctx.moveTo(x, middle); ctx.lineTo(x + 14, middle); ctx.stroke(); ctx.setLineDash([]); }
    ctx.fillStyle = ink; ctx.fillText(text, x + sample, middle, room - sample);
    at += wide + 8;
  }
  return line + 1;
}

/** One chart: above it its name and unit, and of every curve its name and present number; below axes with ticks and the name of the one `along` which curves go, a line or bars each, the present as a dot. */
function paintChart(ctx, box, { word, unit, lists, shown, names, over, now, colours, log = false, course = false, bars = false, axis = "", along = "", end = 0 }, inks) {
  let top = 0, low = log ? Infinity : 0;
  for (const list of lists) for (const v of list) { if (v > top) top = v; if (v < low && (!log || v > 0)) low = v; }
  if (log) low = low < top ? low * (low / top) ** 0.08 : top / 10 || 0.1;   // no curve lies on the axis
  const least = Math.min(...lists.flat()), near = lists.length > 1 && least > 0.7 * top && top - least > 1e-3 * top;   // bounds that hardly differ are looked at closely, but no rounding
  if (near) { low = least - 0.1 * (top - least); top += 0.1 * (top - least); }
  if (!(top > low)) top = low + 1;
  const first = over[0] ?? 0, reach = over.reduce((most, at) => Math.max(most, at - first), end - first) || 1;
  const [unitAt, prefixAt] = prefixOf(first + reach, axis), [factor, prefix] = prefixOf(Math.max(top, -low), unit), short = (v, digits) => local(String(Number((v / factor).toPrecision(digits))));
  const here = now === null || now === undefined ? -1 : course ? now : now > over.at(-1) + 1e-9 * reach ? -1 : over.findLastIndex((v) => v <= now + 1e-9 * reach), single = lists.length === 1, inkOf = (i) => (colours ?? [inks.rule, inks.elastic, inks.miss, inks.soft])[i % 4], dashOf = (i) => (i ? [5, 3] : []);
  const about = `${word}${prefix || unit ? `, ${prefix}${unit}` : ""}${log ? " (log)" : ""}`, told = (v, some = Math.abs(v) > 1e-15 * top) => (v === undefined ? "" : quantity(some ? v : 0, unit, some && Math.abs(v) < 1e-4 * top ? 0 : Math.max(top, -low)));   // what rounding leaves is nothing; what is far below the top has a unit of its own
  const curves = shown.map((list, i) => (single ? { text: list[here] === undefined ? "" : `● ${told(list[here])}`, ink: inks.ink, bold: true } : { text: `${names[i]} ${told(list[here])}`, ink: inkOf(i), dash: dashOf(i) }));
  const head = LINE * paintHead(ctx, box.w, [{ text: about, ink: inks.soft }, ...curves]) + 8;
  const x = LEFT, y = head, w = box.w - LEFT, h = box.h - head - FOOT - (along ? LINE : 0);
  const map = log ? (v) => Math.log10(Math.max(v, low)) : (v) => v, from = map(low), span = map(top) - from || 1, X = (at) => x + w * (at - first) / reach, Y = (v) => y + h - h * (map(v) - from) / span;
  ctx.font = FONT; ctx.lineWidth = 1; ctx.strokeStyle = inks.hair; ctx.fillStyle = inks.soft; ctx.textAlign = "right";
  for (const v of ticksOf(low, top, log ? 5 : Math.max(3, Math.min(6, Math.floor(h / 24))), log)) {
    ctx.beginPath(); ctx.moveTo(x, Y(v)); ctx.lineTo(x + w, Y(v)); ctx.stroke();
    ctx.fillText(short(v, log || near ? 3 : 2), x - 5, Y(v), LEFT - 6);
  }
  ctx.strokeStyle = inks.soft; ctx.beginPath(); ctx.moveTo(x, y); ctx.lineTo(x, y + h); ctx.lineTo(x + w, y + h); ctx.stroke();
  ctx.textBaseline = "top";
  const whole = over.every(Number.isInteger);
  ticksOf(first, first + reach, Math.max(2, Math.min(5, w / Math.max(axis ? 45 : 30, 14 + ctx.measureText(`${Math.round((first + reach) / unitAt)}`).width)))).filter((v) => !whole || Number.isInteger(v)).forEach((at, n, { length }) => {
    const text = local(`${Number((at / unitAt).toPrecision(6))}${axis && n === length - 1 ? ` ${prefixAt}${axis}` : ""}`), close = X(at) + ctx.measureText(text).width / 2 > x + w;   // the last one has the unit
    ctx.textAlign = close ? "right" : "center"; ctx.fillText(text, close ? x + w : X(at), y + h + 4);
  });
  ctx.textAlign = "right"; ctx.fillText(along, x + w, y + h + 4 + LINE);
  shown.forEach((list, i) => {
    Object.assign(ctx, { strokeStyle: inkOf(i), fillStyle: inkOf(i), lineWidth: 1.8, lineJoin: "round" });   // no peak looks higher than it is
    if (bars) { const wide = Math.max(1, 0.7 * w / reach); list.forEach((v, n) => ctx.fillRect(X(over[n]) - wide / 2, Y(v), wide, Y(0) - Y(v))); }
    ctx.setLineDash(dashOf(i)); ctx.beginPath();
    if (!bars) list.forEach((v, n) => ctx.lineTo(X(over[n]), Y(v)));
    ctx.stroke(); ctx.setLineDash([]);
    if (list[here] === undefined) return;
    ctx.fillStyle = single ? inks.ink : inkOf(i); ctx.beginPath(); ctx.arc(X(over[here]), Y(list[here]), 3.5, 0, 7); ctx.fill();
  });
}
