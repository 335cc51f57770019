// What a cell can tell: who woke it, what it took, kept, passed on, let end and got back.
import { make } from "./controls.js";
import { AIR, RIGID } from "./lattice.js";
import { sharesOf } from "./rule.js";
import { quantity } from "./words.js";

/** The numbers of an agent's story at the page's generation; null where no agent is awake. */
export function storyOf(page, k) {
  const { run, g, sums } = page, { lattice: L, kinds, C, spawn, woken } = run, { D } = L;
  if (!(spawn[k] > 0 && spawn[k] <= g)) return null;
  const material = run.scene.materials[kinds[k]];
  const taken = Array.from(sums.taken.sum.subarray(k * C, (k + 1) * C));
  const total = taken.reduce((a, b) => a + b, 0), known = !run.late || g >= run.generation;
  const at = (name, size = 1) => (run[name] && sums[name] && known ? Array.from(sums[name].sum.subarray(k * size, (k + 1) * size)) : null);
  const wakers = Array.from({ length: D }, (_, arm) => arm).filter((arm) => woken[k] >> arm & 1).map((arm) => L.neighbour(k, arm));
  const { offset, index, value } = run.taken, now = [];
  for (let i = g ? offset[g - 1] : 0; i < (g ? offset[g] : 0); i++) {
    if (Math.floor(index[i] / C) === k) now.push([index[i] - k * C, value[i]]);
  }
  const own = run.scene.rule.alpha === undefined ? null : sharesOf(run.scene.rule, material, L.dimension).own;
  return { cell: L.cell(k), material: material.name, spawn: spawn[k], wakers, taken, total,
    kept: own === null || (sums.kept && !known) ? null : sums.kept ? page.keptBy(k) : own * total,
    passed: at("passed", D), dropped: at("dropped")?.[0] ?? null, returned: at("returned")?.[0] ?? null, now };
}

/** Write the story of a cell into an element. */
export function tellStory(page, element) {
  const { run, picked: k, t } = page, L = run.lattice;
  const paragraph = (text) => make("p", { textContent: text });
  if (k < 0) { element.replaceChildren(paragraph(t("pick"))); return; }
  const head = t("cellOf", { c: `(${L.cell(k).join(", ")})` }), kind = run.kinds[k];
  if (kind < 0) {
    element.replaceChildren(make("b", { textContent: head }), paragraph(t(kind === AIR ? "isAir" : kind === RIGID ? "isRigid" : "isRoller")));
    return;
  }
  const story = storyOf(page, k), material = run.scene.materials[kind].name;
  if (!story) { element.replaceChildren(make("b", { textContent: `${head}, ${material}` }), paragraph(t("asleep"))); return; }
  const name = (c) => L.names[c % L.D] + (run.C > L.D ? ` ${t(c < L.D ? "pushes" : "pulls")}` : "");
  const data = (value) => make("data", { value: String(value), textContent: quantity(value, "N") });
  const several = (list) => (list.length ? list.flatMap(([word, value], i) => [`${i ? ", " : ""}${word} `, data(value)]) : ["–"]);
  const nonzero = (list, word) => list.map((value, c) => [word(c), value]).filter(([, value]) => value > 0);
  const later = t(run.late ? "atEnd" : "unknown"), rows = [];
  const row = (word, ...content) => rows.push(make("dt", { textContent: t(word) }), make("dd", {}, ...content));
  const wakers = story.wakers.map((w) => `(${L.cell(w).join(", ")})`).join(", ");
  row("woken", t("byWhom", { g: story.spawn, w: wakers || t("outside") }));
  row("took", data(story.total), ": ", ...several(nonzero(story.taken, name)));
  row("keptIt", story.kept === null ? later : data(story.kept));
  row("passedOn", ...(story.passed ? several(nonzero(story.passed, (a) => L.names[a])) : [later]));
  row("ended", story.dropped === null ? later : data(story.dropped));
  for (const [key, label] of run.states ?? []) rows.push(make("dt", { textContent: label }), make("dd", {}, String(Number((page.sums[`state ${key}`]?.sum[k] ?? 0).toPrecision(6)))));
  row("gotBack", story.returned !== null ? data(story.returned) : run.late && run.returned ? later : t("unknown"));
  if (story.now.length) row("thisGeneration", ...several(story.now.map(([c, v]) => [name(c), v])));
  element.replaceChildren(make("b", { textContent: `${head}, ${material}` }), make("dl", {}, ...rows));
}
