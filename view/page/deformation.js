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
  const pressure = axes.map(() => new Float64Array(size));
  L.each((k) => {
    if (kinds[k] < 0) return;
    for (let n = 0; n < axes.length; n++) {
      if (kept) { pressure[n][k] = kept.sum[k * axes.length + n] / area; continue; }   // agents of one's own
      const d = axes[n], o = L.opposite[d];
      let load = taken[k * C + d] + taken[k * C + o];
      if (C > D) load -= taken[k * C + D + d] + taken[k * C + D + o];
      pressure[n][k] = load * agent[kinds[k]].own;
    }
  });
  // How much an axis' own squeeze and the others' widening lengthen a cell along each axis.
  const mix = axes.map((a) => axes.map((b) => dot(L.normals[a], L.normals[b]) ** 2));
  const displacement = Array.from({ length: L.dimension }, () => new Float64Array(size));
  const length = new Float64Array(size), scale = L.dimension / axes.length;
  axes.forEach((arm, n) => {
    L.each((k) => {
      if (kinds[k] < 0) return;
      if (stretch) { length[k] = stretch.sum[k * axes.length + n]; return; }
      const { modulus, free } = agent[kinds[k]];
      let sum = 0;
      for (let m = 0; m < axes.length; m++) {
        sum += pressure[m][k] / modulus * (free * (1 - mix[n][m]) - mix[n][m]);
      }
      length[k] = sum * h;
    });
    alongLines(L, kinds, arm, length, (k, u) => {
      if (!(spawn[k] > 0 && spawn[k] <= generation)) return;   // what no load reached stays where it is
      for (let a = 0; a < L.dimension; a++) displacement[a][k] += u * L.normals[arm][a] * scale;
    });
  });
  return { pressure, displacement };
}

/** Sum lengths along every unbroken row of body cells; tell each centre's displacement. */
function alongLines(L, kinds, arm, length, tell) {
  const held = (k) => kinds[k] === RIGID || kinds[k] === ROLLER, row = [];
  L.each((start) => {
    const before = L.neighbour(start, L.opposite[arm]);
    if (kinds[start] < 0 || kinds[before] >= 0) return;
    row.length = 0;
    let k = start, total = 0, moved = false;
    for (; kinds[k] >= 0; k = L.neighbour(k, arm)) { row.push(k); total += length[k]; moved ||= length[k] !== 0; }
    if (!moved) return;
    const below = held(before), above = held(k), n = row.length;
    const slope = below && above ? total / n : 0;
    let offset = below || !above ? 0 : -total;
    if (!below && !above) {                    // nothing holds it: its middle stays
      const middle = n >> 1;
      for (let i = 0; i < middle; i++) offset -= length[row[i]];
      if (n & 1) offset -= 0.5 * length[row[middle]];
    }
    for (let i = 0, sum = 0; i < n; i++) {
      tell(row[i], sum + 0.5 * length[row[i]] + offset - slope * (i + 0.5));
      sum += length[row[i]];
    }
  });
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
