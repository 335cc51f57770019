// The scene as it is changed in the page, and as files: TOML that kaju.load_scene runs, CSV.
import { SIDES } from "./lattice.js";

/** Every load the rule knows, as one number: the largest force (N). */
export const largestForce = (scene) => Math.max(0, ...scene.loads.map((l) => Math.hypot(...l.force)));

const LETTERS = "#abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789";
const quoted = (text) => JSON.stringify(text);
const number = (x) => (Number.isInteger(x) && Math.abs(x) < 1e15 ? `${x}.0` : String(x));
const list = (values, each = number) => `[${values.map(each).join(", ")}]`;

/** The scene as TOML; what is drawn in letters is the body, top row first. */
export function tomlOf(scene, cells) {
  const { lattice, materials, rule, sides, loads } = scene, lines = [];
  lines.push("# drawn in a page of kaju", "[body]", `cell_size = ${number(lattice.cell_size)}  # m`);
  if (lattice.shape.length === 2) lines.push(`thickness = ${number(scene.thickness)}  # m`);
  if (scene.plane === "strain") lines.push('plane = "strain"');
  if (lattice.kind === "hexagon") lines.push('lattice = "hexagon"');
  lines.push("allow_floating = true");
  lines.push(...(lattice.shape.length === 2 ? drawn(scene, cells) : stacked(scene, cells)), "");
  for (const m of materials) {
    lines.push(`[materials.${quoted(m.name)}]`, `youngs_modulus = ${number(m.youngs_modulus)}  # Pa`,
      `poissons_ratio = ${number(m.poissons_ratio)}`);
    if (m.density) lines.push(`density = ${number(m.density)}  # kg/m3`);
    lines.push("");
  }
  lines.push("[sides]", ...Object.entries(sides).map(([side, held]) => `${side} = ${quoted(held)}`), "");
  for (const load of loads) {
    lines.push("[[loads]]", `cell = ${list(load.cell, String)}`, `force = ${list(load.force)}  # N`);
    if (load.steps > 1) lines.push(`steps = ${load.steps}`);
    lines.push(...sensed(scene, load), "");
  }
  lines.push("[rule]", 'kind = "prescribed"', ...coefficients(rule), `threshold = ${number(rule.threshold)}  # N`,
    `accumulate = ${rule.accumulate}`);
  if (rule.sense) lines.push("sense = true");
  for (const [name, own] of Object.entries(rule.materials ?? {})) {
    lines.push("", `[rule.materials.${quoted(name)}]`, ...coefficients(own));
  }
  return lines.join("\n") + "\n";
}

function sensed({ lattice, rule }, { sense, face }) {   // what decides whether the force pulls
  if (sense === "push" || sense === "pull") return [`sense = ${quoted(sense)}`];
  if (sense !== "side" || lattice.kind === "hexagon") return [];
  if (face < 0) return rule.sense ? ['sense = "push"'] : [];
  return [`side = ${quoted(SIDES[lattice.shape.length][face])}`];
}
const coefficients = ({ alpha, beta }) => [...(alpha ? [`alpha = ${list(alpha)}`] : []), `beta = ${number(beta)}`];

const NO_MATERIAL = { [-1]: [".", "air"], [-2]: ["=", "rigid"], [-3]: [":", "roller"] };
function drawn({ lattice: { shape: [nx, ny] }, materials }, cells) {
  const letter = (kind) => NO_MATERIAL[kind]?.[0] ?? LETTERS[kind] ?? String.fromCodePoint(0x4e00 + kind);
  const rows = Array.from({ length: ny }, (_, row) => Array.from({ length: nx }, (_, x) =>
    letter(cells[x * ny + ny - 1 - row])).join(""));
  const used = Array.from(new Set(cells)).sort((a, b) => (a < 0) - (b < 0) || a - b);
  const legend = used.map((kind) => `${quoted(letter(kind))} = ${quoted(NO_MATERIAL[kind]?.[1] ?? materials[kind].name)}`);
  return ['drawing = """', ...rows, '"""', "", "[legend]", ...legend];
}

function stacked({ lattice: { shape, cell_size: h }, materials }, cells) {   // cubes: boxes over a ground
  const name = (kind) => (kind >= 0 ? materials[kind].name : kind === -1 ? "air" : "rigid");
  const base = cells[0], [nx, ny, nz] = shape, lines = [`cells = ${list(shape, String)}`, `material = ${quoted(name(base))}`];
  for (let x = 0; x < nx; x++) for (let y = 0; y < ny; y++) for (let z = 0; z < nz;) {
    const at = (x * ny + y) * nz, kind = cells[at + z];
    let end = z + 1;
    while (end < nz && cells[at + end] === kind) end++;
    if (kind !== base) {
      const box = [[x, y, z], [x + 1, y + 1, end]].map((p) => list(p.map((c) => c * h)));
      lines.push("", "[[body.regions]]", `box = [${box.join(", ")}]`, `material = ${quoted(name(kind))}`);
    }
    z = end;
  }
  return lines;
}

/** One row an agent: cell, material, generation of waking, loads taken, kept, let end. */
export function csvOf(page) {
  const { run: { lattice: L, C } } = page, { D } = L;
  const names = "xyz".slice(0, L.dimension).split("").map((a) => `cell_${a}`);
  const channels = Array.from({ length: C }, (_, c) => `taken_${L.names[c % D]}${c < D ? "" : "_pull"} (N)`.replace("−", "-"));
  const rows = [[...names, "material", "spawn_step", ...channels, "kept (N)", "dropped (N)"].join(",")];
  L.each((k) => {
    const story = page.storyOf(k);
    if (story) rows.push([...story.cell, story.material, story.spawn, ...story.taken, story.kept, story.dropped ?? ""].join(","));
  });
  return rows.join("\n") + "\n";
}

// --------------------------------------------------------------------------------- taken away

export function hand(name, blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob); link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  return name;
}
const fileName = (page, ending) => `${(page.say(page.title) || "kaju").replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "") || "kaju"}.${ending}`;

export const saveScene = (page) => hand(fileName(page, "toml"), new Blob([tomlOf(page.scene, page.cells)], { type: "text/plain" }));
export const saveTable = (page) => hand(fileName(page, "csv"), new Blob([csvOf(page)], { type: "text/csv" }));

export async function savePng(page) {         // the picture on its background
  page.draw();
  const { canvas, inks } = page, { width, height } = canvas, sheet = new OffscreenCanvas(width, height), ctx = sheet.getContext("2d");
  ctx.fillStyle = inks.paper; ctx.fillRect(0, 0, width, height); ctx.drawImage(canvas, 0, 0);
  return hand(fileName(page, "png"), await sheet.convertToBlob());
}
