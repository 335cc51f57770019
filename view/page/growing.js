// A body that grows: the twin of kaju.GrowthModel, with the mechanics of elastic.js. Every cell is
// of a kind of its own, and each solution starts from the displacement before.
import { conjugateGradients, Multigrid, StaggeredGrid } from "./elastic.js";

const TIGHT = 1e-6, LEAST_DENSITY = 1e-3, MOST_STEP = 0.3;
const [GAIN, LAZY, POWERS, RISING] = [0.25, 0.05, [1, 3], [40, 100]];   // of remodelling
const [POWER, MOVE] = [3, 0.2];                // of least compliance
const within = (v, low, high) => Math.min(Math.max(v, low), high);

/**
 * Densities of the cells of material, row by row, at first and after every step:
 * {density, compliance (J), volume, change, outcome: "" | "rest" | "end"}.
 */
export function* grown(scene, cells, loads) {
  const body = new GrowingCells(scene, cells, loads), { rule, volume, radius, steps, at_rest: rest, tolerance } = scene.growth;
  const bone = rule === "remodelling", least = bone ? 1e-6 : 1e-9, patience = bone ? RISING[1] : 0;
  const penalty = (step) => (bone ? POWERS[0] + (POWERS[1] - POWERS[0]) * within((step - RISING[0]) / (RISING[1] - RISING[0]), 0, 1) : POWER);
  const around = body.means(bone ? null : radius), size = scene.lattice.cell_size ** 2 * scene.thickness;
  let design = new Float64Array(body.count).fill(volume), stimulus = 0;
  for (let step = 0, change = 0; ; step++) {
    const power = penalty(step), density = bone ? design : around.of(design).map((x) => Math.min(x, 1));
    const outcome = step && step >= patience && change <= rest ? "rest" : step >= steps ? "end" : "";
    const stiffness = density.map((x) => least + (1 - least) * x ** power), { energy, compliance } = body.feel(stiffness, outcome ? Math.min(TIGHT, tolerance) : tolerance);
    const filled = density.reduce((sum, x) => sum + x, 0);
    yield { density, compliance, volume: filled / body.count, change, outcome };
    if (outcome) return;
    stimulus ||= energy.reduce((sum, e) => sum + e, 0) / (filled * size);
    const next = bone ? remodelled(design, around.of(energy), around.of(density).map((x) => Math.max(x, LEAST_DENSITY) * size), penalty(step + 1), stimulus)
      : stiffer(design, energy.map((e, n) => 2 * (1 - least) * power * density[n] ** (power - 1) * e / stiffness[n]), around, volume);
    change = next.reduce((most, x, n) => Math.max(most, Math.abs(x - design[n])), 0);
    design = next;
  }
}

/** Optimality criteria: a cell grows by the root of what the compliance falls by it, beside a price that keeps the volume. */
function stiffer(design, gain, around, volume) {
  const weight = around.back(design.map(() => 1)), wish = around.back(gain).map((g, n) => design[n] * Math.sqrt(Math.max(g, 0) / weight[n]));
  const most = wish.reduce((a, b) => Math.max(a, b), 0) || 1, low = design.map((x) => Math.max(x - MOVE, 0)), high = design.map((x) => Math.min(x + MOVE, 1));
  const grow = (price) => wish.map((w, n) => within(w / most * price, low[n], high[n]));
  let below = -200, above = 200;               // logarithms of the price between which it lies
  while (above - below > 1e-15 * Math.max(1, Math.abs(above))) {
    const middle = (below + above) / 2, filled = grow(Math.exp(middle)).reduce((sum, x, n) => sum + weight[n] * x, 0);
    if (middle === below || middle === above) break;
    if (filled > volume * design.length) above = middle; else below = middle;
  }
  return grow(Math.exp((below + above) / 2));
}
/** Bone's rule: towards the energy that a unit of mass shall save, at rest in a lazy zone. */
function remodelled(design, energy, filled, power, stimulus) {
  return design.map((x, n) => {
    const missing = Math.log(Math.max(power * energy[n] / filled[n] / stimulus, 1e-9)), far = Math.sign(missing) * Math.max(Math.abs(missing) - LAZY, 0);
    return within(x * Math.exp(within(GAIN * far, -MOST_STEP, MOST_STEP)), LEAST_DENSITY, 1);
  });
}

/** A grid whose cells of material are numbered row by row, each a kind of its own. */
class GrowingCells extends StaggeredGrid {
  constructor(scene, cells, loads) {
    super(scene, cells, loads);
    this.numbers = this.kinds.map((_, key) => key).filter((key) => this.kinds[key] >= 0);
    this.count = this.numbers.length;
    if (!this.count) throw new Error("There is no body.");
    if (!this.force.some(Boolean)) throw new Error("Nothing grows without a load.");
    if (this.fixed.some(Boolean)) throw new Error("A body grows under forces, not at a side that is moved.");
    if (this.isSlender()) throw new Error("A part of the body is too thin to carry shear.");
    if (!this.isHeld()) throw new Error("A part of the body is held by nothing and could move: hold it by a rigid cell or side.");
    this.whole = Array.from(this.numbers, (key) => this.law[this.kinds[key]]);
    this.numbers.forEach((key, n) => { this.kinds[key] = n; });
  }
  /** Solve with a stiffness a cell: the energy of each (J), with its share of the corners round it by their compliances, and F·u. */
  feel(stiffness, tolerance) {
    this.law = this.whole.map((law, n) => law.map((modulus) => modulus * stiffness[n]));
    this.findCorners();
    const { number, load, matrix } = this.assemble();
    this.places ??= [...number.keys()].filter((f) => number[f] >= 0).map((f) => this.place(f));
    this.parents = new Multigrid(matrix, this.places, this.parents);
    const { x, left } = conjugateGradients(matrix, load, this.parents, this.moved, tolerance);
    this.moved = x;
    const u = this.fixed.map((v, f) => (number[f] < 0 ? v : x[number[f]])), energy = new Float64Array(this.count), half = 0.5 * this.scale;
    this.eachCell((i, j, [c11, c12], a, b, c, d) => {
      const ex = u[b] - u[a], ey = u[d] - u[c];
      energy[this.kind(i, j)] += half * (c11 * (ex * ex + ey * ey) + 2 * c12 * ex * ey);
    });
    this.eachCorner((i, j, m, a, b, c, d) => {
      const round = [this.kind(i, j), this.kind(i - 1, j), this.kind(i, j - 1), this.kind(i - 1, j - 1)].filter((n) => n >= 0), gamma = u[b] - u[a] + u[d] - u[c];
      const total = round.reduce((sum, n) => sum + 1 / this.law[n][2], 0);
      for (const n of round) energy[n] += half * m * gamma * gamma / (this.law[n][2] * total);
    });
    return { energy, compliance: this.scale * x.reduce((sum, v, n) => sum + v * (load[n] + left[n]), 0) };
  }
  /** Means over the cells within a radius, or (null) over a cell as much as all beside it; `back`: their derivative by the cells. */
  means(radius) {
    const reach = radius === null ? 1 : Math.max(Math.ceil(radius) - 1, 0), list = [];
    const weigh = (dx, dy) => (radius === null ? [4, 1, 0][Math.abs(dx) + Math.abs(dy)] : Math.max(Math.max(radius, 1) - Math.hypot(dx, dy), 0));
    for (let dx = -reach; dx <= reach; dx++) for (let dy = -reach; dy <= reach; dy++) if (weigh(dx, dy) > 0) list.push([dx, dy, weigh(dx, dy)]);
    const sums = (values) => Float64Array.from(this.numbers, (key) => {
      const i = Math.floor(key / this.Y), j = key % this.Y;
      let sum = 0;
      for (const [dx, dy, weight] of list) { const n = this.kind(i + dx, j + dy); if (n >= 0) sum += weight * values[n]; }
      return sum;
    });
    const whole = sums(new Float64Array(this.count).fill(1));
    return { of: (values) => sums(values).map((v, n) => v / whole[n]), back: (values) => sums(values.map((v, n) => v / whole[n])) };
  }
}
