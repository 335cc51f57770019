// One view for all hosts: a run is drawn, whoever computed it: the twin in this page, a record in
// the file, or Python behind a channel.
import { certifying, entering, sharesOf, Twin } from "./rule.js";
import { cornersOf, deformation } from "./deformation.js";
import { Recorded, Sums } from "./history.js";
import { colourOf, COLOURS, paintCells, paintForces, paintLegend, paintLoads, paintPath, paintPick, place, View } from "./paint.js";
import { curvesOf, paintCharts } from "./charts.js";
import { copyOf } from "./scene.js";
import { storyOf, tellStory } from "./story.js";
import { general, LANGUAGES, quantity, say, verdictOf } from "./words.js";
import { buildAside, buildFooter, buildHeader, buildTries, icon, make } from "./panels.js";

const UNITS = { taken: "N", now: "N", kept: "N", stress: "Pa", move: "m", spawn: "", error: "m" };
const LOGARITHMIC = new Set(["taken", "now", "kept", "stress"]);
const MOST_GENERATIONS = 4000, MOST_ROWS = 2e7, PLAYED = 30;   // more than that no page holds; computed ahead of what is played
const PATIENCE = 24;              // ms of computing at a time: input must not wait

export class Page {
  constructor(element, header) {
    const { kind, title = "", text = "", verdict = "", stable = true, language } = header;
    Object.assign(this, { kind, title, text, tab: "", pen: "look", picked: -1, g: 0, changed: false, factor: 1, material: "",
      given: { verdict, stable }, parts: {}, presets: [] });
    this.language = language ?? (navigator.languages ?? ["en"]).map((l) => l.slice(0, 2)).find((l) => l in LANGUAGES) ?? "en";
    this.t = say(this.language);
    this.look = { colour: "taken", deformed: false, magnify: 0, arrows: true, path: false, beside: false, speed: 8,
      camera: { yaw: -0.6, pitch: 0.5 }, cut: { axis: -1, at: 0, only: false } };
    this.begin(header);
    this.host = make("div", { className: "all" });
    this.root = element.shadowRoot ?? element.attachShadow({ mode: "open" });
    this.root.replaceChildren(this.host);
    this.dress(matchMedia("(prefers-color-scheme: dark)").matches);
    this.buildStage(); this.rebuild();
    new ResizeObserver(() => this.later()).observe(this.canvas);
    this.root.addEventListener("keydown", (event) => this.key(event));
    this.seek(this.kind === "runnable" ? Infinity : 0);
    this.draw();
    element.page = this;
  }
  /** Take what the header brings: here a scene, and a run unless the page makes it. */
  begin({ scene, cells, run = null, presets = [], elastic = null }) {
    this.elasticText = elastic;
    this.start = { scene: copyOf(scene), cells: cells.slice(), word: "asItWas" };
    this.scene = copyOf(scene); this.cells = cells.slice(); this.stage = scene.stages;
    this.senseful = "sense" in scene.rule;
    this.presets = [this.start, ...(presets.length ? presets : usual(scene))];
    const { shape } = scene.lattice, load = scene.loads[0];    // cut cubes where the first load presses
    if (shape.length === 3) this.look.cut = { axis: 1, at: load ? load.cell[1] : shape[1] >> 1, only: false };
    this.adopt(run ?? this.compute());
  }
  get touchable() { return this.kind === "runnable" || (this.kind === "live" && this.scene.rule.kind === "prescribed"); }
  get solid() { return this.run.lattice.dimension === 3; }
  word(key) { return this.t(key); }
  get stages() { return this.touchable ? this.scene.stages : 1; }
  get deformable() { return this.scene.rule.kind === "prescribed"; }
  get colours() { return ["taken", "now", "spawn", ...(this.deformable ? ["kept", "stress", "move"] : [])]; }
  /** The page answers with elasticity for squares itself; for cubes Python can be asked. */
  get solvable() { const { kind } = this.scene.lattice; return kind === "square" ? Boolean(this.elasticText) : kind === "cube" && this.kind === "live"; }

  // ----------------------------------------------------------------------------- the run
  compute() {
    const run = new Twin(this.scene, this.cells, this.stage).run(MOST_GENERATIONS, PATIENCE);
    clearTimeout(this.rest);
    const more = () => {
      if (this.run !== run || this.over) return;
      if (this.playing && run.generation > this.g + PLAYED) { this.rest = setTimeout(more, 100); return; }   // what is played comes first
      const atEnd = this.g === run.generation;
      run.run(MOST_GENERATIONS, PATIENCE);
      this.scales.clear();
      if (atEnd && !this.playing) this.seek(Infinity); else this.later();
      this.rest = setTimeout(more, 4);
    };
    this.rest = setTimeout(more, 30);
    return run;
  }
  /** Whether the run goes no further. */
  get over() { const { run } = this; return run.atRest || run.grown || run.generation >= MOST_GENERATIONS || run.taken?.n > MOST_ROWS; }
  adopt(run) {
    this.run = run; this.scales = new Map(); this.moved = null; this.curves = null;
    const { lattice: L, C } = run, size = { taken: L.size * C, passed: L.size * L.D, dropped: L.size, returned: L.size, kept: L.size * L.axes.length, stretch: L.size * L.axes.length };
    this.sums = {};
    for (const [name, n] of Object.entries(size)) if (run[name]) this.sums[name] = new Sums(run[name], n);
  }
  /** Change the scene: the certificate says at once what is known; the run follows when that is painted. */
  change(edit) {
    edit();
    this.changed = true;
    this.certify();
    this.header();
    clearTimeout(this.rest);                   // nobody will look at the end of the old run
    if (this.kind === "live") this.channel.change(this.scene, this.cells, this.stage);
    else {
      this.due ??= requestAnimationFrame(() => { this.due = setTimeout(() => this.renew(), PATIENCE); });
      this.goal ??= this.g >= this.run.generation ? Infinity : this.g;
    }
    if (this.look.beside) this.showElastic(true);
  }
  renew(goal = this.goal) {
    cancelAnimationFrame(this.due); clearTimeout(this.due);
    this.due = this.goal = null;
    this.adopt(this.compute());
    this.seek(goal);
  }
  load({ scene, cells, stage, look, generation }) {
    this.scene = copyOf(scene); this.cells = (cells ?? this.start.cells).slice(); this.stage = stage ?? scene.stages;
    this.factor = 1; this.picked = -1; this.material = "";
    if (look) Object.assign(this.look, look);
    const first = scene === this.start.scene;
    this.change(() => {});
    this.changed = !first;
    if (this.kind !== "live") this.renew(generation ?? Infinity);
    this.rebuild();
  }
  setStage(stage) { this.stage = stage; this.change(() => {}); }
  scaleLoads(factor) {
    this.scene.loads.forEach((load) => { load.force = load.force.map((f) => f * factor / this.factor); });
    this.factor = factor;
    if (factor === 0) this.factor = 1e-300;
  }
  /** Say whether the loads will end: at once what is known at once, the rest while the reader goes on. */
  certify() {
    const { verdict, stable } = this.given, { kind } = this.scene.rule;
    clearTimeout(this.judging);
    this.judging = null;
    if (kind !== "prescribed" || (verdict && (!this.touchable || this.kind === "live"))) { this.tellVerdict(verdict ?? "", stable); return; }
    const steps = certifying(this.scene, this.cells), go = (budget) => {
      const until = performance.now() + budget;
      let next;
      do next = steps.next(); while (!next.done && performance.now() < until);
      this.certificate = next.value;
      this.tellVerdict(verdictOf(next.value, this.scene.rule, this.t), next.value.stable);
      this.judging = next.done ? null : setTimeout(() => go(12), 24);
    };
    go(this.cells.length > 10000 ? 0 : 25);
  }
  tellVerdict(text, stable) {
    const { verdict } = this.parts;
    verdict.textContent = text; verdict.hidden = !text;
    verdict.classList.toggle("bad", stable === false);
    verdict.classList.toggle("open", stable === null);   // nobody knows
  }

  // ---------------------------------------------------------------------------- generations
  goTo(g) {
    if (g === Infinity) g = this.run.generation;
    this.g = Math.max(0, Math.min(g, this.run.generation));
    for (const sums of Object.values(this.sums)) sums.to(this.g);
    this.moved = null;
  }
  seek(g) {
    this.channel?.want(g);
    this.goTo(g);
    this.later();
  }
  toggle(on = !this.playing) {
    this.playing = on;
    if (on && this.g >= this.run.generation && this.over) this.goTo(0);
    this.clock = null;
    if (on) requestAnimationFrame((now) => this.tick(now));
    this.later();
  }
  tick(now) {
    if (!this.playing || !this.host.isConnected) return;
    this.clock ??= now - 1000 / this.look.speed;
    const due = Math.floor((now - this.clock) * this.look.speed / 1000);
    if (due > 0) {
      this.clock += due * 1000 / this.look.speed;
      const end = this.g >= this.run.generation && this.over;
      if (end) this.playing = false; else this.seek(this.g + due);
      this.later();
    }
    requestAnimationFrame((next) => this.tick(next));
  }

  // ----------------------------------------------------------------------------- what is shown
  deformed() {
    if (!this.moved) {
      this.moved = deformation(this.run, this.sums.taken.sum, this.g, this.sums);
      if (this.run.lattice.kind === "square") this.moved.corners = cornersOf(this.run.lattice, this.run.kinds, this.moved.displacement);
    }
    return this.moved;
  }
  /** What the colours show, by key; NaN where no agent is awake. */
  values(colour = this.look.colour) {
    const { run, g, sums } = this, { lattice: L, C, kinds, spawn } = run, v = new Float64Array(L.size).fill(NaN);
    const awake = (k) => spawn[k] > 0 && spawn[k] <= g, taken = sums.taken.sum;
    if (colour === "now") {
      const { offset, index, value } = run.taken;
      for (let k = 0; k < L.size; k++) if (awake(k)) v[k] = 0;
      if (g) for (let i = offset[g - 1]; i < offset[g]; i++) v[Math.floor(index[i] / C)] += value[i];
      return v;
    }
    const own = colour === "kept" ? run.scene.materials.map((m) => sharesOf(run.scene.rule, m, L.dimension).own) : null;
    const moved = colour === "move" || colour === "stress" ? this.deformed() : null;
    for (let k = 0; k < L.size; k++) {
      if (kinds[k] < 0) continue;
      if (colour === "move") { v[k] = size(moved.displacement, k); continue; }
      if (!awake(k)) continue;
      if (colour === "spawn") { v[k] = spawn[k]; continue; }
      if (colour === "stress") { v[k] = Math.max(...moved.pressure.map((p) => Math.abs(p[k]))); continue; }
      let sum = 0;
      for (let c = 0; c < C; c++) sum += taken[k * C + c];
      v[k] = !own ? sum : sums.kept ? this.keptBy(k) : own[kinds[k]] * sum;
    }
    return v;
  }
  /** What agents of one's own kept (N), along all axes. */
  keptBy(k) {
    const { axes } = this.run.lattice, { kept } = this.sums;
    return axes.reduce((sum, _, n) => sum + Math.abs(kept.sum[k * axes.length + n]), 0);
  }
  /** Ends of the colours, from the last generation, so that frames compare. */
  scale(colour = this.look.colour) {
    if (!this.scales.has(colour)) {
      const keep = this.g;
      let high = 0;
      if (colour === "now") for (const x of this.run.taken.value.subarray(0, this.run.taken.n)) { if (x > high) high = x; }
      else {
        this.goTo(Infinity);
        for (const x of this.values(colour)) if (x > high) high = x;
        this.goTo(keep);
      }
      const log = LOGARITHMIC.has(colour);
      this.scales.set(colour, { high: high || 1, low: log ? (high || 1) * 1e-4 : colour === "spawn" ? 1 : 0, log });
    }
    return this.scales.get(colour);
  }
  /** By how much displacements are magnified: the largest is shown as a fifteenth of the body. */
  magnification() {
    const extent = Math.max(...this.run.lattice.shape) * this.run.lattice.h;
    return 10 ** this.look.magnify * 0.066 * extent / (this.scale("move").high || 1);
  }

  // ---------------------------------------------------------------------------------- drawing
  later() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => { this.pending = false; this.draw(); });
  }
  draw() {
    if (!this.canvas?.clientWidth) return;
    const { run, look, inks, t } = this, { lattice: L } = run, scale = this.scale(), values = this.values();
    const moved = look.deformed && this.deformable ? this.deformed() : null, factor = moved ? this.magnification() : 0;
    const cut = L.dimension === 3 ? look.cut : null;
    const view = this.view = new View(this.canvas, L, look.camera);
    paintCells(view, run.kinds, values, scale, inks, { moved, factor, cut });
    const shown = (k, cell) => !cut || cut.axis < 0 || cell[cut.axis] === cut.at;
    if (look.path && run.passed) paintPath(view, this.sums.passed.sum, inks, shown);
    if (look.arrows && this.g > 0) {
      const from = run.taken.offset[this.g - 1], to = run.taken.offset[this.g];
      paintLoads(view, { index: run.taken.index.subarray(from, to), value: run.taken.value.subarray(from, to) }, run.C, inks, shown);
    }
    paintForces(view, this.scene.loads, inks);
    if (this.picked >= 0) paintPick(view, L.cell(this.picked), inks);
    paintLegend(view, scale, t(look.colour), (v) => quantity(v, UNITS[look.colour]), inks);
    this.parts.cap.textContent = moved ? t("magnified", { n: quantity(factor, "") }) : run.grown && this.g >= run.generation ? t("grown") : "";
    if (look.beside && this.parts.others.length) this.drawElastic();
    this.words();
    this.drawn = (this.drawn ?? 0) + 1;
  }
  words() {
    const { run, t, parts, g } = this, done = this.over;
    parts.count.textContent = t(done ? "generation" : "running", { g, n: run.generation });
    parts.time.max = run.generation; parts.time.value = g; parts.time.ariaValueText = parts.count.textContent;
    this.tellPlaying();
    this.canvas.ariaLabel = t("picture", { g: parts.count.textContent, a: run.alive[g - 1] ?? 0 });
    if (!this.playing || this.picked >= 0) tellStory(this, parts.story, make);
    if (this.curves?.length !== run.generation) this.curves = { length: run.generation, list: curvesOf(run) };
    paintCharts(parts.charts, this.curves.list, g, t, this.inks);
  }
  tellPlaying() {
    const { parts, t } = this, on = Boolean(this.playing);
    if (parts.shows === on) return;
    parts.shows = on;
    parts.play.replaceChildren(icon(on ? "pause" : "play"), ` ${t(on ? "pause" : "play")}`);
  }
  /** The cells as polygons with their colours, for files; null when they are many or deformed. */
  polygons() {
    const { run, view } = this, { lattice: L, kinds } = run;
    if (L.dimension === 3 || this.look.deformed || L.size > 20000) return null;
    const values = this.values(), scale = this.scale(), list = [];
    L.each((k) => {
      if (kinds[k] < 0) return;
      const c = view.centre(L.cell(k)), round = L.hexagon ? 6 : 4, r = L.hexagon ? 0.5774 : Math.SQRT1_2;
      const turned = L.hexagon ? 0 : Math.PI / 4;
      const points = Array.from({ length: round }, (_, i) => view.at(c[0] + r * Math.sin(turned + i * 2 * Math.PI / round), c[1] + r * Math.cos(turned + i * 2 * Math.PI / round)));
      list.push({ points, fill: values[k] >= 0 ? `rgb(${COLOURS[Math.round(255 * place(values[k], scale))]})` : this.inks.cell });
    });
    return list;
  }

  // -------------------------------------------------------------------------- building, themes
  buildStage() {
    this.canvas = make("canvas", { tabIndex: 0, role: "application" });
    this.parts.cap = make("div", { className: "cap", role: "status" });
    this.parts.tip = make("div", { className: "tip", hidden: true });
    this.parts.others = [];
    this.stageBox = make("div", { className: "stage" }, make("div", {}, this.canvas, this.parts.cap, this.parts.tip));
    this.canvas.addEventListener("pointerdown", (event) => this.press(event));
    this.canvas.addEventListener("pointermove", (event) => this.move(event));
    this.canvas.addEventListener("pointerup", (event) => this.release(event));
    this.canvas.addEventListener("pointerleave", () => { this.parts.tip.hidden = true; });
  }
  rebuild() {
    const focus = this.root.activeElement?.textContent;
    this.parts.shows = null;
    this.parts.header = buildHeader(this);
    this.host.replaceChildren(this.parts.header, ...(this.touchable ? [buildTries(this)] : []), this.stageBox, buildFooter(this), buildAside(this));
    this.host.lang = this.language;
    this.certify(); this.later();
    if (focus) [...this.host.querySelectorAll("button")].find((b) => b.textContent === focus)?.focus();
  }
  header() {
    const fresh = this.changed ? this.t("changed") : this.t(this.kind);
    this.parts.header.querySelector(".mode").textContent = fresh;
  }
  speak(language) { this.language = language; this.t = say(language); this.rebuild(); this.header(); }
  dress(dark) {
    this.dark = dark;
    this.root.host.classList.toggle("dark", dark);
    const style = getComputedStyle(this.root.host);
    this.inks = {};
    for (const name of ["ink", "faint", "paper", "line", "cell", "mark", "pull", "force", "path", "accent"]) {
      this.inks[name] = style.getPropertyValue(`--${name}`).trim() || "#888888";
    }
    const toggle = this.parts.header?.querySelector("button.icon");
    if (toggle) toggle.ariaPressed = String(dark);
    if (this.root.host.whole) document.documentElement.style.background = this.inks.paper;
    this.later();
  }
  announce(text) { this.parts.cap.textContent = text; }

  // -------------------------------------------------------------------------- mouse and keys
  press(event) {
    const { view, run } = this, L = run.lattice;
    if (L.dimension === 3) { this.hold = { x: event.clientX, y: event.clientY, ...this.look.camera }; this.canvas.setPointerCapture(event.pointerId); return; }
    const cell = view.cellAt(event.offsetX, event.offsetY);
    this.canvas.setPointerCapture(event.pointerId);
    const load = this.touchable && this.pen === "look" ? this.loadNear(event.offsetX, event.offsetY) : null;
    this.hold = load ? { load } : { pen: true };
    if (!load) this.touch(cell);
  }
  release({ clientX, clientY, offsetX, offsetY }) {
    const { hold } = this;
    this.hold = null;                          // who has not turned the cubes has clicked one
    if (hold?.x !== undefined && Math.hypot(clientX - hold.x, clientY - hold.y) < 4) this.touch(this.view.cellAt?.(offsetX, offsetY));
  }
  loadNear(px, py) {
    const { view } = this;
    return this.scene.loads.find(({ cell, force }) => {
      const size = Math.hypot(...force) || 1, [x, y] = view.at(...view.centre(cell)), gap = view.u / 2 + 18;
      return Math.hypot(px - x + force[0] / size * gap, py - y - force[1] / size * gap) < 20;
    });
  }
  move(event) {
    const { hold, view, run, parts } = this, L = run.lattice;
    if (L.dimension === 3 && hold && event.buttons) {
      this.look.camera = { yaw: hold.yaw - (event.clientX - hold.x) / 150, pitch: Math.max(0.05, Math.min(1.5, hold.pitch + (event.clientY - hold.y) / 150)) };
      this.later();
      return;
    }
    const cell = view?.cellAt(event.offsetX, event.offsetY);
    if (hold?.load && event.buttons) { if (cell) this.moveLoad(hold.load, cell); return; }
    if (hold?.pen && event.buttons && this.pen !== "look") { this.touch(cell); return; }
    parts.tip.hidden = !cell || event.pointerType === "touch";
    if (!cell) return;
    const value = this.values()[L.key(cell)];
    parts.tip.textContent = `(${cell.join(", ")})${value >= 0 ? ` ${quantity(value, UNITS[this.look.colour])}` : ""}`;
    parts.tip.style.left = `${Math.min(event.offsetX + 14, this.canvas.clientWidth - 130)}px`;
    parts.tip.style.top = `${event.offsetY + 12}px`;
  }
  moveLoad(load, cell) {
    const k = this.run.lattice.key(cell);
    if (this.run.kinds[k] < 0 || cell.every((c, a) => c === load.cell[a])) return;
    this.change(() => { Object.assign(load, { cell, sense: load.sense === "side" ? "surface" : load.sense, face: entering(this.run.lattice, this.run.kinds, k, load.force) }); });
  }
  /** Read a cell's story, or draw it, as the pen says. */
  touch(cell) {
    if (!cell) return;
    if (this.pen === "look" || !this.touchable) { this.picked = this.run.lattice.key(cell); this.later(); return; }
    const at = cell[0] * this.scene.lattice.shape[1] + cell[1], kind = Number(this.pen);
    if (this.cells[at] === kind) return;
    if (kind < 0 && this.scene.loads.some((load) => load.cell.every((c, a) => c === cell[a]))) return;   // a load needs its cell
    this.change(() => { this.cells[at] = kind; });
  }
  seekChart(x) {
    const half = this.parts.charts.clientWidth / 2, part = (x % half) / (half - 4);
    this.seek(Math.round(1 + part * (this.run.generation - 1)));
  }
  key(event) {
    const target = event.composedPath()[0], typing = target.matches?.("input, select, [role=tab]");
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (target === this.canvas && this.walk(event)) { event.preventDefault(); return; }
    if (event.key === " " && !(target.matches?.("button, select, summary, input[type=checkbox], input[type=radio]"))) { this.toggle(); event.preventDefault(); return; }
    if (typing) return;
    const jump = { ArrowLeft: this.g - 1, ArrowRight: this.g + 1, Home: 0, End: Infinity, ",": this.g - 1, ".": this.g + 1 }[event.key];
    if (jump !== undefined) { this.seek(jump); event.preventDefault(); }
  }
  walk(event) {                                // arrows on the picture go from cell to cell
    const { lattice: L } = this.run, way = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1], PageDown: [2, -1], PageUp: [2, 1] }[event.key];
    if (way && way[0] < L.dimension) {
      const cell = this.picked >= 0 ? L.cell(this.picked) : (this.scene.loads[0]?.cell ?? L.shape.map((n) => n >> 1)).slice();
      if (this.picked >= 0) cell[way[0]] += way[1];
      if (L.contains(cell)) {
        const load = event.shiftKey && this.touchable && this.scene.loads.find((l) => L.key(l.cell) === this.picked);
        this.picked = L.key(cell);
        if (load) this.moveLoad(load, cell);
        this.later();
      }
      return true;
    }
    if (event.key === "Enter" && this.picked >= 0) { this.touch(L.cell(this.picked)); return true; }
    return false;
  }

  // ------------------------------------------------------------------------- elasticity beside
  showElastic(on) {
    this.look.beside = on;
    clearTimeout(this.asking);
    this.worker?.terminate();
    this.worker = null;
    for (const box of this.parts.others) box.hidden = !on;
    if (!on) { this.answer = null; this.later(); return; }
    if (!this.parts.others.length) this.buildOthers();
    this.asking = setTimeout(() => this.askElastic(), this.answer ? 60 : 0);
    this.later();
  }
  askElastic() {
    if (this.scene.lattice.kind !== "square") { this.channel.solve(); return; }
    const url = URL.createObjectURL(new Blob([this.elasticText], { type: "text/javascript" }));
    const part = (load) => Math.min(1, this.stage / load.steps);
    const loads = this.scene.loads.map((load) => ({ ...load, force: load.force.map((f) => f * part(load)) }));
    this.worker = new Worker(url);
    this.worker.onmessage = ({ data: { answer, error } }) => {
      URL.revokeObjectURL(url);
      this.answer = answer ?? null; this.why = error;
      this.later();
    };
    this.worker.postMessage({ scene: this.scene, cells: this.cells, loads });
  }
  takeElastic({ seconds, error }, { displacement, stress }) {   // from Python: one row a component
    const { size } = this.run.lattice, rows = (column) => Array.from({ length: column.length / size }, (_, n) => column.subarray(n * size, (n + 1) * size));
    this.answer = error ? null : { displacement: rows(displacement), stress: rows(stress), seconds };
    this.why = error;
    this.later();
  }
  buildOthers() {
    this.parts.others = [0, 1].map(() => make("div", {}, make("canvas", { role: "img" }), make("div", { className: "cap" })));
    this.stageBox.append(...this.parts.others);
    new ResizeObserver(() => this.later()).observe(this.parts.others[0].firstChild);
  }
  /** The elastic answer, and by how much the rule differs from it. */
  drawElastic() {
    const { answer, run, inks, look, t, parts } = this, { lattice: L, kinds } = run, [one, two] = parts.others;
    if (!answer) { one.lastChild.textContent = this.why ? t("noAnswer", { why: this.why }) : t("solving"); return; }
    const stress = look.colour === "stress", axes = L.dimension, cut = axes === 3 ? look.cut : null;
    const mine = this.deformed().displacement, v = new Float64Array(L.size).fill(NaN), difference = v.slice();
    let high = 0, moved = 0, worst = 0, sum = 0, own = 0, count = 0;
    L.each((k) => {
      if (kinds[k] < 0) return;
      const length = size(answer.displacement, k);
      v[k] = stress ? Math.max(...answer.stress.slice(0, axes).map((s) => Math.abs(s[k]))) : length;
      difference[k] = Math.hypot(...mine.map((u, a) => u[k] - answer.displacement[a][k]));
      high = Math.max(high, v[k]); moved = Math.max(moved, length); worst = Math.max(worst, difference[k]);
      own = Math.max(own, size(mine, k)); sum += difference[k]; count++;
    });
    const shape = look.deformed ? { displacement: answer.displacement, corners: cut ? null : cornersOf(L, kinds, answer.displacement) } : null;
    const factor = shape ? 10 ** look.magnify * 0.066 * Math.max(...L.shape) * L.h / (moved || 1) : 0;
    const draw = (box, values, scale, word, unit, moving) => {
      const view = new View(box.firstChild, L, look.camera);
      paintCells(view, kinds, values, scale, inks, { moved: moving, factor, cut });
      paintLegend(view, scale, word, (x) => quantity(x, unit), inks);
      box.firstChild.ariaLabel = word;
    };
    const top = high || 1, word = `${t("elastic")}: ${t(stress ? "stress" : "move")}`;
    draw(one, v, { low: stress ? top * 1e-4 : 0, high: top, log: stress }, word, stress ? "Pa" : "m", shape);
    draw(two, difference, { low: 0, high: worst || 1, log: false }, t("error"), "m", null);
    one.lastChild.textContent = t("solvedIn", { n: general(answer.seconds, 2) }) + (shape ? ` · ${t("magnified", { n: quantity(factor, "") })}` : "");
    two.lastChild.textContent = t("misfit", { a: quantity(own, "m"), b: quantity(moved, "m"), n: general(100 * sum / count / (moved || 1), 2) });
  }

  storyOf(k) { return storyOf(this, k); }
}

const size = (components, k) => Math.hypot(...components.map((u) => u[k]));

/** What everybody tries: presets for a scene that brings none. */
function usual(scene) {
  if (scene.rule.kind !== "prescribed") return [];
  const other = (edit) => { const s = copyOf(scene); edit(s.rule); return s; };
  const alpha = scene.rule.alpha ?? (scene.lattice.shape.length === 2 ? [0.5, 0.5, 0.25] : [0.5, 0.5, 0.125]);
  return [
    { word: "tryFine", scene: other((r) => { r.threshold /= 10; }) },
    { word: "tryWalk", scene: other((r) => { r.beta = 1; }) },
    { word: "tryAdd", scene: other((r) => { r.accumulate = true; r.alpha = [alpha[0], 0.9 * alpha[1], 0.6 * alpha[2]]; r.beta = 0.7; }) },
    { word: "tryBlow", scene: other((r) => { r.accumulate = true; r.alpha = [alpha[0], Math.max(alpha[1], 0.5), Math.max(alpha[2], 0.25)]; }) },
  ];
}
