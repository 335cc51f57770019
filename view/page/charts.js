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
    paintChart(ctx, box, say(word), lists, g, (v) => quantity(v, unit), inks);
  });
}

function paintChart(ctx, { x, y, w, h }, word, lists, g, show, inks) {
  const values = lists.flat(), top = values.reduce((a, b) => (b > a ? b : a), 1e-300), n = lists[0].length;
  const X = (i) => x + 2 + (w - 4) * (n > 1 ? i / (n - 1) : 0), Y = (v) => y + h - 1 - (h - 4) * v / top;
  ctx.font = "11px system-ui, DejaVu Sans, sans-serif"; ctx.textBaseline = "bottom";
  ctx.textAlign = "left"; ctx.fillStyle = inks.faint; ctx.fillText(word, x, y - 1, 0.62 * w);
  ctx.textAlign = "right"; ctx.fillStyle = inks.ink;
  ctx.fillText(g && n ? show(lists[0][Math.min(g, n) - 1]) : "–", x + w, y - 1);
  ctx.lineWidth = 1; ctx.strokeStyle = inks.line; ctx.strokeRect(x + 0.5, y + 0.5, w - 1, h);
  lists.forEach((list, i) => {
    ctx.strokeStyle = i ? inks.mark : inks.accent; ctx.lineWidth = 1.6; ctx.beginPath();
    list.forEach((v, at) => ctx.lineTo(X(at), Y(v)));
    ctx.stroke();
  });
  if (!g) return;
  ctx.strokeStyle = inks.ink; ctx.lineWidth = 1; ctx.beginPath();
  ctx.moveTo(X(g - 1), y); ctx.lineTo(X(g - 1), y + h); ctx.stroke();
}
