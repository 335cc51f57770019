// The elastic answer to a page's scene: asked for, awaited, and set beside the rule cell by cell.
import { RIGID, ROLLER } from "./lattice.js";

/** What both answers tell of a cell, with its unit. */
export const BOTH = { along: "N", across: "N", stress: "Pa", move: "m" };
const HEIGHT = 1e-9;                           // of a cell: rounding

/** Ask for the elastic answer: from a worker. What is known is shown until then. */
export function askElastic(page) {
  const elastic = page.elastic ??= { answer: null, why: "" };
  clearTimeout(elastic.asking);
  elastic.worker?.terminate();
  elastic.old = true;
  elastic.asking = setTimeout(() => {
    elastic.worker = atWork(page, ({ answer, error }) => take(page, answer, error));
  }, elastic.answer ? 60 : 0);
}
/** A worker that answers with elasticity to the scene as it stands. */
function atWork({ scene, cells, stage }, hear) {
  const url = URL.createObjectURL(new Blob([ELASTIC], { type: "text/javascript" })), worker = new Worker(url), part = (load) => Math.min(1, stage / load.steps);
  worker.onmessage = ({ data }) => { URL.revokeObjectURL(url); hear(data); };
  worker.postMessage({ scene, cells, loads: scene.loads.map((load) => ({ ...load, force: load.force.map((f) => f * part(load)) })) });
  return worker;
}
function take(page, answer, why) {
  Object.assign(page.elastic, { answer: answer ?? null, why: why ?? "", old: false });
  page.scales.clear();
  page.later();
}
/** The axis along which the loads press most, and the sense of their sum on it. */
export function loadAxis({ loads, lattice }) {
  const forces = lattice.shape.map((_, a) => loads.reduce((sum, { force }) => sum + Math.abs(force[a]), 0)), most = Math.max(...forces);
  const axis = most ? forces.findIndex((f) => f >= most * (1 - 1e-9)) : forces.length - 1;
  return { axis, sense: loads.reduce((sum, { force }) => sum + force[axis], 0) < 0 ? -1 : 1 };
}

/** What one answer tells of every cell, by key: pressures by axis (Pa) become squeezes (N), below 0 where it pulls. */
export function fieldsOf({ lattice: L, kinds, scene }, pressure, displacement) {
  const { axis } = loadAxis(scene), area = L.faceArea(scene.thickness), other = axis ? 0 : 1;
  const made = (f) => { const v = new Float64Array(L.size).fill(NaN); L.each((k) => { if (kinds[k] >= 0) v[k] = f(k); }); return v; };
  return { along: made((k) => area * pressure[axis][k]), ...(L.dimension === 2 ? { across: made((k) => area * pressure[other][k]) } : {}),
    stress: made((k) => pressure.reduce((top, p) => Math.max(top, Math.abs(p[k])), 0)), move: made((k) => Math.hypot(...displacement.map((u) => u[k]))) };
}

/** Force handed on through every layer of cells across the load (N): carried, and what equilibrium needs (NaN: not known). */
export function cutsOf(run, along) {
  const { lattice: L, kinds, scene, stage } = run, { axis, sense } = loadAxis(scene), n = L.shape[axis];
  const sums = new Float64Array(n), body = new Uint8Array(n);
  let highest = -Infinity, lowest = Infinity;  // where supports hold the force along the axis
  L.each((k) => {
    if (kinds[k] < 0) return;
    const at = L.cell(k)[axis];
    sums[at] += along[k]; body[at] = 1;
    for (let arm = 0; arm < L.D; arm++) {
      const kind = kinds[L.neighbour(k, arm)], square = arm >> 1 === axis;
      if (kind !== RIGID && !(kind === ROLLER && square)) continue;
      const place = at + 0.5 + (square ? (arm & 1 ? 0.5 : -0.5) : 0);
      highest = Math.max(highest, place); lowest = Math.min(lowest, place);
    }
  });
  const forces = scene.loads.map(({ cell, force, face, steps }) => [cell[axis] + 0.5 + (face >> 1 === axis && face >= 0 ? (face & 1 ? 0.5 : -0.5) : 0), force[axis] * Math.min(1, stage / steps)]);
  return Array.from({ length: n }, (_, at) => at).filter((at) => body[at]).map((at) => {
    const beyond = (place) => Math.max(0, Math.min(1, place - at)), add = (f) => forces.reduce((sum, [place, force]) => sum + f(place) * force, 0);
    const above = add(beyond), below = add((place) => beyond(place) - 1), all = add(() => 1);
    const freeAbove = !(highest > at + HEIGHT), freeBelow = !(lowest < at + 1 - HEIGHT);
    const turn = sense * (freeAbove || (!freeBelow && 2 * Math.abs(above) >= Math.abs(all)) ? 1 : -1);
    return { at, carried: -turn * sums[at] + 0, needed: freeAbove ? turn * above : freeBelow ? turn * below : NaN, loaded: Math.abs(turn > 0 === sense > 0 ? above : below) };
  });
}

/** A profile of cells on a straight line between two points (in cells): keys, and how far along each lies (in cells). */
export function cellsOn({ lattice: L, kinds }, [x0, y0], [x1, y1]) {
  const long = Math.hypot(x1 - x0, y1 - y0) || 1, way = [(x1 - x0) / long, (y1 - y0) / long], found = new Map();
  for (let s = 0; s <= long; s += 0.01) {
    const cell = [Math.floor(x0 + s * way[0]), Math.floor(y0 + s * way[1])], k = L.contains(cell) ? L.key(cell) : -1;
    if (k >= 0 && kinds[k] >= 0 && !found.has(k)) found.set(k, (cell[0] + 0.5 - x0) * way[0] + (cell[1] + 0.5 - y0) * way[1]);
  }
  return { keys: [...found.keys()], at: [...found.values()] };
}

/** Half the width at half the largest value, both sides averaged; null where a side never falls so far. */
export function halfWidth(at, values) {
  const top = values.reduce((best, v, i) => (v > values[best] ? i : best), 0), half = values[top] / 2;
  if (!(half > 0)) return null;
  const ends = [-1, 1].map((turn) => {
    for (let i = top; values[i + turn] !== undefined; i += turn) if (values[i + turn] <= half) {
      return at[i] + (at[i + turn] - at[i]) * (values[i] - half) / (values[i] - values[i + turn]);
    }
    return NaN;
  });
  return Number.isNaN(ends[0] + ends[1]) ? null : { low: ends[0], high: ends[1], half, width: (ends[1] - ends[0]) / 2 };
}
