// How the agents deform: the twin of kaju's deformation by the loads they took.
import { RIGID, ROLLER } from "./lattice.js";
import { dot, sharesOf } from "./rule.js";

/** Pressure (Pa) by axis, and displacement (m) by coordinate at the cells' centres, by key. */
export function deformation(run, taken, generation = run.generation, { kept, stretch } = {}) {
  const { scene, lattice: L, kinds, C, spawn } = run, { axes, D, h } = L, size = L.size;
  const area = L.faceArea(scene.thickness), agent = scene.materials.map((m) => {
    const s = sharesOf(scene.rule, m, L.dimension);
    return { own: s.own / area, modulus: m.youngs_modulus, free: s.beta * m.poissons_ratio };
  });
  const rows = run.rows ??= axes.map((arm) => rowsOf(L, kinds, arm)), pressure = axes.map(() => new Float64Array(size));
  axes.forEach((d, n) => {
    const o = L.opposite[d];
    for (const { keys } of rows[n]) for (const k of keys) {
      if (kept) { pressure[n][k] = kept.sum[k * axes.length + n] / area; continue; }   // noted in the run
      let load = taken[k * C + d] + taken[k * C + o];
      if (C > D) load -= taken[k * C + D + d] + taken[k * C + D + o];
      pressure[n][k] = load * agent[kinds[k]].own;
    }
  });
  // How much an axis' own squeeze and the others' widening lengthen a cell along each axis.
  const mix = axes.map((a) => axes.map((b) => dot(L.normals[a], L.normals[b]) ** 2)), lengthen = (k, n) => {
    const { modulus, free } = agent[kinds[k]];
    let sum = 0;
    for (let m = 0; m < axes.length; m++) sum += pressure[m][k] / modulus * (free * (1 - mix[n][m]) - mix[n][m]);
    return sum * h;
  };
  const displacement = Array.from({ length: L.dimension }, () => new Float64Array(size));
  const length = new Float64Array(Math.max(...L.shape)), scale = L.dimension / axes.length;
  axes.forEach((arm, n) => {
    for (const { keys, below, above } of rows[n]) {
      let total = 0, moved = false;
      for (let i = 0; i < keys.length; i++) {
        length[i] = stretch ? stretch.sum[keys[i] * axes.length + n] : lengthen(keys[i], n);
        total += length[i]; moved ||= length[i] !== 0;
      }
      if (!moved) continue;
      const slope = below && above ? total / keys.length : 0;
      let offset = below || !above ? 0 : -total, sum = 0;
      if (!below && !above) {                  // nothing holds it: its middle stays
        const middle = keys.length >> 1;
        for (let i = 0; i < middle; i++) offset -= length[i];
        if (keys.length & 1) offset -= 0.5 * length[middle];
      }
      for (let i = 0; i < keys.length; i++) {
        const k = keys[i], u = sum + 0.5 * length[i] + offset - slope * (i + 0.5);
        sum += length[i];
        if (!(spawn[k] > 0 && spawn[k] <= generation)) continue;   // what no load reached stays where it is
        for (let a = 0; a < L.dimension; a++) displacement[a][k] += u * L.normals[arm][a] * scale;
      }
    }
  });
  return { pressure, displacement };
}

/** Every unbroken row of body cells along an arm: its keys, and whether something holds its ends. */
function rowsOf(L, kinds, arm) {
  const held = (k) => kinds[k] === RIGID || kinds[k] === ROLLER, rows = [];
  L.each((start) => {
    const before = L.neighbour(start, L.opposite[arm]), keys = [];
    if (kinds[start] < 0 || kinds[before] >= 0) return;
    let k = start;
    for (; kinds[k] >= 0; k = L.neighbour(k, arm)) keys.push(k);
    rows.push({ keys, below: held(before), above: held(k) });
  });
  return rows;
}

/** Displacement at the corners of squares: the mean of the cells that meet. */
export function cornersOf(L, kinds, displacement) {
  const [nx, ny] = L.shape, step = L.stride[0], across = (nx + 1) * (ny + 1);
  const corner = [new Float64Array(across), new Float64Array(across)];
  for (let x = 0, n = 0; x <= nx; x++) for (let y = 0; y <= ny; y++, n++) {
    let count = 0, a = 0, b = 0;
    for (let i = 0; i < 4; i++) {
      const k = (x + (i >> 1)) * step + y + (i & 1);
      if (kinds[k] >= 0) { count++; a += displacement[0][k]; b += displacement[1][k]; }
    }
    if (count) { corner[0][n] = a / count; corner[1][n] = b / count; }
  }
  return corner;
}
