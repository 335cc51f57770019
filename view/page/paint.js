// Pictures of a body on a canvas: squares, hexagons and cubes, deformed or not, arrows, legend.

export const css = (packed) => `rgb(${packed & 255},${packed >> 8 & 255},${packed >> 16 & 255})`;
export const packed = (c) => (0xff000000 | c[2] << 16 | c[1] << 8 | c[0]) >>> 0;
export const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
const MOST_ARROWS = 500, ROWS = Math.sqrt(3) / 2;
const INKS = ["ink", "soft", "paper", "panel", "line", "hair", "cell", "accent", "onaccent", "wash", "load", "rule", "elastic", "hit", "miss", "false", "awake", "good", "bad"];
export const FONT = '12px system-ui, -apple-system, "Segoe UI", "Noto Sans CJK JP", "DejaVu Sans", sans-serif';
const SIGNED = ["p4", "p3", "p2", "p1", "zero", "o1", "o2", "o3", "o4"];   // what is next to nothing has one colour, whatever its sign

/** The colours of a theme: its inks by name, nine steps for quantities, nine for differences. */
export function inksOf(style) {
  const read = (name) => style.getPropertyValue(`--${name}`).trim() || "#888888";
  const inks = Object.fromEntries(INKS.map((name) => [name, read(name)]));
  inks.steps = Array.from({ length: 9 }, (_, n) => read(`k${n}`));
  inks.differences = SIGNED.map(read);
  inks.packed = Uint32Array.from(inks.steps, (hex) => packed(rgb(hex)));
  inks.packedDifferences = Uint32Array.from(inks.differences, (hex) => packed(rgb(hex)));
  return inks;
}

/** Where a value lies between the ends of a scale, from 0 to 1. */
export function place(value, { low, high, log }) {
  if (log) return value <= low ? 0 : Math.min(1, Math.log(value / low) / Math.log(high / low));
  return Math.max(0, Math.min(1, (value - low) / (high - low || 1)));
}
/** The colour of a value: far from the paper is more; where a scale has two signs, purple is less than nothing. */
export function colourOf(value, scale, inks) {
  const colours = scale.low < 0 ? inks.packedDifferences : inks.packed;
  return colours[Math.min(colours.length - 1, Math.floor(colours.length * place(value, scale)))];
}

/** Give a canvas as many pixels as the screen has: {r, w, h, W, H}, w and h in those of CSS, r of the screen in one. */
export function fitted(canvas) {
  const r = Math.min(2, globalThis.devicePixelRatio || 1), w = canvas.clientWidth, h = canvas.clientHeight;
  const W = Math.max(1, Math.round(w * r)), H = Math.max(1, Math.round(h * r));
  if (canvas.width !== W || canvas.height !== H) { canvas.width = W; canvas.height = H; }
  return { r, w, h, W, H };
}

/** How a lattice in cells becomes pixels of a canvas. */
export class View {
  /** In a box {x, y, w, h} of pixels or all of the canvas; `window`: [x, y, columns, rows] in cells; `foot`: room for a legend. */
  constructor(canvas, lattice, camera, { x = 0, y = 0, w: bw, h: bh, window, tight, foot = tight ? 0 : bw ? 20 : 48 } = {}) {
    const { w, h } = Object.assign(this, { canvas, ctx: canvas.getContext("2d"), lattice, ...fitted(canvas) });
    const [nx, ny] = lattice.shape, margin = tight ? 1 : bw ? 36 : Math.max(34, Math.min(52, 0.07 * Math.min(w, h) + 16));
    if (lattice.dimension === 3) { this.turn(camera, margin); return; }
    this.width = nx + (lattice.hexagon && ny > 1 ? 0.5 : 0);
    this.height = lattice.hexagon ? (ny - 1) * ROWS + 1.1547 : ny;
    const [wx, wy, ww, wh] = window ?? [0, 0, this.width, this.height], across = bw ?? w, up = bh ?? h;
    this.u = Math.max(0.1, Math.min((across - 2 * margin) / ww, (up - 2 * margin - foot) / wh));
    if (this.u > 8) this.u = Math.floor(this.u);             // cells of whole pixels
    this.x0 = Math.round(x + (across - this.u * ww) / 2 - this.u * wx); this.left = this.x0 + this.u * wx; this.right = this.left + this.u * ww;
    this.y0 = Math.round(y + (up - foot + this.u * wh) / 2 + 0.6 * margin + this.u * wy);
  }
  /** The corners of a cell of a size about a point, all in pixels. */
  corners([x, y], size = this.u) {
    const { hexagon } = this.lattice, n = hexagon ? 6 : 4, r = size * (hexagon ? 0.5774 : Math.SQRT1_2);
    return Array.from({ length: n }, (_, i) => (i + (hexagon ? 0 : 0.5)) * 2 * Math.PI / n).map((turn) => [x + r * Math.sin(turn), y + r * Math.cos(turn)]);
  }
  /** Begin a path about a cell. */
  outline(middle, size) {
    this.ctx.beginPath();
    for (const corner of this.corners(middle, size)) this.ctx.lineTo(...corner);
    this.ctx.closePath();
  }
  turn({ yaw, pitch }, margin) {               // cubes: turned about the vertical, then tilted
    const { shape } = this.lattice, [c, s, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    this.axes = [[c, s * sp], [-s, c * sp], [0, cp]];          // right and up of each axis
    this.depth = [s * cp, c * cp, -sp];                        // away from the eye
    this.towards = this.depth.map((x) => -x);
    const spanX = shape.reduce((sum, n, a) => sum + n * Math.abs(this.axes[a][0]), 0);
    const spanY = shape.reduce((sum, n, a) => sum + n * Math.abs(this.axes[a][1]), 0);
    this.u = Math.max(0.1, Math.min((this.w - 2 * margin) / spanX, (this.h - 2 * margin - 48) / spanY));
    const [mx, my] = [0, 1].map((i) => shape.reduce((sum, n, a) => sum + n / 2 * this.axes[a][i], 0));
    this.x0 = this.w / 2 - this.u * mx; this.y0 = (this.h - 48) / 2 + this.u * my;
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
  /** A direction in the picture: of length one (cubes: foreshortened). */
  way(n) { return n.length === 2 ? [n[0], -n[1]] : [0, 1].map((i) => n.reduce((sum, x, a) => sum + x * this.axes[a][i], 0) * (i ? -1 : 1)); }
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
      for (let i = y * W + from; i < y * W + to; i++) ink[i] = colour;   // short runs: quicker than fill()
    }
  }
}
export const SHEET = new Sheet();
const PX = new Float64Array(8), PY = new Float64Array(8);

/** Colour every cell by its value (nothing and asleep look alike), or all that have one by a `tone`; `moved`: {displacement, corners}, in metres. */
export function paintCells(view, kinds, values, scale, inks, { moved = null, factor = 0, cut = null, tone = null } = {}) {
  const { ctx, r, lattice: L } = view, asleep = packed(rgb(inks.cell));
  ctx.setTransform(r, 0, 0, r, 0, 0);
  ctx.clearRect(0, 0, view.w, view.h);
  const awake = tone && packed(rgb(tone)), colour = (k) => (values[k] > 0 || (values[k] < 0 && scale.low < 0) || (values[k] <= 0 && scale.known) ? awake ?? colourOf(values[k], scale, inks) : asleep);
  if (L.dimension === 3) { paintCubes(view, kinds, colour, cut, values, moved, factor); return; }
  SHEET.start(ctx, view.W, view.H);
  (L.hexagon ? fillHexagons : fillQuads)(view, kinds, colour, moved, factor / L.h);
  ctx.putImageData(SHEET.image, 0, 0);
  if (!moved && !L.hexagon && view.u > 9) paintGaps(view, inks);
  hatch(view, kinds, inks);
  if (!moved && !L.hexagon && (scale.low >= 0 || scale.known)) paintFront(view, values, inks);
}

/** The outline of where a value is: the palest colour differs little from a sleeping cell. */
function paintFront(view, values, inks) {
  const { ctx, u, lattice: L } = view, has = (k) => !Number.isNaN(values[k]), r = u / 2;
  if (u < 4) return;
  ctx.strokeStyle = inks.soft; ctx.lineWidth = 1.5; ctx.beginPath();
  L.each((k) => {
    if (!has(k)) return;
    const [x, y] = view.at(...view.centre(L.cell(k)));
    L.normals.forEach(([nx, ny], arm) => {
      if (has(L.neighbour(k, arm))) return;
      ctx.moveTo(x + r * (nx - ny), y - r * (nx + ny)); ctx.lineTo(x + r * (nx + ny), y - r * (ny - nx));
    });
  });
  ctx.stroke();
}

/** Numbers of columns and rows at the body's edge: five or so of each. */
export function paintNumbers({ ctx, u, lattice: L, ...view }, inks) {
  if (L.dimension !== 2 || u < 6) return;
  const [nx, ny] = L.shape, some = (n, all = n <= 10) => Array.from({ length: n }, (_, i) => i).filter((i) => all || (i % 5 === 0 && i < n - 2) || i === n - 1);
  ctx.font = FONT; ctx.fillStyle = inks.soft; ctx.textBaseline = "middle"; ctx.textAlign = "right";
  const row = L.hexagon ? ROWS : 1;
  for (const j of some(ny, ny <= 10 || u >= 15)) ctx.fillText(j, Math.max(18, view.x0 - 12), view.y0 - u * row * (j + 0.5));
  ctx.textAlign = "center";
  for (const i of some(nx)) if (view.x0 + u * i >= view.left - 1 && view.x0 + u * i < view.right) ctx.fillText(i, view.x0 + u * (i + 0.5), Math.min(view.h - 8, view.y0 + 20));
}

function paintGaps(view, inks) {
  const { ctx, lattice: { shape: [nx, ny] } } = view;
  ctx.strokeStyle = inks.paper; ctx.lineWidth = 0.6; ctx.beginPath();
  for (let i = 0; i <= nx; i++) { ctx.moveTo(...view.at(i, 0)); ctx.lineTo(...view.at(i, ny)); }
  for (let j = 0; j <= ny; j++) { ctx.moveTo(...view.at(0, j)); ctx.lineTo(...view.at(nx, j)); }
  ctx.stroke();
}

function fillQuads(view, kinds, colour, moved, f) {
  const { lattice: L, r, u, x0, y0 } = view, [nx, ny] = L.shape, step = L.stride[0];
  for (let x = 0; x < nx; x++) for (let y = 0; y < ny; y++) {
    const k = (x + 1) * step + y + 1;
    if (kinds[k] < 0) continue;
    for (let i = 0; i < 4; i++) {
      let cx = x + (i === 1 || i === 2 ? 1 : 0), cy = y + (i > 1 ? 1 : 0);
      const n = cx * (ny + 1) + cy;
      if (moved) { cx += f * moved.corners[0][n]; cy += f * moved.corners[1][n]; }
      PX[i] = (x0 + u * cx) * r; PY[i] = (y0 - u * cy) * r;
    }
    SHEET.fill(PX, PY, 4, colour(k));
  }
}

function fillHexagons(view, kinds, colour, moved, f) {
  const { lattice: L, r, u } = view, size = u > 6 ? 0.952 * u : u;   // small ones have no gaps
  L.each((k) => {
    if (kinds[k] < 0) return;
    const c = view.centre(L.cell(k));
    if (moved) for (const a of [0, 1]) c[a] += f * moved.displacement[a][k];
    view.corners(view.at(...c), size).forEach(([x, y], i) => { PX[i] = r * x; PY[i] = r * y; });
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
  for (const x of order(nx, 0)) for (const y of order(ny, 1)) for (const z of order(nz, 2)) {
    const cell = [x, y, z], k = L.key(cell), beside = (step) => cell.map((c, a) => c + step[a]);
    if (!shown(k, cell)) continue;
    const hidden = STEPS_OUT.map((step) => L.contains(beside(step)) && shown(L.key(beside(step)), beside(step)));
    if (hidden.every(Boolean)) continue;
    const move = moved ? moved.displacement.map((u) => f * u[k]) : [0, 0, 0];
    fillBox(view, CORNERS.map((corner) => view.point(cell.map((c, a) => c + corner[a] + move[a]))), colour(k), hidden);
  }
  ctx.putImageData(SHEET.image, 0, 0);
}

const CORNERS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]];
const FACES = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [2, 3, 7, 6], [1, 2, 6, 5], [3, 0, 4, 7]], LIGHT = [0.75, 1, 0.7, 0.7, 0.84, 0.84];
const STEPS_OUT = [[0, 0, -1], [0, 0, 1], [0, -1, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0]];   // from a box through each face
/** The faces of a box that are turned to the eye, from its eight corners in pixels. */
export function fillBox(view, corners, colour, hidden = []) {
  for (const [n, face] of FACES.entries()) {
    if (hidden[n]) continue;
    let turn = 0;
    face.forEach((c, i) => { [PX[i], PY[i]] = corners[c].map((v) => v * view.r); });
    for (let i = 0, j = 3; i < 4; j = i++) turn += PX[j] * PY[i] - PX[i] * PY[j];
    if (turn < 0) fillRimmed(view, PX, PY, 4, colour, LIGHT[n]);
  }
}
/** A face with a darker rim, so that single parts can be told: half a pixel of either side is a line of one. */
export function fillRimmed({ r, rim = 1, least = 9 }, px, py, n, colour, light) {
  let wide = 0, mx = 0, my = 0;
  for (let i = 0; i < n; i++) { mx += px[i] / n; my += py[i] / n; wide = Math.max(wide, Math.hypot(px[i] - px[0], py[i] - py[0])); }
  SHEET.fill(px, py, n, shade(colour, wide > least * r ? 0.76 * light : light));
  if (wide <= least * r) return;
  const s = 1 - Math.SQRT2 * rim * r / wide, qx = Float64Array.from(px, (x) => 0.01 + mx + s * (x - mx)), qy = Float64Array.from(py, (y) => 0.01 + my + s * (y - my));   // on no middle of a pixel, where the last bit would decide
  SHEET.fill(qx, qy, n, shade(colour, light));
}

/** A line along what holds a body between two pixels: strokes go out from it, or dots where it rolls. */
export function lineOfGround(ctx, [ax, ay], [bx, by], [nx, ny], rolls, deep = 8) {
  const long = Math.hypot(bx - ax, by - ay), n = Math.max(1, Math.round(long / 8));
  ctx.moveTo(ax, ay); ctx.lineTo(bx, by);
  for (let i = 0; i < n; i++) {
    const x = ax + (bx - ax) * (i + 0.5) / n, y = ay + (by - ay) * (i + 0.5) / n, r = Math.min(2.5, long / 3 || 2.5);
    if (rolls) { ctx.moveTo(x + deep * nx / 2 + r, y - deep * ny / 2); ctx.arc(x + deep * nx / 2, y - deep * ny / 2, r, 0, 7); } else { ctx.moveTo(x, y); ctx.lineTo(x + deep * (nx - Math.abs(ny) / 2), y - deep * (ny - Math.abs(nx) / 2)); }
  }
}

/** Rigid cells and held sides: hatched; rollers: dotted. */
function hatch(view, kinds, inks) {
  const { ctx, u, lattice: L } = view, [nx, ny] = L.shape, step = L.stride[0];
  ctx.strokeStyle = inks.soft; ctx.fillStyle = inks.soft; ctx.lineWidth = 1; ctx.beginPath();
  for (let x = -1; x <= nx; x++) for (let y = -1; y <= ny; y++) {
    const kind = kinds[(x + 1) * step + y + 1];
    if (kind !== -2 && kind !== -3) continue;
    const inside = x >= 0 && y >= 0 && x < nx && y < ny, corner = (x < 0 || x >= nx) && (y < 0 || y >= ny);
    if (corner || (!inside && kinds[(Math.min(Math.max(x, 0), nx - 1) + 1) * step + Math.min(Math.max(y, 0), ny - 1) + 1] < 0)) continue;   // ground under the body alone
    const [cx, cy] = view.at(...view.centre([x, y])), r = u / 2;
    if (inside && kind === -3) { ctx.moveTo(cx + 2, cy); ctx.arc(cx, cy, Math.min(2.5, u / 3), 0, 7); } else if (inside) ctx.fillRect(cx - r, cy - r, u, u);
    if (inside) continue;
    const out = [x < 0 ? -1 : x >= nx ? 1 : 0, y < 0 ? -1 : y >= ny ? 1 : 0], mx = cx - r * out[0], my = cy + r * out[1], [dx, dy] = [r * Math.abs(out[1]), r * Math.abs(out[0])];
    lineOfGround(ctx, [mx - dx, my - dy], [mx + dx, my + dy], out, kind === -3, Math.max(5, Math.min(9, u)));
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
  for (const [ink, width, pulls] of [[inks.paper, 4, null], [inks.load, 1.8, false], [inks.elastic, 1.8, true]]) {
    ctx.strokeStyle = ink; ctx.lineWidth = width; ctx.beginPath();
    ctx.setLineDash(pulls ? [4, 4] : []);      // a form besides the colour
    for (let i = 0, n = 0; i < count; i++) {
      const f = rows.value[i] / top, k = Math.floor(rows.index[i] / C), channel = rows.index[i] - k * C;
      if (f < 0.01 || rows.value[i] < least || (pulls !== null && pulls !== channel >= D)) continue;
      const cell = L.cell(k);
      if (!shown(k, cell)) continue;
      const [px, py] = view.point(view.centre(cell)), [dx, dy] = view.way(L.normals[channel % D]);
      const l = Math.max(5, u * (0.25 + 0.6 * Math.sqrt(f)));
      arrow(ctx, px - dx * l / 2, py - dy * l / 2, dx * l, dy * l, 6);
      if (++n % 50 === 0) { ctx.stroke(); ctx.beginPath(); }   // long paths are slow
    }
    ctx.stroke();
  }
  ctx.setLineDash([]);
}

/** Who handed how much to whom: lines between neighbours, thicker for more, in a few widths at once. */
export function paintPath(view, passed, inks, shown = () => true) {
  const { ctx, u, lattice: L } = view, { D } = L, top = passed.reduce((a, b) => Math.max(a, b), 0) || 1, widths = Array.from({ length: 17 }, () => []);
  for (let i = 0; i < passed.length; i++) if (passed[i] > 0.004 * top && shown(Math.floor(i / D), L.cell(Math.floor(i / D)))) widths[Math.round(16 * Math.sqrt(passed[i] / top))].push(i);
  ctx.lineCap = "round";
  for (const [ink, wider] of [[inks.paper, 2], [inks.ink, 0]]) widths.forEach((list, n) => {
    ctx.strokeStyle = ink; ctx.globalAlpha = 0.35 + 0.6 * n / 16;
    ctx.lineWidth = (0.6 + 3.4 * n / 16) * Math.min(1.5, Math.max(0.5, u / 14)) + wider;
    for (let i = 0; i < list.length; i += 50) {   // long paths are slow
      ctx.beginPath();
      for (const state of list.slice(i, i + 50)) {
        const k = Math.floor(state / D), [px, py] = view.point(view.centre(L.cell(k))), [dx, dy] = view.way(L.normals[state - k * D]);
        ctx.moveTo(px, py); ctx.lineTo(px + 0.92 * u * dx, py + 0.92 * u * dy);
      }
      ctx.stroke();
    }
  });
  ctx.globalAlpha = 1;
}

/** A frame round one cell. */
export function paintPick(view, cell, inks) {
  const { ctx, u } = view;
  view.outline(view.point(view.centre(cell)), Math.max(6, u) + 6);
  for (const [ink, width] of [[inks.paper, 4], [inks.ink, 2]]) { ctx.strokeStyle = ink; ctx.lineWidth = width; ctx.stroke(); }
}

/** Words with a halo of paper, that stand over anything. */
export function paintWord(ctx, text, x, y, ink, inks, { font = FONT, align = "left" } = {}) {
  ctx.font = font; ctx.textAlign = align; ctx.textBaseline = "middle"; ctx.lineJoin = "round";
  ctx.strokeStyle = inks.paper; ctx.lineWidth = 4; ctx.strokeText(text, x, y);
  ctx.fillStyle = ink; ctx.fillText(text, x, y);
}

/** The colour bar below a picture: its name, "linear" or "log", its ends and ticks between them, or `ticks`: [value, words]. */
export function paintLegend({ ctx, w, h }, scale, label, kind, show, inks, ticks = null) {
  const n = Math.max(140, Math.min(300, 0.5 * w)), x = Math.round((w - n) / 2), y = h - 32, { low, high, log } = scale;
  const colours = low < 0 ? inks.differences : scale.whether ? [inks.steps[0], inks.steps.at(-1)] : inks.steps;
  ctx.font = FONT; ctx.fillStyle = inks.ink; ctx.textBaseline = "bottom"; ctx.textAlign = "left";
  const over = Math.max(0, ctx.measureText(label).width + ctx.measureText(kind).width + 10 - n) / 2;   // words wider than the bar reach beyond it on both sides
  ctx.fillText(label, Math.max(4, x - over), y - 3, w - 120);
  ctx.fillStyle = inks.soft; ctx.textAlign = "right"; ctx.fillText(kind, x + n + over, y - 3);
  colours.forEach((colour, i) => { ctx.fillStyle = colour; ctx.fillRect(x + Math.round(i * n / colours.length), y, Math.ceil(n / colours.length), 10); });
  Object.assign(ctx, { textBaseline: "top", fillStyle: inks.soft, strokeStyle: inks.line, lineWidth: 1 }); ctx.strokeRect(x - 0.5, y - 0.5, n + 1, 11);
  let free = -Infinity;
  const word = (v, text) => {
    const at = x + n * place(v, scale), wide = ctx.measureText(text).width / 2, middle = Math.max(x + wide, Math.min(x + n - wide, at));
    if (middle - wide < free) return;
    ctx.textAlign = "center"; ctx.fillText(text, middle, y + 15); ctx.fillRect(Math.round(at), y + 10, 1, 3);
    free = middle + wide + 10;
  };
  if (ticks) { for (const [v, text] of ticks) word(v, text); return; }
  const wideHigh = ctx.measureText(show(high)).width;
  word(low, (log ? "≤ " : "") + show(low));
  const between = log ? [0.01, 0.1].map((f) => f * high) : low < 0 ? [0] : high > 1 && (low + high) % 2 && /^\d+$/.test(show(low) + show(high)) ? [] : [(low + high) / 2];   // of what is counted nothing lies between
  for (const v of between) if (n * place(v, scale) + ctx.measureText(show(v)).width / 2 + 10 < n - wideHigh) word(v, show(v));   // both ends always have theirs
  word(high, (scale.beyond ? "≥ " : "") + show(high));
}
