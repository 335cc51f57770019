// Bodies that grow, in the page itself: its generations are the steps of growing.js, in a worker.
// A load that is moved, or a cell that is drawn, lets the body grow anew.
import { atWork } from "./answer.js";
import { paintGrid } from "./charts.js";
import { choice, make, slider } from "./controls.js";
import { Lattice } from "./lattice.js";
import { Page } from "./page.js";
import { quantity } from "./words.js";

const BONE = 160;                              // steps until bone is at rest, mostly

export class GrowthPage extends Page {
  begin(header) {
    super.begin(header);
    Object.assign(this.look, { colour: "density", arrows: false });
  }
  get deformable() { return false; }
  get colours() { return ["density"]; }
  word(key) { return this.t(`value_${key}`); }
  scale() { return { low: 0, high: 1, log: false }; }

  /** Begin to grow; densities come step by step, and who stood at the end or waits for a step sees them come. */
  compute() {
    const { scene, cells, stage } = this, L = new Lattice(scene.lattice), kinds = L.kinds(cells, scene.sides), places = [];
    L.each((k) => { if (kinds[k] >= 0) places.push(k); });
    const run = { scene, stage, lattice: L, kinds, places, generation: 0, designs: [places.map(() => scene.growth.volume)], compliance: [], volume: [], alive: [] };
    this.worker?.terminate();
    this.worker = atWork(this, (step) => { if (this.run === run) this.hear(step); });
    return run;
  }
  hear({ density, compliance, volume, outcome, error }) {
    const { run, g, wanted } = this, follows = !this.playing && (wanted === Infinity ? g === run.generation : wanted > g);
    Object.assign(run, { atRest: Boolean(outcome || error), outcome, error });
    if (density) {
      run.designs[run.generation = run.compliance.length] = density;
      run.compliance.push(compliance); run.volume.push(100 * volume);
    }
    if (run.atRest) this.certify();
    if (follows) this.goTo(Math.min(wanted, this.limit));
    this.later();
  }
  seek(g) { this.wanted = g; super.seek(g); }
  certify() {
    const { t, run: { outcome, error, generation, compliance } } = this;
    this.tellVerdict(error ?? (outcome ? t(`grown_${outcome}`, { n: generation, c: quantity(compliance.at(-1), "J") }) : ""), !error);
  }
  values() {
    const { run: { lattice, places, designs }, g } = this, v = new Float64Array(lattice.size).fill(NaN);
    places.forEach((k, n) => { v[k] = Math.max(designs[g][n], 1e-12); });   // 0 would look asleep
    return v;
  }
  words() {
    const { t, g, run, parts, picked } = this, text = `${t("along_step")} ${g} · ${t("moment", { g, n: run.generation })}${this.over ? "" : " …"}`;
    this.tellTime(text);
    const cell = picked >= 0 && run.kinds[picked] >= 0;
    parts.story.replaceChildren(...(cell ? [make("b", { textContent: t("cellOf", { c: `(${run.lattice.cell(picked).join(", ")})` }) }),
      make("dl", {}, make("dt", { textContent: this.word("density") }), make("dd", {}, make("data", { value: String(this.values()[picked]), textContent: quantity(this.values()[picked], "") })))]
      : [make("p", { textContent: t("pickPart") })]));
    if (!parts.charts.isConnected) return;
    const over = run.compliance.map((_, step) => step), curve = (name, unit) => ({ word: t(name), unit, over, lists: [run[name]], names: [], now: g });
    this.curves = { list: [curve("compliance", "J"), curve("volume", "%")] };
    paintGrid(parts.charts, this.curves.list, this.inks, this.limit);
  }
  /** The numbers of growth, instead of those of the prescribed rule. */
  ruleRows() {
    const { t } = this, { growth } = this.scene, put = (key) => (v) => this.change(() => { this.scene.growth[key] = v; });
    return [choice(t("rule"), growth.rule, ["compliance", "remodelling"].map((name) => [name, t(`grow_${name}`)]), (rule) => this.change(() => Object.assign(this.scene.growth, { rule, steps: Math.max(growth.steps, rule === "remodelling" ? BONE : 0) }))),
      slider(t("volume"), { value: growth.volume, min: 0.05, max: 1, step: 0.01, t }, put("volume")),
      slider(t("radius"), { value: growth.radius, min: 1, max: 6, step: 0.1, t }, put("radius"))];
  }
}
