// Linear elasticity on the staggered grid: the twin of kaju.solve on a scene's own square cells.
//
// Unknown is the normal displacement of every face. A cell's stretches follow from its own four
// faces, the shear at a corner from the four faces round it; stiffness is the second derivative of
// their energy. Solved by conjugate gradients with an over-relaxed sweep there and back a step. Lengths
// are in cells, moduli in the largest Young's modulus.

import { AIR, RIGID, ROLLER, SIDES } from "./lattice.js";

const BED = -4;                                // beyond a side that gives way
const [ABSENT, FIXED, ACTIVE] = [0, 1, 2];     // no body beside a face; its place is given; it is free
const REENTRANT = 0.5;                         // share of its shear that a corner with one air cell keeps
const RELAXED = 1.6;                           // of plates of 20² to 150² cells the quickest
const MOST_ITERATIONS = 20000, TOLERANCE = 1e-14, ENOUGH = 1e-9;

/**
 * Displacement (m) and stress (Pa) of a scene of squares as linear elasticity.
 * Returns {displacement: [ux, uy], stress: [sxx, syy, sxy], seconds, iterations, subdivision},
 * arrays by cell key, NaN where there is no body. Members one cell wide carry no shear: then the
 * cells are halved, and the answer is the mean of each cell's children.
 */
export function elasticAnswer(scene, cells, loads) {
  const start = performance.now(), { kind, shape: [nx, ny] } = scene.lattice;
  if (kind !== "square") throw new Error("The elastic answer is for bodies of squares.");
  if (!cells.some((c) => c >= 0)) throw new Error("There is no body.");
  let grid = new StaggeredGrid(scene, cells, loads), k = 1;
  if (grid.isSlender() || !grid.isHeld()) {  // nor does a single rigid cell hold against turning
    k = 2;
    grid = new StaggeredGrid(...halved(scene, cells, loads));
    if (grid.isSlender()) throw new Error("A part of the body is too thin to carry shear.");
  }
  if (!grid.isHeld())
    throw new Error("A part of the body is held by nothing and could move: hold it by a rigid cell or side.");
  const { u, iterations } = grid.solve(), fine = grid.answer(u), Y = ny + 2;
  const mean = (field) => {
    const values = new Float64Array((nx + 2) * Y).fill(NaN);
    for (let x = 0; x < nx; x++) for (let y = 0; y < ny; y++) {
      let sum = 0;
      for (let a = 0; a < k; a++) for (let b = 0; b < k; b++)
        sum += field[(k * x + a + 1) * grid.Y + k * y + b + 1];
      values[(x + 1) * Y + y + 1] = sum / (k * k);
    }
    return values;
  };
  return { displacement: fine.displacement.map(mean), stress: fine.stress.map(mean),
    seconds: (performance.now() - start) / 1000, iterations, subdivision: k };
}

/** The same body and loads on cells half as large. */
function halved(scene, cells, loads) {
  const [nx, ny] = scene.lattice.shape, fine = new Int16Array(4 * nx * ny), found = [];
  for (let x = 0; x < 2 * nx; x++) for (let y = 0; y < 2 * ny; y++)
    fine[2 * ny * x + y] = cells[ny * (x >> 1) + (y >> 1)];
  for (const { cell: [x, y], force, face } of loads)
    for (const a of [0, 1]) for (const b of [0, 1]) {
      if (face >= 0 && [a, b][face >> 1] !== (face & 1)) continue;
      const share = face >= 0 ? 0.5 : 0.25;
      found.push({ cell: [2 * x + a, 2 * y + b], force: force.map((f) => share * f), face });
    }
  const lattice = { ...scene.lattice, shape: [2 * nx, 2 * ny], cell_size: scene.lattice.cell_size / 2 };
  return [{ ...scene, lattice }, fine, found];
}

/** A body on its faces: first those normal to x, then those normal to y, each with a rim. */
export class StaggeredGrid {
  constructor({ lattice, thickness, plane, materials, sides }, cells, loads) {
    const [nx, ny] = lattice.shape;
    this.X = nx + 2, this.Y = ny + 2, this.h = lattice.cell_size;
    this.first = (this.X + 1) * this.Y;          // where the faces normal to y begin
    this.size = this.first + this.X * (this.Y + 1);
    this.kinds = new Int16Array(this.X * this.Y).fill(AIR);
    for (let x = 0; x < nx; x++) for (let y = 0; y < ny; y++)
      this.kinds[(x + 1) * this.Y + y + 1] = cells[x * ny + y];
    this.used = materials.filter((_, m) => materials.length === 1 || cells.includes(m));
    this.unit = Math.max(...this.used.map((m) => m.youngs_modulus));
    this.scale = 1 / (this.unit * thickness);    // metres a newton of scaled displacement
    this.thickness = thickness;
    this.law = materials.map((m) => moduliOf(m.youngs_modulus / this.unit, m.poissons_ratio, plane));
    this.fixed = new Float64Array(this.size), this.spring = new Float64Array(this.size);
    this.force = new Float64Array(this.size);
    this.surfaceShear = new Float64Array((this.X + 1) * (this.Y + 1));
    SIDES[2].forEach((name, s) => this.layRim(s, sides[name]));
    SIDES[2].forEach((name, s) => this.holdSide(s, sides[name]));
    this.findStates();
    this.findCorners();
    for (const load of loads) this.enter(load);
  }

  kind(i, j) { return i < 0 || j < 0 || i >= this.X || j >= this.Y ? AIR : this.kinds[i * this.Y + j]; }
  face(axis, i, j) { return axis ? this.first + i * (this.Y + 1) + j : i * this.Y + j; }
  state(axis, i, j) {
    const inside = i >= 0 && j >= 0 && i < this.X + (axis ? 0 : 1) && j < this.Y + (axis ? 1 : 0);
    return inside ? this.states[this.face(axis, i, j)] : ABSENT;
  }

  /** Say what lies beyond a side: a word, {stiffness} (N/m³) or {displacement} (m). */
  layRim(side, condition = "free") {
    const code = { free: AIR, rigid: RIGID, roller: ROLLER }[condition]
      ?? (condition.stiffness != null ? BED : !condition.displacement ? AIR : condition.displacement.includes("free") ? ROLLER : RIGID);
    const last = side < 2 ? this.Y : this.X;
    for (let k = 1; k < last - 1; k++) {
      const [i, j] = side < 2 ? [side & 1 ? this.X - 1 : 0, k] : [k, side & 1 ? this.Y - 1 : 0];
      this.kinds[i * this.Y + j] = code;
    }
  }
  holdSide(side, condition = "free") {
    const axis = side >> 1, upper = side & 1, across = 1 - axis;
    const line = (component, at, f) => {         // every face of a component on a line along the side
      const count = (axis ? this.X : this.Y) + (component === across ? 1 : 0);
      for (let k = 0; k < count; k++) f(axis ? this.face(component, k, at) : this.face(component, at, k), k);
    };
    const cells = axis ? this.Y : this.X;
    if (condition.stiffness != null)
      line(axis, upper ? cells - 1 : 1, (f) => { this.spring[f] = condition.stiffness * this.h / this.unit; });
    if (!condition.displacement) return;
    const moved = condition.displacement.map((d) => d / this.scale), inner = upper ? cells - 2 : 1;
    line(axis, upper ? cells - 1 : 1, (f, k) => {
      if (this.kind(...(axis ? [k, inner] : [inner, k])) !== RIGID) this.fixed[f] = moved[axis];
    });
    if (condition.displacement[across] !== "free") line(across, upper ? cells - 1 : 0, (f) => { this.fixed[f] = moved[across]; });
  }
  findStates() {
    this.states = new Int8Array(this.size);
    for (let f = 0; f < this.size; f++) {
      const [axis, i, j] = this.place(f);
      if (axis ? j === 0 || j === this.Y : i === 0 || i === this.X) continue;
      const a = this.kind(i - 1 + axis, j - axis), b = this.kind(i, j), body = a >= 0 || b >= 0;
      const rigid = a === RIGID || b === RIGID, roller = a === ROLLER || b === ROLLER;
      this.states[f] = rigid || (roller && body) ? FIXED : body ? ACTIVE : ABSENT;
    }
  }
  /** Shear moduli of the corners: the harmonic mean of four cells, 0 beside air, twice μ at a wall. */
  findCorners() {
    this.shear = new Float64Array((this.X + 1) * (this.Y + 1));
    for (let i = 0; i <= this.X; i++) for (let j = 0; j <= this.Y; j++) {
      let total = 0, filled = 0, rigid = 0, air = 0;
      for (let n = 0; n < 4; n++) {
        const kind = this.kind(i - (n >> 1), j - (n & 1));
        if (kind >= 0) { total += 1 / this.law[kind][2]; filled++; } else if (kind === RIGID) rigid++;
        else if (kind === AIR) air++;
      }
      this.shear[i * (this.Y + 1) + j] = filled + rigid === 4 && filled ? 4 / total
        : filled === 3 && air === 1 ? REENTRANT * 3 / total : 0;
    }
  }

  /** Enter a force by a face of a cell, or in halves by its middle. */
  enter({ cell: [x, y], force, face }) {
    for (const axis of [0, 1]) {
      if (!force[axis]) continue;
      if (face >= 0 && face >> 1 !== axis) { this.drag(axis, face, [x + 1, y + 1], force[axis]); continue; }
      for (const end of [0, 1]) {
        const share = face < 0 ? 0.5 : +((face & 1) === end);
        this.add(axis, shifted([x + 1, y + 1], axis, end), share * force[axis]);
      }
    }
  }
  add(axis, [i, j], value) { this.force[this.face(axis, i, j)] += value; }
  /** Enter a force along a surface: it drags the faces below, and turns the surface's own. */
  drag(axis, side, cell, value) {
    const normal = side >> 1, upper = side & 1, beyond = shifted(cell, normal, 2 * upper - 1);
    const kind = this.kind(...beyond), outward = 2 * upper - 1;
    const free = [AIR, ROLLER, BED].includes(kind);
    const own = free ? 0.5 : kind === RIGID ? 0 : 0.25;  // ground takes all of it
    for (const end of [0, 1]) {
      this.add(axis, shifted(cell, axis, end), own * value);
      this.add(axis, shifted(beyond, axis, end), (0.5 - own) * value);
    }
    if (!free) return;
    for (const end of [0, 1]) {
      const [i, j] = shifted(shifted(cell, axis, end), normal, upper);
      this.surfaceShear[i * (this.Y + 1) + j] += 0.5 * outward * value;
    }
    this.couple(axis, normal, upper, cell, 0.5 * outward * value);
  }
  couple(axis, normal, upper, cell, moment) {
    const surface = shifted(cell, normal, upper), running = [];
    let lost = 0;
    for (const step of [-1, 1]) {
      const beside = shifted(surface, axis, step), runsOn = this.state(normal, ...beside) === ACTIVE;
      const walled = !runsOn && this.kind(...shifted(cell, axis, step)) === RIGID;
      const between = step < 0 ? surface : beside, there = runsOn ? 0.5 : walled ? 1 : 0;
      this.tilt(normal, axis, between, -there * moment);
      if (!runsOn && !walled) lost += 0.5 * moment;
      if (runsOn) running.push(between);
      const edge = edgeBelow(cell, axis, normal, upper, step);
      if (walled && this.along(axis, normal, edge, FIXED)) this.tilt(axis, normal, edge, -0.5 * moment);
    }
    const left = lost ? this.makeUp(axis, normal, upper, cell, lost) : 0;
    for (const between of running) this.tilt(normal, axis, between, -left);
  }
  along(component, across, edge, least) {
    return this.state(component, ...shifted(edge, across, -1)) >= least && this.state(component, ...edge) >= least;
  }
  tilt(component, across, edge, moment) {
    this.add(component, shifted(edge, across, -1), -moment);
    this.add(component, edge, moment);
  }
  makeUp(axis, normal, upper, cell, moment) {
    const edges = [-1, 1].map((step) => edgeBelow(cell, axis, normal, upper, step));
    const turns = edges.map((edge) => this.along(axis, normal, edge, ACTIVE) && this.along(normal, axis, edge, ACTIVE));
    const count = turns.filter(Boolean).length, below = this.kind(...shifted(cell, normal, 1 - 2 * upper));
    const lifts = !count && (below >= 0 || below === RIGID);
    edges.forEach((edge, n) => {
      if (lifts) this.tilt(axis, normal, edge, 0.5 * moment);
      if (!turns[n]) return;
      this.tilt(axis, normal, edge, 0.5 * moment / count);
      this.tilt(normal, axis, edge, -0.5 * moment / count);
    });
    return lifts || count ? 0 : moment;
  }

  /** Every strain: f(stiffness, faces, signs); a cell's two stretches are one call with four faces. */
  eachCell(f) {
    for (let i = 1; i < this.X - 1; i++) for (let j = 1; j < this.Y - 1; j++) {
      const kind = this.kinds[i * this.Y + j];
      if (kind >= 0) f(i, j, this.law[kind], this.face(0, i, j), this.face(0, i + 1, j), this.face(1, i, j), this.face(1, i, j + 1));
    }
  }
  eachCorner(f) {
    for (let i = 1; i < this.X; i++) for (let j = 1; j < this.Y; j++) {
      const shear = this.shear[i * (this.Y + 1) + j];
      if (shear) f(i, j, shear, this.face(0, i, j - 1), this.face(0, i, j), this.face(1, i - 1, j), this.face(1, i, j));
    }
  }

  /** Stiffness of the active faces, and their load with what the fixed ones bring. */
  assemble() {
    const number = new Int32Array(this.size).fill(-1);
    let n = 0;
    for (let f = 0; f < this.size; f++) if (this.states[f] === ACTIVE) number[f] = n++;
    const columns = new Int32Array(9 * n).fill(-1), values = new Float64Array(9 * n), load = new Float64Array(n);
    const put = (f, g, value) => {
      const row = number[f], column = number[g];
      if (row < 0) return;
      if (column < 0) { load[row] -= value * this.fixed[g]; return; }
      let at = 9 * row;
      while (columns[at] >= 0 && columns[at] !== column) at++;
      columns[at] = column;
      values[at] += value;
    };
    const strain = (along, f, g, signed) => {      // along: stiffness of (g - f) with itself
      put(f, f, along); put(g, g, along); put(f, g, -along); put(g, f, -along);
    };
    const mixed = (k, a, b, c, d) => {             // k (b - a)(d - c), both ways round
      put(a, c, k); put(c, a, k); put(b, d, k); put(d, b, k);
      put(a, d, -k); put(d, a, -k); put(b, c, -k); put(c, b, -k);
    };
    this.eachCell((i, j, [c11, c12], a, b, c, d) => { strain(c11, a, b); strain(c11, c, d); mixed(c12, a, b, c, d); });
    this.eachCorner((i, j, m, a, b, c, d) => { strain(m, a, b); strain(m, c, d); mixed(m, a, b, c, d); });
    for (let f = 0; f < this.size; f++) if (number[f] >= 0) {
      if (this.spring[f]) put(f, f, this.spring[f]);
      load[number[f]] += this.force[f];
    }
    return { number, load, matrix: { columns: columns.map((c) => Math.max(c, 0)), values } };
  }
  solve() {
    const { number, load, matrix } = this.assemble(), u = this.fixed.slice(), { x, iterations } = conjugateGradients(matrix, load);
    for (let f = 0; f < this.size; f++) if (number[f] >= 0) u[f] = x[number[f]];
    return { u, iterations };
  }

  /** Displacement of the cells' middles and stress of the cells, in SI, by key. */
  answer(u) {
    const fields = Array.from({ length: 5 }, () => new Float64Array(this.X * this.Y).fill(NaN));
    const [ux, uy, sxx, syy, sxy] = fields, stress = 1 / (this.h * this.thickness);
    const shear = this.surfaceShear.slice();
    this.eachCorner((i, j, m, a, b, c, d) => { shear[i * (this.Y + 1) + j] += m * (u[b] - u[a] + u[d] - u[c]); });
    this.eachCell((i, j, [c11, c12], a, b, c, d) => {
      const key = i * this.Y + j, ex = u[b] - u[a], ey = u[d] - u[c], e = i * (this.Y + 1) + j;
      ux[key] = 0.5 * this.scale * (u[a] + u[b]);
      uy[key] = 0.5 * this.scale * (u[c] + u[d]);
      sxx[key] = stress * (c11 * ex + c12 * ey);
      syy[key] = stress * (c12 * ex + c11 * ey);
      sxy[key] = 0.25 * stress * (shear[e] + shear[e + 1] + shear[e + this.Y + 1] + shear[e + this.Y + 2]);
    });
    return { displacement: [ux, uy], stress: [sxx, syy, sxy] };
  }

  /** Whether two cells that share a face could slide past each other. */
  isSlender() {
    const solid = (k) => k >= 0, rigid = (k) => k === RIGID;
    const corner = (i, j) => this.shear[i * (this.Y + 1) + j] > 0;
    for (const axis of [0, 1]) for (let i = 0; i < this.X - 1 + axis; i++) for (let j = 0; j < this.Y - axis; j++) {
      const [k, l] = [i + 1 - axis, j + axis], a = this.kind(i, j), b = this.kind(k, l), across = 1 - axis;
      if (!((solid(a) && (solid(b) || rigid(b))) || (solid(b) && rigid(a)))) continue;
      if (corner(k, l) || corner(k + axis, l + across)) continue;
      const pinned = (kind, x, y) => rigid(kind) || this.state(across, x, y) !== ACTIVE
        || this.state(across, x + 1 - across, y + across) !== ACTIVE;
      if (!(pinned(a, i, j) && pinned(b, k, l))) return true;
    }
    return false;
  }
  /** Tell whether no part of the body could move without straining anything. */
  isHeld() {
    const part = new Int32Array(this.size).fill(-1), stops = new Map();
    const root = (f) => { while (part[f] !== f) f = part[f] = part[part[f]]; return f; };
    this.eachCell((i, j, law, ...faces) => {       // cells that share a face are of one part
      for (const f of faces) { if (part[f] < 0) part[f] = f; part[root(f)] = root(faces[0]); }
    });
    const hold = (i, j, law, ...faces) => {        // what strains them cannot move where a face is held
      const own = root(faces.find((f) => part[f] >= 0));
      if (!stops.has(own)) stops.set(own, []);
      for (const f of faces) if (this.states[f] === FIXED || this.spring[f]) stops.get(own).push(this.place(f));
    };
    this.eachCell(hold); this.eachCorner(hold);
    return [...stops.values()].every((places) => !freeMotion(places, this.X, this.Y));
  }
  /** Where a face is: [axis, i, j]. */
  place(f) { return f < this.first ? [0, Math.floor(f / this.Y), f % this.Y] : [1, Math.floor((f - this.first) / (this.Y + 1)), (f - this.first) % (this.Y + 1)]; }
}

function moduliOf(E, nu, plane) {
  const shear = E / (2 * (1 + nu));
  if (plane === "strain" && nu >= 0.5) throw new Error("In plane strain Poisson's ratio stays below 0.5.");
  if (plane === "strain") [E, nu] = [E / (1 - nu * nu), nu / (1 - nu)];
  return [E / (1 - nu * nu), nu * E / (1 - nu * nu), shear];
}
function shifted(place, axis, step) { return axis ? [place[0], place[1] + step] : [place[0] + step, place[1]]; }
function edgeBelow(cell, axis, normal, upper, step) {
  return shifted(shifted(cell, axis, +(step > 0)), normal, 1 - upper);
}
/** Whether some rigid motion (shifts along x and y, turn) is stopped by none of the faces at these places. */
function freeMotion(places, X, Y) {
  const span = Math.max(X, Y), G = Array.from({ length: 3 }, () => [0, 0, 0]);
  for (const [axis, i, j] of places) {             // turned about the middle, lengths in spans
    const row = axis ? [0, 1, (i + 0.5 - X / 2) / span] : [1, 0, (Y / 2 - j - 0.5) / span];
    for (let a = 0; a < 3; a++) for (let b = 0; b < 3; b++) G[a][b] += row[a] * row[b];
  }
  for (let k = 0; k < 3; k++) {
    if (G[k][k] < 1e-8) return true;
    for (let a = k + 1; a < 3; a++) for (let b = k + 1; b < 3; b++) G[a][b] -= G[a][k] * G[k][b] / G[k][k];
  }
  return false;
}

// Sparse matrices: nine places a row, those that no face needs hold 0.

/** What a row of a matrix makes of a vector. */
function rowTimes({ columns, values }, row, x) {
  let sum = 0;
  for (let k = 9 * row, end = k + 9; k < end; k++) sum += values[k] * x[columns[k]];
  return sum;
}
function sweep(matrix, inverse, load, x, backward) {
  for (let n = 0; n < x.length; n++) {
    const i = backward ? x.length - 1 - n : n;
    x[i] += RELAXED * (load[i] - rowTimes(matrix, i, x)) * inverse[i];
  }
}
/** To a residual, as the sweeps weigh it, that is a share of the load's. */
function conjugateGradients(matrix, load) {
  const n = load.length, [x, p, q, z, inverse] = Array.from({ length: 5 }, () => new Float64Array(n)), r = load.slice();
  matrix.values.forEach((value, k) => { const i = Math.floor(k / 9); if (matrix.columns[k] === i && value > 0) inverse[i] = 1 / value; });
  const dot = (a, b) => { let sum = 0; for (let i = 0; i < n; i++) sum += a[i] * b[i]; return sum; };
  let rho = 0, first = 0, iterations = 0, left = 0;
  for (; iterations <= MOST_ITERATIONS; iterations++) {
    z.fill(0);
    sweep(matrix, inverse, r, z, false); sweep(matrix, inverse, r, z, true);
    const next = dot(r, z);
    if (!iterations) first = next;
    left = first > 0 ? Math.sqrt(Math.max(next, 0) / first) : 0;
    if (left <= TOLERANCE || iterations === MOST_ITERATIONS) break;
    const beta = iterations ? next / rho : 0;
    rho = next;
    for (let i = 0; i < n; i++) p[i] = z[i] + beta * p[i];
    for (let i = 0; i < n; i++) q[i] = rowTimes(matrix, i, p);
    const curvature = dot(p, q);
    if (!(curvature > 0)) break;
    const step = rho / curvature;
    for (let i = 0; i < n; i++) { x[i] += step * p[i]; r[i] -= step * q[i]; }
  }
  if (!(left <= ENOUGH)) throw new Error("The elastic answer did not settle: the materials differ too much, or the body is hardly held.");
  return { x, iterations };
}
