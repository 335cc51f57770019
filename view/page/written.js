// A run of agents in Python, as the page shows runs: what they tell, generation by generation, in logs.
import { Log, notesOf, Recorded } from "./history.js";
import { appliedLoads, dot, sharesOf } from "./rule.js";

const MOST_GROWTH = 1000, SEED = 1;            // as in kaju

export class Written extends Recorded {
  /** What Python is told of the scene. */
  told(parameters) {
    const { lattice: L, kinds, scene: { rule, materials, thickness } } = this, normal = (n) => L.normals[L.axes[n]], shares = materials.map((m) => sharesOf(rule, m, L.dimension));
    return { lattice: { directions: L.D, direction_names: L.names.map((name) => name.replace("−", "-")), forms: L.hexagon ? 2 : 1, opposite: L.opposite, mirrored: L.mirrored, shape: L.shape, dimension: L.dimension, cell_size: L.h, stride: L.stride,
      steps: L.coordinateSteps.slice(0, L.hexagon ? 2 : 1), arms: Array(L.hexagon ? 2 : 1).fill(Array.from({ length: L.D }, (_, arm) => arm)), beside: L.beside.map((list) => list.toSorted((a, b) => a[0] - b[0])),
      axis_of: Array.from({ length: L.D }, (_, d) => L.axes.findIndex((arm) => arm === d || L.opposite[arm] === d)), along: this.along = L.axes.map((_, a) => L.axes.map((_, n) => dot(normal(n), normal(a)) ** 2)) },
    threshold: rule.threshold, accumulate: rule.accumulate, sense: Boolean(rule.sense), cross_section: L.faceArea(thickness), kinds: Array.from(kinds), parameters, seed: parameters.seed ?? SEED,
    materials: materials.map((m) => [m.name, m.youngs_modulus, m.poissons_ratio]), shares: shares.map((s, n) => [s.own, s.forward, 0, s.friction, s.poisson, s.beta * materials[n].poissons_ratio]),
    loads: this.applied = appliedLoads(this.scene, L, kinds, this.stage).map(([k, state, size]) => [L.cell(k), state, size]) };
  }
  /** Begin with what the code declares: `python` holds the functions of engine.py. */
  begin(python, states) {
    Object.assign(this, { python, states, known: {}, pending: Infinity, absorbed: [], ended: [] });
    for (const [name, width] of Object.entries(notesOf(this))) {
      this[name] = new Log(); this.known[name] = new Float64Array(this.lattice.size * width);
    }
  }
  book(name, place, value) {
    const known = this.known[name], change = value - known[place];
    known[place] = value;
    if (change) this[name].push(place, change);
  }
  step() {
    const { lattice: { D, axes, h }, C, states, along } = this, A = axes.length, [born, taken, back, done, known, pending, absorbed, ended] = this.python.generation(), sums = new Map();
    this.generation++;
    for (const [k, state, load] of taken) sums.set(k * C + state, (sums.get(k * C + state) ?? 0) + load);
    for (const [place, load] of sums) this.taken.push(place, load);
    for (const [k, load] of back) this.returned.push(k, load);
    for (const [k, woken] of born) { this.spawn[k] = this.generation; this.woken[k] = woken; this.agents++; }
    for (const [k, dropped, ...rest] of done) {
      const passed = rest.splice(0, D), kept = rest.splice(0, A), short = rest.splice(0, A), [wide] = rest;
      this.book("dropped", k, dropped);
      passed.forEach((load, arm) => this.book("passed", k * D + arm, load));
      kept.forEach((load, a) => this.book("kept", k * A + a, load));
      along.forEach((row, a) => this.book("stretch", k * A + a, h * short.reduce((sum, s, n) => sum + s * (wide * (1 - row[n]) - row[n]), 0)));
    }
    for (const [n, k, value] of known) this.book(`state ${states[n][0]}`, k, Number(value));
    for (const name of ["taken", ...Object.keys(this.known)]) this[name].close();
    this.absorbed.push(absorbed); this.ended.push(ended); this.alive.push(this.agents); this.waits.push([...sums.values()].reduce((a, b) => a + b, 0));
    this.pending = pending;
  }
  get over() { return this.pending === 0 || this.grown; }
  get grown() { return this.generation > 0 && !(this.pending <= MOST_GROWTH * this.applied.reduce((sum, [, , size]) => sum + size, 0)); }
  /** What the page shows of it: plain data. */
  get shown() {
    const { spawn, woken, alive, waits, agents, generation, states, pending, grown } = this, logs = Object.fromEntries(["taken", ...Object.keys(this.known)].map((name) => [name, { ...this[name] }]));
    const [kept, dropped, [air, ground, rollers], returned, absorbed, taken, lost, idle] = this.python.totals(), sum = ({ value, n }) => value.subarray(0, n).reduce((a, b) => a + b, 0);
    return { run: { spawn, woken, alive, waits, agents, generation, states, grown, ended: dropped ? this.ended : null, absorbed: absorbed ? this.absorbed : null, ...logs }, end: { agents, generations: generation, taken, kept, passed: sum(this.passed), dropped, air, ground, rollers, returned, absorbed, lost, idle, pending } };
  }
}
