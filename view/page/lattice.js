// Cells, their neighbours and their numbers; the twin of kaju's Lattice.

export const AIR = -1, RIGID = -2, ROLLER = -3;

const HEXAGON_STEPS = [                        // by parity of the row, over arm k * 60 degrees
  [[1, 0], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1]],
  [[1, 0], [1, 1], [0, 1], [-1, 0], [0, -1], [1, -1]],
];
export const SIDES = { 2: ["left", "right", "bottom", "top"],
  3: ["left", "right", "front", "back", "bottom", "top"] };
const range = (n, f) => Array.from({ length: n }, (_, i) => f(i));

export class Lattice {
  constructor({ kind, shape, cell_size: size }) {
    const hexagon = kind === "hexagon", dimension = shape.length, D = hexagon ? 6 : 2 * dimension;
    Object.assign(this, { kind, hexagon, shape, h: size, dimension, D });
    this.padded = shape.map((n) => n + 2);
    this.size = this.padded.reduce((a, b) => a * b, 1);
    this.stride = this.padded.map((_, a) => this.padded.slice(a + 1).reduce((x, y) => x * y, 1));
    this.normals = range(D, (d) => hexagon ? [Math.cos(d * Math.PI / 3), Math.sin(d * Math.PI / 3)]
      : shape.map((_, a) => (a === d >> 1 ? (d & 1 ? 1 : -1) : 0)));
    this.coordinateSteps = hexagon ? HEXAGON_STEPS : [this.normals, this.normals];
    this.steps = this.coordinateSteps.map((steps) => Int32Array.from(steps,
      (step) => step.reduce((k, c, a) => k + c * this.stride[a], 0)));
    this.opposite = range(D, (d) => (hexagon ? (d + 3) % 6 : d ^ 1));
    // mirrored[n][d]: direction d seen in a wall with normal n
    this.mirrored = range(D, (n) => range(D, (d) =>
      hexagon ? (2 * n + 3 - d + 12) % 6 : d >> 1 === n >> 1 ? d ^ 1 : d));
    // beside[d]: [arm, friction weight, Poisson weight]
    this.beside = range(D, (d) => hexagon
      ? [[1, 1], [2, 0], [4, 0], [5, 1]].map(([turn, f]) => [(d + turn) % 6, f, 0.75])
      : range(D, (arm) => [arm, 1, 1]).filter(([arm]) => arm >> 1 !== d >> 1));
    this.axes = hexagon ? [0, 1, 2] : range(dimension, (a) => 2 * a + 1);
    this.names = range(D, (d) => (hexagon ? `${60 * d}°` : "−+"[d & 1] + "xyz"[d >> 1]));
    this.sides = SIDES[dimension];
  }
  key(cell) {
    let k = 0;
    for (let a = 0; a < this.dimension; a++) k += (cell[a] + 1) * this.stride[a];
    return k;
  }
  cell(key) { return this.stride.map((s, a) => Math.floor(key / s) % this.padded[a] - 1); }
  parity(key) { return this.hexagon ? (key % this.padded[1] - 1) & 1 : 0; }
  neighbour(key, arm) { return key + this.steps[this.parity(key)][arm]; }
  contains(cell) { return cell.every((c, a) => c >= 0 && c < this.shape[a]); }
  faceArea(thickness) {
    return this.dimension === 3 ? this.h ** 2
      : this.hexagon ? this.h ** 2 * (Math.sqrt(3) / 2) * thickness / this.h : this.h ** 2 * thickness / this.h;
  }
  /** Call f(key, index) for every cell of the array, in C order. */
  each(f) {
    const { shape, stride } = this, [nx, ny] = shape, nz = shape[2] ?? 1, step = stride[1];
    for (let x = 0, i = 0; x < nx; x++) for (let y = 0; y < ny; y++) {
      const foot = (x + 1) * stride[0] + (y + 1) * step + (this.dimension === 3 ? 1 : 0);
      for (let z = 0; z < nz; z++) f(foot + z, i++);
    }
  }
  /** Kinds by key, the rim included, from the array's cells and what holds its sides. */
  kinds(cells, sides) {
    const beyond = this.sides.map((name) => ({ rigid: RIGID, roller: ROLLER })[sides[name]] ?? AIR);
    const kinds = new Int16Array(this.size);
    this.stride.forEach((step, a) => {         // of two sides (outside a corner) the later counts
      for (let k = 0; k < this.size; k++) {
        const at = Math.floor(k / step) % this.padded[a];
        if (at === 0) kinds[k] = beyond[2 * a]; else if (at > this.shape[a]) kinds[k] = beyond[2 * a + 1];
      }
    });
    this.each((k, i) => { kinds[k] = cells[i]; });
    return kinds;
  }
}
