// Curves over the generations: agents, load on its way, the largest load, and where loads went.
import { fitted, FONT, paintWord } from "./paint.js";
import { general, local, prefixOf, quantity } from "./words.js";

/** The curves of a run: [word, unit, lists, names of the lists]. */
export function curvesOf(run) {
  const largest = [], ended = [], { offset, value } = run.taken;
  for (let g = 0; g < run.generation; g++) {
    let top = 0;
    for (let i = offset[g]; i < offset[g + 1]; i++) if (value[i] > top) top = value[i];
    largest.push(top);
  }
  let sum = 0;
  for (const ends of run.ends ?? []) ended.push(sum += ends);
  sum = 0;
  const taken = run.waits.map((load) => (sum += load));
  const curves = [["agents", "", [run.alive], []], ["onTheWay", "N", [run.waits], []], ["largest", "N", [largest], []]];
  return [...curves, ["ledger", "N", ended.length ? [taken, ended] : [taken], ["takenInAll", "endedInAll"]]];
}

const LEFT = 40, HEAD = 20, FOOT = 18, BOLD = `600 ${FONT}`;
/** The boxes of charts: in one or two columns, where the first of an odd number has a row of its own. */
function boxesOf({ clientWidth, clientHeight }, count) {
  const columns = count > 1 && clientWidth >= 300 ? 2 : 1, odd = columns * count % 4 === 2 ? 1 : 0, rows = Math.ceil((count + odd) / columns), h = clientHeight / rows;
  return Array.from({ length: count }, (_, n) => {
    const at = n && n + odd, w = clientWidth / (odd && !n ? 1 : columns);
    return { x: at % columns * w + LEFT, y: Math.floor(at / columns) * h + HEAD, w: w - LEFT - 10, h: h - HEAD - FOOT };
  });
}

/** Draw charts, first those whose names a text has in italics; `limit`: curves are shown no further. */
export function paintGrid(canvas, charts, inks, limit = Infinity, text = "") {
  if (!canvas.clientWidth) return;
  const named = ({ word }) => Number(text.includes(`*${word}*`));
  charts = charts.toSorted((a, b) => named(b) - named(a));
  const { r, w, h } = fitted(canvas), ctx = canvas.getContext("2d"), boxes = boxesOf(canvas, charts.length);
  ctx.setTransform(r, 0, 0, r, 0, 0); ctx.clearRect(0, 0, w, h);
  charts.forEach((chart, n) => {
    const shown = chart.over.filter((at) => at <= limit).length;
    paintChart(ctx, boxes[n], { ...chart, shown: chart.lists.map((list) => list.slice(0, shown)) }, inks);
  });
}

/** Which part of its axis a pixel of a chart is at, from 0 to 1. */
export function partOf(canvas, count, { offsetX, offsetY }) {
  const { x, w } = boxesOf(canvas, count).findLast((box) => offsetX >= box.x - LEFT && offsetY >= box.y - HEAD);
  return Math.max(0, Math.min(1, (offsetX - x) / w));
}

/** Three to five round numbers between two: 1, 2 or 5 times a power of ten apart. */
export function ticksOf(low, high, most = 4) {
  if (!(high > low)) return [low];
  const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough)), step = power * [1, 2, 5, 10].find((f) => f * power >= rough * (1 - 1e-9));
  const list = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high * (1 + 1e-9); n++) list.push(Number((n * step).toPrecision(12)));
  return list;
}

/** One chart: axes with ticks and a unit, a line each, its name at its end, the present as a dot and a number. */
export function paintChart(ctx, { x, y, w, h }, { word, unit, lists, shown = lists, names, over, now, log = false, course = false, axis = "" }, inks) {
  let top = 0, low = log ? Infinity : 0;
  for (const list of lists) for (const v of list) { if (v > top) top = v; if (v < low && (!log || v > 0)) low = v; }
  if (log && !(low < top)) low = top / 10 || 0.1;
  const least = Math.min(...lists.flat()), near = !log && least > 0.7 * top && top - least > 1e-3 * top;   // what hardly changes is looked at closely, but no rounding
  if (near) { low = least - 0.1 * (top - least); top += 0.1 * (top - least); }
  if (!(top > low)) top = low + 1;
  const map = log ? (v) => Math.log10(Math.max(v, low)) : (v) => v, from = map(low), span = map(top) - from || 1;
  const first = over[0] ?? 0, reach = over.reduce((most, at) => Math.max(most, at - first), 0) || 1;
  const X = (at) => x + w * (at - first) / reach, Y = (v) => y + h - h * (map(v) - from) / span;
  const [unitAt, prefixAt] = prefixOf(first + reach, axis), [factor, prefix] = prefixOf(Math.max(top, -low), unit), short = (v) => local(String(Number((v / factor).toPrecision(near ? 3 : 2))));
  ctx.font = FONT; ctx.lineWidth = 1; ctx.strokeStyle = inks.hair; ctx.fillStyle = inks.soft;
  ctx.textAlign = "right"; ctx.textBaseline = "middle";
  const ticks = log ? Array.from({ length: Math.floor(map(top)) - Math.ceil(from) + 1 }, (_, i) => 10 ** (Math.ceil(from) + i)) : ticksOf(low, top, 3);
  for (const v of ticks) {
    ctx.beginPath(); ctx.moveTo(x, Y(v)); ctx.lineTo(x + w, Y(v)); ctx.stroke();
    ctx.fillText(log ? local(String(Number((v / factor).toPrecision(1)))) : short(v), x - 5, Y(v), LEFT - 6);
  }
  ctx.strokeStyle = inks.soft; ctx.beginPath(); ctx.moveTo(x, y); ctx.lineTo(x, y + h); ctx.lineTo(x + w, y + h); ctx.stroke();
  ctx.textBaseline = "top";
  const whole = over.every(Number.isInteger);
  ticksOf(first, first + reach, Math.max(2, Math.min(5, w / Math.max(axis ? 45 : 30, 14 + ctx.measureText(`${Math.round((first + reach) / unitAt)}`).width)))).filter((v) => !whole || Number.isInteger(v)).forEach((at, n, { length }) => {
    const text = local(`${Number((at / unitAt).toPrecision(6))}${axis && n === length - 1 ? ` ${prefixAt}${axis}` : ""}`), close = X(at) + ctx.measureText(text).width / 2 > x + w;   // the last one has the unit
    ctx.textAlign = close ? "right" : "center"; ctx.fillText(text, close ? x + w : X(at), y + h + 4);
  });
  ctx.textBaseline = "bottom"; ctx.textAlign = "left"; ctx.fillStyle = inks.soft;
  const about = `${prefix || unit ? `, ${prefix}${unit}` : ""}${log ? " (log)" : ""}`, inUnit = (...list) => (list.length > 1 || (unit && list[0] > 1e-3 * factor) ? `${[...new Set(list.map((v) => general(v / factor, 4)))].join(" – ")} ${prefix}${unit}` : quantity(list[0], unit));   // that of the axis
  const here = now === null || now === undefined ? -1 : course ? now : over.findLastIndex((v) => v <= now + 1e-9 * reach), seen = here >= 0 && shown[0]?.[here] !== undefined;
  const told = !seen ? "" : inUnit(...(near && lists.length === 2 ? [lists[1][here], lists[0][here]] : [lists[0][here]])), wide = (text, font = FONT) => { ctx.font = font; return ctx.measureText(text).width; };
  const room = w + LEFT - 2, taken = wide(`● ${told}`, BOLD), beside = seen && wide(word + about) + taken + 8 < room;
  let head = word;
  while (head.length > 1 && wide(head + about) > room) head = `${head.slice(0, -2)}…`;   // rather cut than squeezed
  ctx.fillText(head + about, x - LEFT + 4, y - 6);
  const colours = [inks.rule, inks.elastic, inks.miss, inks.soft], spots = [];
  shown.forEach((list, i) => {
    ctx.strokeStyle = colours[i % 4]; ctx.lineWidth = 1.8; ctx.setLineDash(i ? [5, 3] : []); ctx.beginPath();
    list.forEach((v, n) => {
      const at = [X(over[n]), Y(v)], last = n ? [X(over[n - 1]), Y(list[n - 1])] : at, steps = Math.ceil(Math.hypot(at[0] - last[0], at[1] - last[1]) / 4) || 1;
      ctx.lineTo(...at);
      for (let k = 1; k <= steps; k++) spots.push([0, 1].map((a) => last[a] + k / steps * (at[a] - last[a])));
    });
    ctx.stroke(); ctx.setLineDash([]);
  });
  const levels = Array.from({ length: Math.max(1, Math.floor((h - 12) / 4)) }, (_, n) => y + 8 + 4 * n);
  const put = (text, right, wanted, ink, font) => {   // as near as no curve and no other word is
    const left = right - wide(text, font), met = (at) => spots.filter(([px, py]) => px > left - 4 && px < right + 4 && Math.abs(py - at) < 9).length;
    const level = levels.map((at) => [met(at), Math.abs(at - wanted), at]).reduce((best, one) => (one[0] - best[0] || one[1] - best[1]) < 0 ? one : best)[2];
    for (let px = left; px <= right; px += 4) spots.push([px, level - 5], [px, level + 5]);
    paintWord(ctx, text, right, level, ink, inks, { align: "right", font });
  };
  if (seen) {
    const px = X(over[here]), py = Y(lists[0][here]);
    const ink = lists.length > 1 && !near ? colours[0] : inks.ink;   // of several curves it is the first one's
    ctx.fillStyle = ink; ctx.beginPath(); ctx.arc(px, py, 3.5, 0, 7); ctx.fill();
    if (beside) paintWord(ctx, `● ${told}`, x + w + 2, y - 12, ink, inks, { align: "right", font: BOLD });
    else put(told, Math.max(px < x + w / 2 ? px + 6 + wide(told, BOLD) : px - 6, x + 2 + wide(told, BOLD)), py - 9, ink, BOLD);
  }
  shown.forEach((list, i) => {
    if (names?.[i] && lists.length > 1 && list.length) put(names[i], Math.min(x + w, X(over[list.length - 1])) - 3, Y(list.at(-1)) + (i ? 10 : -8), colours[i % 4], FONT);
  });
}
