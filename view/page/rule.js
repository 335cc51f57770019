// The prescribed rule, one generation at a time: the twin of kaju's LoadModel on arrays. The same
// loads are made, judged and added up in the same order, so that loads exactly at γ end alike.
import { AIR, RIGID, ROLLER } from "./lattice.js";
import { doubled, Log, Recorded } from "./history.js";

/** What an agent of a material keeps and passes on of 1 N. */
export function sharesOf(rule, material, dimension) {
  const { alpha, beta } = rule.materials?.[material.name] ?? rule;
  const [own, forward, friction] = alpha ?? [0.5, 0.5, dimension === 2 ? 0.25 : 0.125];
  return { own, forward, friction, poisson: (1 - beta) * material.poissons_ratio * own, beta };
}

/** Emissions by material and channel, [arm, channel, share] in rows and in flat columns; what boundaries make of a channel. */
export class Transfer {
  constructor(scene, lattice) {
    const { D } = lattice, sense = Boolean(scene.rule.sense);
    this.C = sense ? 2 * D : D;
    this.shares = scene.materials.map((m) => sharesOf(scene.rule, m, lattice.dimension));
    const rows = this.rows = this.shares.flatMap((s) => Array.from({ length: this.C }, (_, c) =>
      emissionsOf(lattice, s, c)));
    this.most = Math.max(1, ...rows.map((row) => row.length));
    const column = (Type, n) => Type.from(rows.flatMap((row) =>
      Array.from({ length: this.most }, (_, e) => (row[e] ? row[e][n] : 0))));
    this.arm = column(Int8Array, 0); this.channel = column(Int8Array, 1);
    this.share = column(Float64Array, 2);
    this.distinct = [...new Set(this.share)];
    this.number = Int32Array.from(this.share, (x) => this.distinct.indexOf(x));
    const emitted = this.emitted = rows.map((row) => row.reduce((sum, e) => sum + e[2], 0));   // by material and channel
    this.worst = Math.floor(emitted.indexOf(Math.max(...emitted)) / this.C);
    this.largest = this.share.reduce((a, b) => Math.max(a, b), 0);
    this.undiminished = rows.every((row) => row.some((e) => e[2] >= 1));   // whether every load has a share that is as large as it
    const turnedBy = (kind) => Array.from({ length: D }, (_, arm) => Int8Array.from({ length: this.C }, (_, c) => turn(lattice, kind, arm, c, sense)));
    this.turned = Object.fromEntries([AIR, RIGID, ROLLER].map((kind) => [kind, turnedBy(kind)]));
  }
}

/** What a load sends out: a push travels along its force, a pull against it. */
function emissionsOf({ D, opposite, beside }, shares, channel) {
  const pull = channel >= D, ahead = pull ? opposite[channel - D] : channel;
  const list = [[ahead, channel, shares.forward]], outPulls = pull === shares.poisson >= 0;
  for (const [arm, friction, poisson] of beside[ahead]) {
    list.push([arm, channel, shares.friction * friction]);
    list.push([arm, outPulls ? opposite[arm] + D : arm, Math.abs(shares.poisson) * poisson]);
  }
  return list.filter((emission) => emission[2] > 0);
}

/** In which channel a load comes back that went over an arm to a boundary. */
function turn({ D, opposite, mirrored }, kind, arm, channel, sense) {
  const pull = channel >= D ? D : 0, d = channel - pull;
  if (kind === RIGID) return opposite[d] + pull;
  if (kind === ROLLER) return mirrored[arm][d] + pull;
  const along = sense && (pull ? opposite[d] : d) === arm;
  return along ? (pull ? d : d + D) : channel;
}

/** A force as loads along the lattice's directions: [direction, magnitude]. */
export function splitForce(lattice, force) {
  if (!lattice.hexagon) return force.flatMap((f, a) => (f ? [[2 * a + (f > 0 ? 1 : 0), Math.abs(f)]] : []));
  const full = 2 * Math.PI, angle = (Math.atan2(force[1], force[0]) % full + full) % full;
  const sector = Math.min(Math.floor(angle / (Math.PI / 3)), 5), rest = angle - sector * (Math.PI / 3);
  const size = Math.hypot(...force) / Math.sin(Math.PI / 3), next = (sector + 1) % 6;
  return [[sector, size * Math.sin(Math.PI / 3 - rest)], [next, size * Math.sin(rest)]]
    .sort((a, b) => a[0] - b[0]).filter((load) => load[1] !== 0);
}

/** The loads of a stage: [key, channel, magnitude], in the order of kaju's `applied`. */
export function appliedLoads(scene, lattice, kinds, stage = scene.stages) {
  const loads = [];
  for (const load of scene.loads) {
    const factor = Math.min(1, stage / load.steps), k = lattice.key(load.cell);
    if (kinds[k] < 0) continue;
    for (const [d, magnitude] of splitForce(lattice, load.force.map((f) => factor * f))) {
      const pull = scene.rule.sense && pulls(lattice, kinds, load, k, d);
      loads.push([k, pull ? d + lattice.D : d, magnitude]);
    }
  }
  return loads;
}

/** Whether a part of a force pulls: as the scene says, or out of the body over its side. */
function pulls(lattice, kinds, { sense, face }, k, d) {
  if (sense === "push" || sense === "pull") return sense === "pull";
  if (sense === "side") return face >= 0 && dot(lattice.normals[d], lattice.normals[face]) > 1e-9;
  return kinds[lattice.neighbour(k, d)] === AIR && kinds[lattice.neighbour(k, lattice.opposite[d])] >= 0;
}
export const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);

/** The face by which a force enters a cell for which none is named; -1: the cell's middle. */
export function entering(lattice, kinds, k, force) {
  const along = lattice.normals.map((n) => dot(n, force)), least = Math.min(...along) + 1e-9;
  let faces = along.flatMap((x, d) => (x <= least ? [d] : []));
  if (faces.length > 1) {
    const exposed = faces.filter((d) => kinds[lattice.neighbour(k, d)] < 0);
    if (exposed.length) faces = exposed;
  }
  return faces.length === 1 ? faces[0] : -1;
}

const MAGNITUDES = 2 ** 20;                    // so many different magnitudes may travel at once

/** Loads on their way, merged: equal ones are counted (one by one), or all are added up. */
class Post {
  constructor(states, accumulate) {
    this.accumulate = accumulate;
    this.tally = accumulate ? new Tally(states) : null; this.bits = new Uint8Array(states);
    this.clear();
  }
  clear() {
    this.tally?.clear(); this.bits.fill(0);
    this.copies = new Map(); this.known = new Map(); this.values = [];
  }
  number(value) {
    let id = this.known.get(value);
    if (id === undefined) { this.known.set(value, id = this.values.length); this.values.push(value); }
    return id;
  }
  add(state, id, amount, bits) {               // amount: copies, or newtons when added up
    this.bits[state] |= bits;
    const code = state * MAGNITUDES + id;
    if (this.accumulate) this.tally.add(state, amount); else this.copies.set(code, (this.copies.get(code) ?? 0) + amount);
  }
  /** Rows sorted by state, those above γ; what ends goes to `quiet(newtons, state)`. */
  judged(threshold, quiet) {
    const { accumulate, tally } = this, order = (accumulate ? tally.met.slice(0, tally.n) : Float64Array.from(this.copies.keys())).sort(), n = order.length;
    const rows = { n: 0, state: new Int32Array(n), number: new Int32Array(n), magnitude: new Float64Array(n),
      copies: new Float64Array(n), bits: new Uint8Array(n), values: accumulate ? 0 : this.values.length };
    for (let i = 0; i < n; i++) {
      const state = accumulate ? order[i] : Math.floor(order[i] / MAGNITUDES), id = accumulate ? 0 : order[i] - state * MAGNITUDES;
      const value = accumulate ? tally.sum[state] : this.values[id], copies = accumulate ? 1 : this.copies.get(order[i]);
      if (!(value > threshold)) { quiet(value * copies, state); continue; }
      const r = rows.n++;
      rows.state[r] = state; rows.number[r] = id; rows.magnitude[r] = value;
      rows.copies[r] = copies; rows.bits[r] = this.bits[state];
    }
    return rows;
  }
}

/** A run of the prescribed rule in the page. */
export class Twin extends Recorded {
  constructor(scene, cells, stage) {
    super(scene, cells, stage);
    this.transfer = new Transfer(scene, this.lattice);
    const { C, lattice: { size, D } } = this, { accumulate } = scene.rule;
    Object.assign(this, { applied: 0, quiet: 0, pending: 0, ended: [] });
    this.post = new Post(size * C, accumulate);
    this.leaving = accumulate ? new Post(size * D * C, true) : null;
    this.sums = { passed: new Tally(size * D), dropped: new Tally(size), returned: new Tally(size), given: new Tally(size) };   // `given`: by boundary cell
    for (const name of Object.keys(this.sums)) this[name] = new Log();
    const loads = appliedLoads(scene, this.lattice, this.kinds, this.stage);
    this.ledger = new Ledger(this, loads);
    for (const [k, channel, magnitude] of loads) {
      this.applied += magnitude;
      this.post.add(k * C + channel, accumulate ? 0 : this.post.number(magnitude), accumulate ? magnitude : 1, 0);
    }
    this.arrive();
    this.ledger.close(this.waiting);
  }
  get atRest() { return this.waiting.n === 0; }
  get grown() { return this.pending > 1e12 * this.applied; }

  step() {
    if (this.atRest) return false;
    this.generation++;
    this.take();
    this.post.clear(); this.leaving?.clear();
    this.emit();
    if (this.leaving) this.giveBack();
    for (const [name, sums] of Object.entries(this.sums)) sums.close(this[name]);
    this.arrive();
    this.ended.push(this.quiet); this.alive.push(this.agents); this.ledger.close(this.waiting);
    return true;
  }
  take() {                                     // sums by cell and channel
    const { n, state, magnitude, copies } = this.waiting;
    this.waits.push(this.pending);
    for (let i = 0; i < n;) {
      const s = state[i]; let sum = 0;
      for (; i < n && state[i] === s; i++) sum += magnitude[i] * copies[i];
      this.taken.push(s, sum);
      this.ledger.share(this.kinds[Math.floor(s / this.C)], s % this.C, sum);
    }
    this.taken.close();
    this.agents = this.woke;
  }
  emit() {                                     // emission by emission, as kaju does
    const { lattice: L, transfer: T, kinds, C, waiting: w, post, sums } = this, { D } = L;
    const { accumulate, threshold } = this.scene.rule, least = accumulate ? 0 : threshold;
    const products = accumulate ? null : new Int32Array(T.distinct.length * w.values).fill(-1);
    for (let e = 0; e < T.most; e++) for (let i = 0; i < w.n; i++) {
      const s = w.state[i], k = Math.floor(s / C), at = (kinds[k] * C + s - k * C) * T.most + e;
      const out = T.share[at] * w.magnitude[i], load = out * w.copies[i];
      if (load === 0) continue;
      const arm = T.arm[at], channel = T.channel[at];
      if (!(out > least)) { sums.dropped.add(k, load); this.rest(load, channel); continue; }
      const to = L.neighbour(k, arm), kind = kinds[to];
      sums.passed.add(k * D + arm, load);
      if (accumulate) {
        if (kind < 0) this.leaving.add((k * D + arm) * C + channel, 0, load, 0);
        else post.add(to * C + channel, 0, load, 1 << L.opposite[arm]);
        continue;
      }
      const p = T.number[at] * w.values + w.number[i];
      const id = products[p] >= 0 ? products[p] : products[p] = post.number(out);
      if (kind >= 0) post.add(to * C + channel, id, w.copies[i], 1 << L.opposite[arm]);
      else this.back(k, arm, channel, id, w.copies[i], load);
    }
  }
  giveBack() {                                 // added up: boundaries judge what has met there
    const { lattice: { D }, C } = this;
    const rows = this.judged(this.leaving);
    for (let i = 0; i < rows.n; i++) {
      const place = Math.floor(rows.state[i] / C), k = Math.floor(place / D);
      this.back(k, place - k * D, rows.state[i] - place * C, 0, rows.magnitude[i], rows.magnitude[i]);
    }
  }
  back(k, arm, channel, id, amount, load) {
    const to = this.lattice.neighbour(k, arm);
    const turned = this.transfer.turned[this.kinds[to]][arm][channel];
    this.sums.given.add(to, load); this.sums.returned.add(k, load);
    this.ledger.turn(channel, turned, load);
    this.post.add(k * this.C + turned, id, amount, 0);
  }
  rest(load, channel) { this.quiet += load; this.ledger.end(channel, load); }
  judged(post) { return post.judged(this.scene.rule.threshold, (load, state) => this.rest(load, state % this.C)); }
  arrive() {                                   // judge what met, and wake agents for the rest
    const { C } = this, rows = this.judged(this.post), born = this.generation + 1;
    this.woke = this.agents; this.pending = 0;
    for (let i = 0; i < rows.n; i++) {
      const k = Math.floor(rows.state[i] / C);
      if (!this.spawn[k]) { this.spawn[k] = born; this.woke++; }
      if (this.spawn[k] === born) this.woken[k] |= rows.bits[i];
      this.pending += rows.magnitude[i] * rows.copies[i];
    }
    this.waiting = rows;
  }
  /** Step until at rest, grown out of all bounds, `most` generations or `budget` ms are over. */
  run(most = 10000, budget = Infinity) {
    const until = performance.now() + budget;
    while (this.generation < most && !this.atRest && !this.grown && performance.now() < until) this.step();
    return this;
  }
}

/** Where the force of the applied loads has gone, along their sum, after each generation (N). A load
 * that supports give back reversed has left twice itself with them; one that runs against it counts below 0. */
class Ledger {
  constructor({ lattice: { normals, D, dimension }, transfer, C }, loads) {
    const sum = Array.from({ length: dimension }, (_, a) => loads.reduce((f, [, c, load]) => f + normals[c % D][a] * load, 0));
    this.applied = Math.hypot(...sum);
    this.along = Float64Array.from({ length: C }, (_, c) => dot(normals[c % D], sum) / (this.applied || 1));
    this.gain = transfer.rows.map((row, n) => row.reduce((sum, [, channel, share]) => sum + share * this.along[channel], -this.along[n % C]));   // how much more of a force is passed on than came, of 1 N, by material and channel
    this.ended = this.ground = this.made = 0;
    this.rows = [];
  }
  end(channel, load) { this.ended += this.along[channel] * load; }
  turn(channel, turned, load) { this.ground += (this.along[channel] - this.along[turned]) * load; }
  share(kind, channel, load) { this.made += this.gain[kind * this.along.length + channel] * load; }
  close({ n, state, magnitude, copies }) {
    const { along, ended, ground, made } = this, C = along.length;
    let way = 0;
    for (let i = 0; i < n; i++) way += along[state[i] % C] * magnitude[i] * copies[i];
    this.rows.push({ way, ended, ground, made });
  }
}

/** Sums of one generation by index, which go into a log when it is over. */
class Tally {
  constructor(size) { this.sum = new Float64Array(size); this.met = new Int32Array(64); this.n = 0; }
  add(index, load) {
    if (this.sum[index] === 0) {
      if (this.n === this.met.length) this.met = doubled(this.met);
      this.met[this.n++] = index;
    }
    this.sum[index] += load;
  }
  clear() {
    for (let i = 0; i < this.n; i++) this.sum[this.met[i]] = 0;
    this.n = 0;
  }
  close(log) {
    for (let i = 0; i < this.n; i++) log.push(this.met[i], this.sum[this.met[i]]);
    this.clear(); log.close();
  }
}

// ------------------------------------------------------------------------------- certificate

/** Will the loads end? The twin of kaju.stability, bit by bit: every certificate that is yielded
 * holds (bounds, generations, and why not), the last that is returned is the best. */
export function* certifying(scene, cells) {
  const tried = new Twin(scene, cells), { lattice, kinds, transfer, transfer: { emitted, largest, undiminished, worst } } = tried, { accumulate, threshold } = scene.rule;
  const load = accumulate ? tried.applied : Math.max(0, ...appliedLoads(scene, lattice, kinds).map(([, , magnitude]) => magnitude));
  const named = { largest, undiminished, ...remedies(lattice, transfer.shares[worst]), name: scene.materials[worst].name };
  const told = ([lower, upper]) => {
    const generations = endsWithin(load, accumulate ? upper : largest, threshold);
    return { lower, upper, generations, stable: generations !== null, ...named };
  };
  const best = told([Math.min(...emitted), Math.max(...emitted)].map((sum) => Number(sum.toPrecision(12))));   // shares that sum up to 1 but for rounding neither grow nor end
  if (best.stable) return best;
  yield best;
  // The sums know nothing of γ: the run tells.
  for (let rows = 0; !tried.atRest; tried.step()) {
    rows += tried.waiting.n;
    const grown = !(tried.pending <= 1e3 * tried.applied);
    if (grown || rows > 3e5 || tried.generation >= 300) return { ...best, stable: (accumulate ? grown : undiminished) ? false : null };
    if (tried.generation % 20 === 19) yield best;
  }
  return { ...best, generations: tried.generation, stable: true, tried: true };
}

function endsWithin(load, decay, threshold) {
  if (load <= threshold) return 0;
  if (decay >= 1) return null;
  if (decay === 0) return 1;
  return Math.floor(Math.log(threshold / load) / Math.log(decay) * (1 + 1e-12)) + 1;
}

function remedies({ hexagon, dimension }, { forward, friction, poisson }) {
  const beside = 2 * (dimension - 1);
  const sideways = hexagon ? 2 * friction + 3 * poisson : beside * (friction + poisson);
  return { forward: 1 - sideways, friction: (1 - forward - (sideways - beside * friction)) / beside };
}
