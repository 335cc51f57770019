// Pictures of a body on a canvas: squares, hexagons and cubes, deformed or not, arrows, legend.

const STOPS = "440154481a6c472f7d414487395b8c31688e2a788e23888e1f988b22a88435b77954c5687ad151a5db36d2e21bfde725";
/** 256 colours from dark to bright (viridis), as [r, g, b]. */
export const COLOURS = (() => {
  const stops = STOPS.match(/.{6}/g).map((h) => [0, 2, 4].map((i) => parseInt(h.slice(i, i + 2), 16)));
  return Array.from({ length: 256 }, (_, n) => {
    const x = n / 255 * (stops.length - 1), i = Math.min(Math.floor(x), stops.length - 2);
    return stops[i].map((c, k) => Math.round(c + (x - i) * (stops[i + 1][k] - c)));
  });
})();
export const packed = (c) => (0xff000000 | c[2] << 16 | c[1] << 8 | c[0]) >>> 0;
const PACKED = Uint32Array.from(COLOURS, packed);
export const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
const MOST_ARROWS = 500, ROWS = Math.sqrt(3) / 2;

/** Where a value lies between the ends of a scale, from 0 to 1. */
export function place(value, { low, high, log }) {
  if (log) return value <= low ? 0 : Math.min(1, Math.log(value / low) / Math.log(high / low));
  return Math.max(0, Math.min(1, (value - low) / (high - low || 1)));
}
export const colourOf = (value, scale) => PACKED[Math.round(255 * place(value, scale))];

/** How a lattice in cells becomes pixels of a canvas. */
export class View {
  constructor(canvas, lattice, camera) {
    const r = Math.min(2, globalThis.devicePixelRatio || 1), w = canvas.clientWidth, h = canvas.clientHeight;
    const W = Math.max(1, Math.round(w * r)), H = Math.max(1, Math.round(h * r));
    if (canvas.width !== W || canvas.height !== H) { canvas.width = W; canvas.height = H; }
    Object.assign(this, { canvas, ctx: canvas.getContext("2d"), r, w, h, W, H, lattice });
    const [nx, ny] = lattice.shape, margin = Math.min(46, 0.08 * Math.min(w, h) + 14);
    if (lattice.dimension === 3) { this.turn(camera, margin); return; }
    this.width = nx + (lattice.hexagon && ny > 1 ? 0.5 : 0);
    this.height = lattice.hexagon ? (ny - 1) * ROWS + 1.1547 : ny;
    this.u = Math.max(0.1, Math.min((w - 2 * margin) / this.width, (h - 2 * margin - 40) / this.height));
    this.x0 = (w - this.u * this.width) / 2; this.y0 = (h - 40 + this.u * this.height) / 2;
  }
  turn({ yaw, pitch }, margin) {               // cubes: turned about the vertical, then tilted
    const { shape } = this.lattice, [c, s, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    this.axes = [[c, s * sp], [-s, c * sp], [0, cp]];          // right and up of each axis
    this.depth = [s * cp, c * cp, -sp];                        // away from the eye
    this.towards = this.depth.map((x) => -x);
    const spanX = shape.reduce((sum, n, a) => sum + n * Math.abs(this.axes[a][0]), 0);
    const spanY = shape.reduce((sum, n, a) => sum + n * Math.abs(this.axes[a][1]), 0);
    this.u = Math.max(0.1, Math.min((this.w - 2 * margin) / spanX, (this.h - 2 * margin - 40) / spanY));
    const [mx, my] = [0, 1].map((i) => shape.reduce((sum, n, a) => sum + n / 2 * this.axes[a][i], 0));
    this.x0 = this.w / 2 - this.u * mx; this.y0 = (this.h - 40) / 2 + this.u * my;
  }
  at(x, y) { return [this.x0 + this.u * x, this.y0 - this.u * y]; }
  /** Pixels of a point in cells: two coordinates, or three for cubes. */
  point(p) {
    if (p.length === 2) return this.at(p[0], p[1]);
    const [a, b, c] = this.axes;
    return this.at(p[0] * a[0] + p[1] * b[0] + p[2] * c[0], p[0] * a[1] + p[1] * b[1] + p[2] * c[1]);
  }
  centre(cell) {
    if (!this.lattice.hexagon) return cell.map((c) => c + 0.5);
    return [cell[0] + 0.5 + 0.5 * (cell[1] & 1), (cell[1] + 2 / 3) * ROWS];
  }
  /** The cell under a pixel, or null; of cubes the first that is shown. */
  cellAt(px, py) {
    const x = (px - this.x0) / this.u, y = (this.y0 - py) / this.u, { lattice: L, axes, depth } = this;
    if (L.dimension === 3) {
      for (let far = L.shape.reduce((a, b) => a + b), t = -far; t < far; t += 0.05) {
        const cell = axes.map(([right, up], a) => Math.floor(x * right + y * up + t * depth[a]));
        if (L.contains(cell) && this.shown(L.key(cell), cell)) return cell;
      }
      return null;
    }
    let cell = [Math.floor(x), Math.floor(y)];
    if (L.hexagon) {
      const row = Math.floor(y / ROWS - 1 / 6), far = (c) => Math.hypot(...this.centre(c).map((v, i) => v - [x, y][i]));
      const near = [row - 1, row, row + 1].flatMap((j) => [-1, 0, 1].map((i) => [Math.floor(x - 0.5 * (j & 1)) + i, j]));
      cell = near.reduce((a, b) => (far(b) < far(a) ? b : a));
    }
    return L.contains(cell) ? cell : null;
  }
  direction(d) {                               // of a face normal, in pixels of length one (cubes: foreshortened)
    const n = this.lattice.normals[d];
    if (n.length === 2) return [n[0], -n[1]];
    return [0, 1].map((i) => n.reduce((sum, x, a) => sum + x * this.axes[a][i], 0) * (i ? -1 : 1));
  }
}

/** Pixels that polygons are filled into: a path of 40,000 quads would take a canvas seconds. */
class Sheet {
  start(ctx, W, H) {
    if (this.image?.width !== W || this.image.height !== H) {
      this.image = ctx.createImageData(W, H);
      this.ink = new Uint32Array(this.image.data.buffer);
    }
    this.ink.fill(0); this.W = W; this.H = H;
    return this;
  }
  fill(px, py, n, colour) {                    // convex: row by row between its left and right edges
    const { ink, W, H } = this;
    let top = Infinity, low = -Infinity;
    for (let i = 0; i < n; i++) { if (py[i] < top) top = py[i]; if (py[i] > low) low = py[i]; }
    const end = Math.min(H - 1, Math.ceil(low - 0.5) - 1);
    for (let y = Math.max(0, Math.ceil(top - 0.5)); y <= end; y++) {
      const middle = y + 0.5;
      let left = Infinity, right = -Infinity;
      for (let i = 0, j = n - 1; i < n; j = i++) {
        if (py[i] <= middle === py[j] <= middle) continue;
        const x = px[i] + (middle - py[i]) * (px[j] - px[i]) / (py[j] - py[i]);
        if (x < left) left = x;
        if (x > right) right = x;
      }
      const from = Math.max(0, Math.ceil(left - 0.5)), to = Math.min(W, Math.ceil(right - 0.5));
      if (from < to) ink.fill(colour, y * W + from, y * W + to);
    }
  }
}
export const SHEET = new Sheet();
const PX = new Float64Array(8), PY = new Float64Array(8);
let small = null;

/** Colour every cell by its value (NaN: asleep); `moved`: {displacement, corners}, in metres. */
export function paintCells(view, kinds, values, scale, inks, { moved = null, factor = 0, cut = null } = {}) {
  const { ctx, r, lattice: L } = view, asleep = packed(rgb(inks.cell));
  ctx.setTransform(r, 0, 0, r, 0, 0);
  ctx.clearRect(0, 0, view.w, view.h);
  const colour = (k) => (values[k] >= 0 ? colourOf(values[k], scale) : asleep);
  if (L.dimension === 3) { paintCubes(view, kinds, colour, cut, values, moved, factor); return; }
  if (!moved && !L.hexagon) paintSquares(view, kinds, colour, inks);
  else {
    SHEET.start(ctx, view.W, view.H);
    (L.hexagon ? fillHexagons : fillQuads)(view, kinds, colour, moved, factor / L.h);
    ctx.putImageData(SHEET.image, 0, 0);
  }
  hatch(view, kinds, inks);
}

function paintSquares(view, kinds, colour, inks) {
  const { ctx, u, lattice: L } = view, [nx, ny] = L.shape;
  small ??= document.createElement("canvas");
  if (small.width !== nx || small.height !== ny) { small.width = nx; small.height = ny; }
  const pixels = small.getContext("2d"), image = pixels.createImageData(nx, ny);
  const ink = new Uint32Array(image.data.buffer);
  L.each((k, i) => { if (kinds[k] >= 0) ink[(ny - 1 - i % ny) * nx + Math.floor(i / ny)] = colour(k); });
  pixels.putImageData(image, 0, 0);
  ctx.imageSmoothingEnabled = false;
  ctx.drawImage(small, ...view.at(0, ny), u * nx, u * ny);
  if (u <= 9) return;
  ctx.strokeStyle = inks.paper; ctx.lineWidth = 0.6; ctx.beginPath();
  for (let i = 0; i <= nx; i++) { ctx.moveTo(...view.at(i, 0)); ctx.lineTo(...view.at(i, ny)); }
  for (let j = 0; j <= ny; j++) { ctx.moveTo(...view.at(0, j)); ctx.lineTo(...view.at(nx, j)); }
  ctx.stroke();
}

function fillQuads(view, kinds, colour, { corners }, f) {
  const { lattice: L, r, u, x0, y0 } = view, [nx, ny] = L.shape, step = L.stride[0];
  for (let x = 0; x < nx; x++) for (let y = 0; y < ny; y++) {
    const k = (x + 1) * step + y + 1;
    if (kinds[k] < 0) continue;
    for (let i = 0; i < 4; i++) {
      const cx = x + (i === 1 || i === 2 ? 1 : 0), cy = y + (i > 1 ? 1 : 0), n = cx * (ny + 1) + cy;
      PX[i] = (x0 + u * (cx + f * corners[0][n])) * r; PY[i] = (y0 - u * (cy + f * corners[1][n])) * r;
    }
    SHEET.fill(PX, PY, 4, colour(k));
  }
}

function fillHexagons(view, kinds, colour, moved, f) {
  const { lattice: L, r } = view, size = view.u > 6 ? 0.55 : 0.5775;
  L.each((k) => {
    if (kinds[k] < 0) return;
    const c = view.centre(L.cell(k));
    if (moved) for (const a of [0, 1]) c[a] += f * moved.displacement[a][k];
    for (let i = 0; i < 6; i++) {
      const p = view.at(c[0] + size * Math.sin(i * Math.PI / 3), c[1] + size * Math.cos(i * Math.PI / 3));
      PX[i] = p[0] * r; PY[i] = p[1] * r;
    }
    SHEET.fill(PX, PY, 6, colour(k));
  });
}

const shade = (c, f) => (0xff000000 | Math.round((c >> 16 & 255) * f) << 16 | Math.round((c >> 8 & 255) * f) << 8 | Math.round((c & 255) * f)) >>> 0;

/** Cubes from far to near, only the faces that can be seen; `cut`: {axis, at, only}. */
function paintCubes(view, kinds, colour, cut, values, moved, factor) {
  const { ctx, lattice: L, r, towards } = view, [nx, ny, nz] = L.shape, f = moved ? factor / L.h : 0;
  SHEET.start(ctx, view.W, view.H);
  const shown = view.shown = (k, cell) => kinds[k] >= 0 && !(cut?.only && !(values[k] >= 0))
    && !(cut && cut.axis >= 0 && (towards[cut.axis] > 0 ? cell[cut.axis] > cut.at : cell[cut.axis] < cut.at));
  const order = (n, a) => Array.from({ length: n }, (_, i) => (towards[a] > 0 ? i : n - 1 - i));
  const faces = [0, 1, 2].map((a) => ({ a, arm: 2 * a + (towards[a] > 0 ? 1 : 0), light: [0.82, 0.68, 1][a] }));
  for (const x of order(nx, 0)) for (const y of order(ny, 1)) for (const z of order(nz, 2)) {
    const cell = [x, y, z], k = L.key(cell);
    if (!shown(k, cell)) continue;
    const move = moved ? moved.displacement.map((u) => f * u[k]) : null;
    for (const { a, arm, light } of faces) {
      const beyond = cell.slice();
      beyond[a] += arm & 1 ? 1 : -1;
      if (L.contains(beyond) && shown(L.key(beyond), beyond)) continue;
      const b = (a + 1) % 3, c = (a + 2) % 3;
      for (let i = 0; i < 4; i++) {
        const p = cell.slice();
        p[a] += arm & 1; p[b] += i === 1 || i === 2 ? 1 : 0; p[c] += i > 1 ? 1 : 0;
        if (move) for (let n = 0; n < 3; n++) p[n] += move[n];
        [PX[i], PY[i]] = view.point(p).map((v) => v * r);
      }
      SHEET.fill(PX, PY, 4, shade(colour(k), light));
      if (view.u > 9) edge(view, colour(k), light);
    }
  }
  ctx.putImageData(SHEET.image, 0, 0);
}

function edge(view, colour, light) {           // a thin darker rim, so that single cubes can be told
  const mx = (PX[0] + PX[2]) / 2, my = (PY[0] + PY[2]) / 2, s = 1 - 1.4 * view.r / (view.u * view.r);
  const rim = [0, 1, 2, 3].map((i) => [mx + s * (PX[i] - mx), my + s * (PY[i] - my)]);
  SHEET.fill(PX, PY, 4, shade(colour, 0.8 * light));
  rim.forEach(([x, y], i) => { PX[i] = x; PY[i] = y; });
  SHEET.fill(PX, PY, 4, shade(colour, light));
}

/** Rigid cells and held sides: hatched; rollers: dotted. */
function hatch(view, kinds, inks) {
  const { ctx, u, lattice: L } = view, [nx, ny] = L.shape, step = L.stride[0];
  ctx.strokeStyle = inks.faint; ctx.fillStyle = inks.faint; ctx.lineWidth = 1; ctx.beginPath();
  for (let x = -1; x <= nx; x++) for (let y = -1; y <= ny; y++) {
    const kind = kinds[(x + 1) * step + y + 1];
    if (kind !== -2 && kind !== -3) continue;
    const inside = x >= 0 && y >= 0 && x < nx && y < ny, corner = (x < 0 || x >= nx) && (y < 0 || y >= ny);
    if (corner) continue;
    const [cx, cy] = view.at(...view.centre([x, y])), depth = inside ? u : Math.max(5, Math.min(9, u));
    const px = x < 0 ? cx + u / 2 - depth : cx - u / 2, py = y >= ny ? cy + u / 2 - depth : cy - u / 2;
    const w = x < 0 || x >= nx ? depth : u, h = y < 0 || y >= ny ? depth : u;
    if (kind === -3) { ctx.moveTo(px + w / 2 + 2, py + h / 2); ctx.arc(px + w / 2, py + h / 2, Math.min(2.5, u / 3), 0, 7); continue; }
    if (inside) ctx.fillRect(px, py, w, h);
    const n = Math.max(1, Math.round(Math.max(w, h) / 8)), long = w >= h;
    for (let i = 0; i < n; i++) {              // short strokes at 45 degrees
      const s = Math.min(w, h), t = i * Math.max(w, h) / n;
      const [ax, ay] = long ? [px + t, py + s] : [px, py + t + s];
      if (!inside) { ctx.moveTo(ax, ay); ctx.lineTo(ax + s, ay - s); }
    }
    if (!inside && y < 0) { ctx.moveTo(px, py); ctx.lineTo(px + w, py); }
    if (!inside && y >= ny) { ctx.moveTo(px, py + h); ctx.lineTo(px + w, py + h); }
    if (!inside && x < 0) { ctx.moveTo(px + w, py); ctx.lineTo(px + w, py + h); }
    if (!inside && x >= nx) { ctx.moveTo(px, py); ctx.lineTo(px, py + h); }
  }
  ctx.stroke();
}

// ------------------------------------------------------------------------------------- arrows

export function arrow(ctx, x, y, dx, dy, head) {
  const n = Math.hypot(dx, dy) || 1, ux = dx / n, uy = dy / n, h = Math.min(0.55 * n, head);
  ctx.moveTo(x, y); ctx.lineTo(x + dx, y + dy);
  ctx.moveTo(x + dx - h * (ux + 0.6 * uy), y + dy - h * (uy - 0.6 * ux));
  ctx.lineTo(x + dx, y + dy);
  ctx.lineTo(x + dx - h * (ux - 0.6 * uy), y + dy - h * (uy + 0.6 * ux));
}

/** Loads taken in one generation, the largest at most; `pull` ones in their own ink. */
export function paintLoads(view, rows, C, inks, shown = () => true) {
  const { ctx, u, lattice: L } = view, { D } = L, count = rows.index.length;
  if (!count || u < 3) return;
  let top = 0, least = 0;
  for (let i = 0; i < count; i++) top = Math.max(top, rows.value[i]);
  if (count > MOST_ARROWS) least = Float64Array.from(rows.value).sort()[count - MOST_ARROWS];
  ctx.lineCap = "round";
  for (const [ink, width, pulls] of [[inks.paper, 4, null], [inks.mark, 1.8, false], [inks.pull, 1.8, true]]) {
    ctx.strokeStyle = ink; ctx.lineWidth = width; ctx.beginPath();
    for (let i = 0, n = 0; i < count; i++) {
      const f = rows.value[i] / top, k = Math.floor(rows.index[i] / C), channel = rows.index[i] - k * C;
      if (f < 0.01 || rows.value[i] < least || (pulls !== null && pulls !== channel >= D)) continue;
      const cell = L.cell(k);
      if (!shown(k, cell)) continue;
      const [px, py] = view.point(view.centre(cell)), [dx, dy] = view.direction(channel % D);
      const l = Math.max(5, u * (0.25 + 0.6 * Math.sqrt(f)));
      arrow(ctx, px - dx * l / 2, py - dy * l / 2, dx * l, dy * l, 6);
      if (++n % 50 === 0) { ctx.stroke(); ctx.beginPath(); }   // long paths are slow
    }
    ctx.stroke();
  }
}

/** Who handed how much to whom: lines between neighbours, thicker for more. */
export function paintPath(view, passed, inks, shown = () => true) {
  const { ctx, u, lattice: L } = view, { D } = L, bins = [[], [], [], []];
  const top = passed.reduce((a, b) => Math.max(a, b), 0) || 1;
  for (let i = 0; i < passed.length; i++) {
    const f = passed[i] / top;
    if (f > 0.004) bins[f > 0.3 ? 3 : f > 0.1 ? 2 : f > 0.03 ? 1 : 0].push(i);
  }
  ctx.lineCap = "round";
  for (const [ink, wider] of [[inks.paper, 2], [inks.path, 0]]) bins.forEach((list, b) => {
    ctx.strokeStyle = ink; ctx.globalAlpha = 0.35 + 0.2 * b;
    ctx.lineWidth = [0.6, 1.2, 2.4, 4][b] * Math.min(1.5, Math.max(0.5, u / 14)) + wider;
    for (let i = 0; i < list.length; i += 60) {
      ctx.beginPath();
      for (const state of list.slice(i, i + 60)) {
        const k = Math.floor(state / D), cell = L.cell(k);
        if (!shown(k, cell)) continue;
        const [px, py] = view.point(view.centre(cell)), [dx, dy] = view.direction(state - k * D);
        ctx.moveTo(px, py); ctx.lineTo(px + 0.92 * u * dx, py + 0.92 * u * dy);
      }
      ctx.stroke();
    }
  });
  ctx.globalAlpha = 1;
}

/** The applied forces, as arrows that end at their cells. */
export function paintForces(view, loads, inks) {
  const { ctx, u, lattice: L } = view, strongest = Math.max(1e-300, ...loads.map((l) => Math.hypot(...l.force)));
  const every = Math.max(1, Math.ceil(loads.length * 14 / Math.max(60, u * L.shape[0])));
  ctx.lineCap = "round";
  for (const [ink, width] of [[inks.paper, 6], [inks.force, 3]]) {
    ctx.strokeStyle = ink; ctx.lineWidth = width; ctx.beginPath();
    for (let n = every >> 1; n < loads.length; n += every) {
      const { cell, force } = loads[n], size = Math.hypot(...force);
      if (!size) continue;
      const unit = force.map((f) => f / size), length = 16 + 22 * size / strongest;
      const [dx, dy] = unit.length === 2 ? [unit[0], -unit[1]]
        : [0, 1].map((i) => unit.reduce((sum, x, a) => sum + x * view.axes[a][i], 0) * (i ? -1 : 1));
      const [px, py] = view.point(view.centre(cell)), gap = u / 2;
      arrow(ctx, px - dx * (length + gap), py - dy * (length + gap), dx * length, dy * length, 9);
    }
    ctx.stroke();
  }
}

/** A frame round one cell. */
export function paintPick(view, cell, inks) {
  const { ctx, u, lattice: { hexagon } } = view, [px, py] = view.point(view.centre(cell));
  const n = hexagon ? 6 : 4, r = Math.max(6, u) * (hexagon ? 0.5774 : Math.SQRT1_2) + 4;
  for (const [ink, width] of [[inks.paper, 4], [inks.ink, 2]]) {
    ctx.strokeStyle = ink; ctx.lineWidth = width; ctx.beginPath();
    for (let i = 0; i < n; i++) { const turn = (i + (hexagon ? 0 : 0.5)) * 2 * Math.PI / n; ctx.lineTo(px + r * Math.sin(turn), py + r * Math.cos(turn)); }
    ctx.closePath(); ctx.stroke();
  }
}

/** The colour bar below a picture; its label beside it, or above it where there is no room. */
export function paintLegend(view, scale, label, show, inks) {
  const { ctx, w, h } = view;
  ctx.font = "12px system-ui, DejaVu Sans, sans-serif";
  const n = Math.max(110, Math.min(260, 0.45 * w)), text = ctx.measureText(label).width + 8;
  const beside = text + n + 24 < w, x = (w - n + (beside ? text : 0)) / 2, y = h - 34;
  const gradient = ctx.createLinearGradient(x, 0, x + n, 0);
  for (let i = 0; i <= 16; i++) gradient.addColorStop(i / 16, `rgb(${COLOURS[Math.round(i / 16 * 255)]})`);
  ctx.fillStyle = gradient; ctx.fillRect(x, y, n, 10);
  ctx.fillStyle = inks.ink; ctx.textBaseline = "top"; ctx.textAlign = "left";
  ctx.fillText((scale.log ? "≤ " : "") + show(scale.low), x, y + 14);
  ctx.textAlign = "right"; ctx.fillText(show(scale.high), x + n, y + 14);
  ctx.textBaseline = "middle";
  if (beside) ctx.fillText(label, x - 8, y + 5);
  else { ctx.textAlign = "center"; ctx.fillText(label, w / 2, y - 9, w - 12); }
}
