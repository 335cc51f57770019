// Curves over the generations: agents, load on its way, the largest load, and where loads went.
import { quantity } from "./words.js";

/** The curves of a run: [word, unit, values, further values]. */
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
  const curves = [["agents", "", run.alive], ["onTheWay", "N", run.waits], ["largest", "N", largest]];
  if (run.residual) curves.push(["residual", "", run.residual]);
  else curves.push(["ledger", "N", taken, ended]);
  return curves;
}

/** Draw the curves in a grid of two by two, with the present generation marked. */
export function paintCharts(canvas, curves, g, say, inks) {
  const r = Math.min(2, globalThis.devicePixelRatio || 1), w = canvas.clientWidth, h = canvas.clientHeight;
  if (!w) return;
  if (canvas.width !== Math.round(w * r) || canvas.height !== Math.round(h * r)) { canvas.width = Math.round(w * r); canvas.height = Math.round(h * r); }
  const ctx = canvas.getContext("2d");
  ctx.setTransform(r, 0, 0, r, 0, 0); ctx.clearRect(0, 0, w, h);
  curves.forEach(([word, unit, ...lists], n) => {
    const box = { x: (n & 1) * (w / 2 + 4), y: (n >> 1) * h / 2 + 16, w: w / 2 - 4, h: h / 2 - 22 };
    const over = lists[0].map((_, i) => i + 1);
    paintChart(ctx, box, { word: say(word), lists, over, now: g || null, show: (v) => quantity(v, unit) }, inks);
  });
}

/** One chart: lines over the same numbers, and where the page stands on them. */
export function paintChart(ctx, { x, y, w, h }, { word, lists, over, now, show, log = false }, inks) {
  let top = -Infinity, low = log ? Infinity : 0;
  for (const list of lists) for (const v of list) { if (v > top) top = v; if (v < low && (!log || v > 0)) low = v; }
  const map = log ? (v) => Math.log(Math.max(v, low)) : (v) => v, from = map(low), span = map(top) - from || 1;
  const first = over[0] ?? 0, reach = (over.at(-1) ?? 1) - first || 1;
  const X = (at) => x + 2 + (w - 4) * (at - first) / reach, Y = (v) => y + h - 1 - (h - 4) * (map(v) - from) / span;
  ctx.font = "11px system-ui, DejaVu Sans, sans-serif"; ctx.textBaseline = "bottom";
  ctx.textAlign = "left"; ctx.fillStyle = inks.faint; ctx.fillText(word, x, y - 1, 0.62 * w);
  const at = now === null ? -1 : over.findLastIndex((v) => v <= now + 1e-9 * reach);
  ctx.textAlign = "right"; ctx.fillStyle = inks.ink; ctx.fillText(at >= 0 ? show(lists[0][at]) : "–", x + w, y - 1);
  ctx.lineWidth = 1; ctx.strokeStyle = inks.line; ctx.strokeRect(x + 0.5, y + 0.5, w - 1, h);
  lists.forEach((list, i) => {
    ctx.strokeStyle = [inks.accent, inks.mark, inks.pull, inks.faint][i % 4]; ctx.lineWidth = 1.6; ctx.beginPath();
    list.forEach((v, n) => ctx.lineTo(X(over[n]), Y(v)));
    ctx.stroke();
  });
  if (now === null) return;
  const line = Math.max(x, Math.min(x + w, X(now)));
  ctx.strokeStyle = inks.ink; ctx.lineWidth = 1; ctx.beginPath(); ctx.moveTo(line, y); ctx.lineTo(line, y + h); ctx.stroke();
}
