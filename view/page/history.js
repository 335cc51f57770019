// The append-only history of a run, and what can be read from it at any generation.
import { Lattice } from "./lattice.js";

/** An array with room for twice as much. */
export function doubled(array) {
  const larger = new array.constructor(2 * array.length || 256);
  larger.set(array);
  return larger;
}

/** Rows (index, value), one offset a generation. */
export class Log {
  constructor(index = new Uint32Array(256), value = new Float64Array(256), offset = [0]) {
    this.index = index; this.value = value; this.offset = offset; this.n = offset[offset.length - 1];
  }
  push(index, value) {
    if (this.n === this.index.length) { this.index = doubled(this.index); this.value = doubled(this.value); }
    this.index[this.n] = index; this.value[this.n++] = value;
  }
  close() { this.offset.push(this.n); }
}

const EVERY = 16;                              // generations between two remembered sums

/** Sums of a log up to a generation; going back is quick, for sums are remembered on the way. */
export class Sums {
  constructor(log, size) { this.log = log; this.size = size; this.sum = new Float64Array(size); this.at = 0; this.marks = []; }
  to(generation) {
    const { log: { offset, index, value }, sum, marks } = this;
    const g = Math.min(generation, offset.length - 1);
    if (g < this.at) {
      const mark = Math.min(marks.length - 1, Math.floor(g / EVERY));   // there is one of the beginning
      sum.set(marks[mark]); this.at = EVERY * mark;
    }
    for (; this.at < g; this.at++) {
      if (this.at === EVERY * marks.length && marks.length * this.size < 2e7) marks.push(sum.slice());
      for (let i = offset[this.at]; i < offset[this.at + 1]; i++) sum[index[i]] += value[i];
    }
    return sum;
  }
}

// ------------------------------------------------------------------------------------ packing

const ARRAYS = { int16: Int16Array, uint8: Uint8Array, uint16: Uint16Array, uint32: Uint32Array,
  int32: Int32Array, float32: Float32Array, float64: Float64Array };

export const bytesOf = (base64) => Uint8Array.from(atob(base64.trim()), (c) => c.charCodeAt(0));

export const through = async (bytes, stream) => new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(stream)).arrayBuffer());

/** The header and the columns of what `packing.pack` wrote. */
export async function unpack(bytes) {
  const raw = await through(bytes, new DecompressionStream("deflate"));
  const length = new DataView(raw.buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(raw.subarray(4, 4 + length)));
  const columns = {};
  let at = 4 + length;
  for (const [name, type, n] of header.columns) {
    const array = new ARRAYS[type](n), width = array.BYTES_PER_ELEMENT, out = new Uint8Array(array.buffer);
    for (let b = 0; b < width; b++) for (let i = 0; i < n; i++) out[i * width + b] = raw[at++];
    columns[name] = array;
  }
  return { header, columns };
}

// --------------------------------------------------------------------------- runs from outside

/** What is noted of every cell of a run besides the loads it took: how many numbers by name. */
export const notesOf = ({ lattice: { D, axes }, states = [] }) => ({ passed: D, dropped: 1, returned: 1, kept: axes.length, stretch: axes.length, ...Object.fromEntries(states.map(([name]) => [`state ${name}`, 1])) });

/** A run: what it begins with, or what a file tells of it. */
export class Recorded {
  constructor(scene, cells, stage = scene.stages) {
    this.scene = scene; this.stage = stage;
    const L = this.lattice = new Lattice(scene.lattice);
    this.kinds = L.kinds(cells, scene.sides);
    this.C = scene.rule?.sense ? 2 * L.D : L.D;
    this.spawn = new Int32Array(L.size); this.woken = new Uint8Array(L.size);
    this.taken = new Log();
    this.alive = []; this.waits = []; this.agents = 0; this.generation = 0;
  }
  get atRest() { return true; }
  /** Take a run's columns; of what is not known there are none. */
  read(columns) {
    const { key, spawn, woken } = columns;
    this.waits = this.log(this.taken, columns, "");
    this.generation = this.waits.length;
    for (const name of Object.keys(notesOf(this)))
      if (columns[`${name} offset`]) this.log(this[name] = new Log(), columns, `${name} `);
    const born = new Int32Array(this.generation + 1);
    key.forEach((k, i) => { this.spawn[k] = spawn[i]; this.woken[k] = woken[i]; born[spawn[i]]++; });
    for (let g = 1; g <= this.generation; g++) this.alive.push(this.agents += born[g]);
    return this;
  }
  /** Put packed rows into a log; the sums of their generations. */
  log(log, columns, name) {
    const offset = columns[`${name}offset`], delta = columns[`${name}delta`], load = columns[`${name}load`], sums = [];
    for (let g = 0; g + 1 < offset.length; g++) {
      let place = 0, sum = 0;
      for (let i = offset[g]; i < offset[g + 1]; i++) { log.push(place = place + delta[i] >>> 0, load[i]); sum += load[i]; }
      log.close(); sums.push(sum);
    }
    return sums;
  }
  run() { return this; }
}
