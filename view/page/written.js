// A run whose emissions come from agents in Python: their loads meet, end and come back as in every run of the page.
import { Log } from "./history.js";
import { appliedLoads, dot, emissionsOf, MAGNITUDES, sharesOf, Tally, Twin } from "./rule.js";

const MOST_GROWTH = 1000, SEED = 1;            // as in kaju

/** What Python is told of the scene. */
export function toldOf({ scene, lattice: L, kinds }, parameters) {
  const { rule, materials } = scene, normal = (n) => L.normals[L.axes[n]];
  return { lattice: { directions: L.D, opposite: L.opposite, mirrored: L.mirrored, shape: L.shape, dimension: L.dimension, cell_size: L.h,
    axis_of: Array.from({ length: L.D }, (_, d) => L.axes.findIndex((arm) => arm === d || L.opposite[arm] === d)),
    along: L.axes.map((_, a) => L.axes.map((_, n) => dot(normal(n), normal(a)) ** 2)) },
  threshold: rule.threshold, accumulate: rule.accumulate, sense: Boolean(rule.sense), cross_section: L.faceArea(scene.thickness),
  materials: materials.map((m) => [m.name, m.youngs_modulus, m.poissons_ratio]), parameters, seed: SEED,
  shares: materials.map((m) => { const s = sharesOf(rule, m, L.dimension); return [s.own, s.forward, 0, s.friction, s.poisson, s.beta * m.poissons_ratio]; }) };
}

export class Written extends Twin {
  /** `python` holds the functions of engine.py; `told` is what it was told and what it declares. */
  begin(python, told) {
    const { lattice: { size, D, axes } } = this, states = told.states.map(([name]) => `state ${name}`);
    Object.assign(this, { python, told, states: told.states, awake: new Set(), boundaries: new Set(), leavers: [], known: {} });
    for (const [name, width] of [["dropped", 1], ["passed", D], ["kept", axes.length], ["stretch", axes.length], ...states.map((s) => [s, 1])]) {
      this[name] = new Log();
      this.sums[name] = new Tally(size * width); this.known[name] = new Float64Array(size * width);
    }
    if (this.leaving) this.leaving.asCame = true;
    for (const [k, , magnitude] of appliedLoads(this.scene, this.lattice, this.kinds, this.stage)) if (!this.leaving && magnitude > this.scene.rule.threshold) this.wake(k);
    this.deliver();
    return this;
  }
  get grown() { return !(this.pending <= MOST_GROWTH * this.applied); }
  wake(k, known = this.awake) {
    if (known.has(k)) return;
    known.add(k);
    this.python.wake(k, this.kinds[k], this.lattice.cell(k));
  }
  /** The emissions of a rule with shares: own, forward, backward, friction, poisson. */
  emissions([, forward, backward, friction, poisson], direction, pull) {
    const { lattice: L } = this, { D } = L, beside = L.beside.map((list) => list.toSorted((a, b) => a[0] - b[0]));
    const rows = emissionsOf({ ...L, beside }, { forward, backward, friction, poisson }, pull ? direction + D : direction);
    return rows.map(([arm, channel, share]) => [arm, channel % D, share, this.C > D && channel >= D ? 1 : 0]);
  }
  /** A load leaves an agent over an arm; whether it is large enough to go on. */
  hand(k, arm, direction, size, copies, pull) {
    const { lattice: L, kinds, C, post, leaving } = this, { accumulate, threshold } = this.scene.rule;
    if (!(size > (accumulate ? 0 : threshold))) return false;
    const to = L.neighbour(k, arm), channel = pull ? direction + L.D : direction;
    if (kinds[to] < 0) this.wake(to, this.boundaries); else if (!accumulate) this.wake(to);
    if (kinds[to] >= 0) post.add(to * C + channel, accumulate ? 0 : post.number(size), accumulate ? size * copies : copies, 1 << L.opposite[arm]);
    else if (accumulate) leaving.add((k * L.D + arm) * C + channel, 0, size * copies, 0);
    else this.leavers.push([k, arm, channel, size, copies]);
    return true;
  }
  wakers(k) { return this.lattice.opposite.map((_, arm) => arm).filter((arm) => this.woken[k] >> arm & 1).map((arm) => this.lattice.neighbour(k, arm)); }
  step() {
    const { told, waiting: w, C } = this;
    this.acting = [...this.awake].filter((k) => this.full.has(k));
    this.held = null;
    if (told.ordered) {                        // who is not chosen keeps what waits
      this.acting = this.python.choose(this.acting);
      const now = new Set(this.acting), acts = (i) => now.has(Math.floor(w.state[i] / C)), all = Array.from({ length: w.n }, (_, i) => i);
      const part = (rows) => ({ ...w, n: rows.length, ...Object.fromEntries(["state", "number", "magnitude", "copies", "bits"].map((name) => [name, w[name].constructor.from(rows, (i) => w[name][i])])) });
      this.held = part(all.filter((i) => !acts(i))); this.waiting = part(all.filter(acts));
    }
    return super.step();
  }
  emit() {
    const { held, python, post, generation } = this;
    for (let i = 0; i < (held?.n ?? 0); i++) post.add(held.state[i], post.number(held.magnitude[i]), held.copies[i], 0);
    for (const k of this.acting) python.act(generation, k);
    for (const load of this.leavers.splice(0)) this.give(...load);
    for (const k of this.told.states.length ? this.awake : this.acting) this.note(k);
  }
  /** Boundaries answer in Python where they are a pupil's own. */
  give(k, arm, channel, size, copies) {
    const { lattice: L, kinds, C, post } = this, to = L.neighbour(k, arm), added = Boolean(this.leaving), load = size * copies;
    if (!this.told.walls.includes(kinds[to])) { this.back(k, arm, channel, added ? 0 : post.number(size), added ? size : copies, load); return; }
    const back = this.python.answer(to, channel % L.D, size, copies, channel < L.D ? "push" : "pull", arm);
    this.sums.given.add(to, load);
    if (!back) return;
    const [direction, magnitude, number, sense] = back, state = k * C + direction + (sense === "pull" ? L.D : 0);
    this.sums.returned.add(k, magnitude * number);
    post.add(state, added ? 0 : post.number(magnitude), added ? magnitude * number : number, 0);
  }
  giveBack() {
    const { lattice: { D }, C } = this, rows = this.leaving.judged(this.scene.rule.threshold, (load) => { this.quiet += load; });
    for (let i = 0; i < rows.n; i++) {
      const place = Math.floor(rows.state[i] / C), k = Math.floor(place / D);
      this.give(k, place - k * D, rows.state[i] - place * C, rows.magnitude[i], 1);
    }
  }
  arrive() { super.arrive(); if (this.python) this.deliver(); }
  /** Put what has arrived into the agents' boxes, in the order in which it came. */
  deliver() {
    const { waiting: w, post, C, lattice: { D } } = this, code = (i) => w.state[i] * MAGNITUDES + w.number[i];
    const came = post.accumulate ? Array.from(post.tally.met.subarray(0, post.tally.n), (s) => s * MAGNITUDES) : [...post.copies.keys()];
    const rank = new Map(came.map((c, n) => [c, n])), rows = Array.from({ length: w.n }, (_, i) => i).sort((a, b) => rank.get(code(a)) - rank.get(code(b)));
    this.full = new Set();
    for (const i of rows) {
      const k = Math.floor(w.state[i] / C), channel = w.state[i] - k * C;
      this.wake(k); this.full.add(k);
      this.python.put(k, channel % D, w.magnitude[i], w.copies[i], channel < D ? "push" : "pull");
    }
  }
  /** Book what an agent has done since it was last asked. */
  note(k) {
    const { lattice: { D, axes, h }, told } = this, A = axes.length, all = this.python.doing(k), [wide] = all.splice(1 + D + 2 * A, 1);
    const short = all.slice(1 + D + A, 1 + D + 2 * A);
    const book = (name, place, value) => { const change = value - this.known[name][place]; this.known[name][place] = value; if (change) this.sums[name].add(place, change); };
    book("dropped", k, all[0]);
    for (let arm = 0; arm < D; arm++) book("passed", k * D + arm, all[1 + arm]);
    told.lattice.along.forEach((row, a) => {
      book("kept", k * A + a, all[1 + D + a]);
      book("stretch", k * A + a, h * short.reduce((sum, s, n) => sum + s * (wide * (1 - row[n]) - row[n]), 0));
    });
    told.states.forEach(([name], n) => book(`state ${name}`, k, all[1 + D + 2 * A + n]));
  }
  /** What the page shows of it: plain data. */
  get shown() {
    const { spawn, woken, alive, waits, agents, generation, grown, states } = this, logs = Object.keys(this.known).concat("taken", "returned");
    const [kept, dropped] = this.python.totals(), sum = (name) => this[name].value.subarray(0, this[name].n).reduce((a, b) => a + b, 0), arrived = sum("given");
    return { run: { spawn, woken, alive, waits, agents, generation, grown, states, ...Object.fromEntries(logs.map((name) => [name, { ...this[name] }])) },
      end: { agents, generations: generation, taken: sum("taken"), kept, passed: sum("passed"), dropped: dropped + this.quiet, arrived, returned: sum("returned"), absorbed: arrived - sum("returned"), pending: this.pending } };
  }
}
