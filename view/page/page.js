// One view for all hosts: a run is drawn, whoever computed it: the twin in this page, or a record in the file.
import { certifying, sharesOf, Twin } from "./rule.js";
import { cornersOf, deformation } from "./deformation.js";
import { notesOf, Sums } from "./history.js";
import { inksOf, paintCells, paintLegend, paintLoads, paintNumbers, paintPath, paintPick, View } from "./paint.js";
import { curvesOf, paintGrid, partOf } from "./charts.js";
import { icon, make, offered, waysOf } from "./controls.js";
import { laySheet, Lesson } from "./lesson.js";
import { Loads } from "./loads.js";
import { Workshop } from "./agent.js";
import { follow, Past } from "./state.js";
import { storyOf, tellStory } from "./cell.js";
import { chosenLanguage, LANGUAGES, largest, quantity, recounted, roundDown, say, verdictOf } from "./words.js";
import { buildAside, buildBar, buildFooter, buildHeader, buildTries, modeCards, showKeys, tellMarks } from "./panels.js";

const UNITS = { taken: "N", now: "N", kept: "N", stress: "Pa", move: "m", spawn: "", density: "" };
const MOST_GENERATIONS = 4000, MOST_ROWS = 2e7, PLAYED = 30;   // more than that no page holds; computed ahead of what is played
const PATIENCE = 24;              // ms of computing at a time: input must not wait

export class Page {
  constructor(element, header) {
    const { kind, title = "", text = "", verdict = "", stable = true, language, lesson, own = null } = header;
    const asked = this.asked = new URLSearchParams(location.hash.slice(1));
    Object.assign(this, { kind, title, text, own, tab: "", pen: "look", picked: -1, g: 0, factor: 1, material: "",
      given: { verdict, stable }, elastic: { answer: null, why: "" }, parts: {}, presets: [], sheet: 1 });
    const known = (list) => list.map((l) => l?.slice(0, 2)).find((l) => l in LANGUAGES);
    this.language = known([asked.get("lang"), language, chosenLanguage(lesson && asked.get("lang")), ...(navigator.languages ?? [])]) ?? "en";
    this.t = say(this.language);
    this.look = { mode: "body", colour: "taken", deformed: false, magnify: 0, arrows: true, path: false, speed: 8, letters: true,
      camera: { yaw: -0.6, pitch: 0.5 }, cut: { axis: -1, at: 0, only: false } };
    this.begin(header);
    this.loads = new Loads(this);
    this.studio = header.python ? new Workshop(this, header.python) : null;
    this.lesson = lesson ? new Lesson(this, lesson) : null;
    this.host = make("div", { className: `all${asked.has("compact") ? " compact" : ""}` });
    this.root = element.shadowRoot;
    this.root.replaceChildren(this.host);
    this.past = new Past(this);
    const theme = asked.get("theme");
    this.dress(theme ? theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches);
    this.buildStage(); this.rebuild();
    new ResizeObserver(() => { if (this.canvas.clientWidth !== this.view?.w || this.canvas.clientHeight !== this.view.h) this.later(); }).observe(this.canvas);
    this.root.addEventListener("keydown", (event) => { if (!event.repeat) this.past.gesture++; this.key(event); });
    this.root.addEventListener("pointerdown", (event) => { this.past.gesture++; this.pressed = event.target !== this.canvas; }, true);
    for (const end of ["pointerup", "pointercancel"]) addEventListener(end, () => setTimeout(() => { this.pressed = false; if (this.stale) this.refresh(); }));
    this.lesson?.begin();
    addEventListener("beforeprint", () => laySheet(this));
    if (!this.lesson) this.seek(Infinity);   // a lesson asks first; else what came of it is seen first
    if (asked.get("s")) follow(this, asked.get("s"));
    this.draw();
    element.page = this;
  }
  /** A text in the reader's language: one for all, or one a language. */
  say(text) { return typeof text === "object" && text ? text[this.language] ?? text.en ?? Object.values(text)[0] : text; }
  nameOf(preset) { return preset.word ? this.t(preset.word) : this.say(preset.name); }
  /** Take what the header brings: here a scene, and a run unless the page makes it. */
  begin({ scene, cells, run = null, presets = [], lesson }) {
    this.start = { scene: structuredClone(scene), cells: cells.slice(), word: "asItWas" };
    this.scene = structuredClone(scene); this.cells = cells.slice(); this.stage = scene.stages;
    this.senseful = "sense" in scene.rule;
    this.presets = [this.start, ...(presets.length || this.own || lesson ? presets : usual(scene))];
    const { shape } = scene.lattice, load = scene.loads[0];    // cut cubes where the first load presses
    if (shape.length === 3) this.look.cut = { axis: 1, at: load ? load.cell[1] : shape[1] >> 1, only: false };
    this.adopt(run ?? this.compute());
  }
  get mode() { return offered(this).find((mode) => mode.name === this.look.mode); }
  /** How far the page may show: in a lesson no further than the question has got. */
  get limit() { return this.lesson?.limit ?? Infinity; }
  /** Whether a question asks for the rule alone: what elasticity answers is asked for later. */
  get comparable() { return this.solvable && this.deformable && this.limit > 0 && this.lesson?.step !== "predict"; }   // who guesses sees the rule alone
  get ruleAlone() { return Boolean(this.lesson?.question?.show?.alone && !this.lesson.teacher); }
  get elasticity() { return this.ruleAlone ? null : this.elastic.answer; }
  get touchable() { return this.kind === "runnable"; }
  get solid() { return this.run.lattice.dimension === 3; }
  word(key) { return key.startsWith("state ") ? this.say(this.run.states.find(([name]) => `state ${name}` === key)?.[1] ?? "") : this.t(key); }
  get stages() { return this.touchable ? this.scene.stages : 1; }
  get deformable() { return this.scene.rule.kind === "prescribed"; }
  /** Whether the body, its loads and its rule are those of a preset. */
  isAs({ scene, cells = this.start.cells }) { return JSON.stringify(scene) === JSON.stringify(this.scene) && cells.every((c, i) => c === this.cells[i]); }
  get colours() { return ["taken", "now", "spawn", ...(this.deformable ? ["kept", "stress", "move"] : []), ...(this.run.states ?? []).map(([name]) => `state ${name}`)]; }
  /** The page answers with elasticity for squares. */
  get solvable() { return this.scene?.lattice.kind === "square"; }

  // ----------------------------------------------------------------------------- the run
  compute() {
    const run = new Twin(this.scene, this.cells, this.stage).run(MOST_GENERATIONS, PATIENCE);
    clearTimeout(this.rest);
    const more = () => {
      if (this.run !== run) return;
      if (this.over) { if (this.plays) this.toggle(true); this.plays = false; return; }
      if (this.playing && run.generation > this.g + PLAYED) { this.rest = setTimeout(more, 100); return; }   // what is played comes first
      const atEnd = this.g === run.generation;
      run.run(MOST_GENERATIONS, PATIENCE);
      this.scales.clear();
      if (atEnd && !this.playing) this.seek(Infinity); else this.later();
      this.rest = setTimeout(more, 4);
    };
    requestAnimationFrame(() => { this.rest = setTimeout(more, 60); });   // what is known is painted first
    return run;
  }
  /** Whether the run goes no further. */
  get over() { const { run } = this; return run.atRest || run.grown || run.generation >= MOST_GENERATIONS || run.taken?.n > MOST_ROWS; }
  adopt(run) {
    this.run = run; this.scales = new Map(); this.moved = null; this.curves = null; this.seen = 0;
    this.sums = {};
    for (const [name, width] of Object.entries({ taken: run.C, ...notesOf(run) })) if (run[name]) this.sums[name] = new Sums(run[name], width * run.lattice.size);
  }
  /** Change the scene: the certificate says at once what is known; the run follows when that is painted. */
  change(edit) {
    edit();
    this.certify();
    this.header();
    this.past?.note();
    clearTimeout(this.rest);                   // nobody will look at the end of the old run
    this.due ??= requestAnimationFrame(() => { this.due = setTimeout(() => this.renew(), PATIENCE); });
    this.goal ??= this.g >= this.run.generation ? Infinity : this.g;
    this.mode?.changed?.(this);
  }
  renew(goal = this.goal) {
    cancelAnimationFrame(this.due); clearTimeout(this.due);
    this.due = null;
    if (this.studio?.active) { this.goal = goal; this.studio.run(); return; }
    this.goal = null;
    if (this.studio) this.own = null;
    this.adopt(this.compute());
    this.seek(goal);
  }
  load({ scene, cells, stage, look, generation, plays }) {
    this.scene = structuredClone(scene); this.cells = (cells ?? this.start.cells).slice(); this.stage = stage ?? scene.stages;
    this.factor = 1; this.picked = -1; this.material = "";
    if (this.look.mode === "cell") this.look.mode = this.lesson?.home ?? "body";   // that cell is of another body
    if (look) Object.assign(this.look, look);
    this.change(() => {});
    this.renew(generation ?? (this.lesson ? 0 : Infinity));
    this.rebuild();
    this.plays = plays;                          // once all of it is known
  }
  /** Change how the page looks: one step back for who undoes. */
  set(key, value) { this.look[key] = value; this.past.note(); this.later(); }
  /** Look in another way at the body: a name of MODES, or "body". */
  setMode(name, quiet = false) {
    this.opened?.close?.(this);                  // also one that is offered no more
    this.look.mode = name;
    if (!this.mode) this.look.mode = "body";
    this.opened = this.mode;
    this.opened?.open?.(this);
    if (!quiet) this.past.note();
    this.rebuild(this.lesson ? undefined : 0);
  }
  scaleLoads(factor) {
    this.scene.loads.forEach((load) => { load.force = load.force.map((f) => f * factor / this.factor); });
    this.factor = factor || 1e-300;
  }
  /** Say whether the loads will end: at once what is known at once, the rest while the reader goes on. */
  certify() {
    const { verdict, stable } = this.given, { kind } = this.scene.rule;
    clearTimeout(this.judging);
    this.judging = null;
    if (this.studio && this.own && this.touchable) { this.tellVerdict("", true); return; }
    if (kind !== "prescribed" || (verdict && !this.touchable)) { this.tellVerdict(recounted(this.t, verdict ?? ""), stable); return; }
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
    text = text.replace(" (accumulate = false)", "");    // an option's name is for those who program
    verdict.replaceChildren(text, ...(text && !this.lesson && this.deformable && !this.outcome ? [make("small", { textContent: this.t("keepsNone") })] : []));   // that all ends is not that all is well
    verdict.hidden = !text || this.limit < this.run.generation;   // it would give an answer away
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
    if (g > this.limit && Number.isFinite(g) && this.lesson.missing(this.lesson.question).length) this.lesson.ask();
    g = Math.min(g, this.limit);
    this.goTo(g);
    this.later();
  }
  /** Stop at a generation that a reader asks for. */
  stop(g) { this.playing = false; this.seek(g); }
  /** Whether Play goes no further from here. */
  get ended() { return this.g >= this.limit || (this.g >= this.run.generation && this.over); }
  toggle(on = !this.playing) {
    if (on && (this.limit === 0 || (this.g >= this.limit && this.lesson.question.guess))) { this.lesson.ask(); return; }
    this.playing = on;
    if (on && this.ended) this.goTo(0);
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
      if (this.ended) this.playing = false; else this.seek(Math.min(this.g + due, this.limit));
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
      if (colour.startsWith("state ")) { v[k] = sums[colour]?.sum[k] ?? 0; continue; }
      if (colour === "spawn") { v[k] = spawn[k]; continue; }
      if (colour === "stress") { v[k] = Math.max(...moved.pressure.map((p) => Math.abs(p[k]))); continue; }
      let sum = 0;
      for (let c = 0; c < C; c++) sum += taken[k * C + c];
      v[k] = !own ? sum : sums.kept ? this.keptAlong(k).reduce((a, b) => a + b) : own[kinds[k]] * sum;
    }
    return v;
  }
  /** What an agent of one's own kept (N), axis by axis. */
  keptAlong(k) {
    const { axes } = this.run.lattice;
    return axes.map((_, n) => Math.abs(this.sums.kept.sum[k * axes.length + n]));
  }
  /** Ends of the colours, from the last generation, so that frames compare; of loads that grow without end three decades of the present. */
  scale(colour = this.look.colour) {
    if (!this.scales.has(colour)) {
      const keep = this.g, { value, n } = this.run.taken;
      this.goTo(Infinity);
      const all = colour === "now" ? value.subarray(0, n) : this.values(colour), high = largest(all), known = this.run.states?.find(([name]) => `state ${name}` === colour);
      this.goTo(keep);
      const log = ["taken", "now", "kept", "stress"].includes(colour), grown = log && (this.run.grown || (colour !== "stress" && high > 1e6 * this.run.applied));
      this.scales.set(colour, { high: high || 1, low: log ? Math.max(1e-4 * high, Math.min(0.1 * high, colour === "taken" ? this.scene.rule.threshold ?? 0 : 0)) || 1e-4 : colour === "spawn" ? 1 : all.some((v) => v < 0) ? -high : 0, log, grown, known, whether: known?.[2] });
    }
    const scale = this.scales.get(colour), now = scale.grown ? 10 ** Math.ceil(Math.log10(largest(this.values(colour)) || 1)) : 0;
    return now ? { ...scale, high: now, low: 1e-3 * now } : scale;
  }
  /** By how much displacements are magnified: the largest is shown as a fifteenth of the body. */
  magnification() {
    return 10 ** this.look.magnify * roundDown(0.066 * Math.max(...this.run.lattice.shape) * this.run.lattice.h / (this.scale("move").high || 1));
  }

  // ---------------------------------------------------------------------------------- drawing
  later() {
    this.pending ||= requestAnimationFrame(() => this.draw());
  }
  draw() {
    cancelAnimationFrame(this.pending);
    this.pending = 0;
    if (!this.canvas?.clientWidth) return;
    if (this.mode?.draw) this.mode.draw(this); else this.drawBody();
    this.words();
    this.drawn = (this.drawn ?? 0) + 1;
  }
  /** The body at the start without colours, for who draws into it on paper; below it, if asked for, a strip for what the ground takes: more up, less down. */
  unmarked(preset, ground) {
    const { g, run, picked, lesson, canvas } = this, { hidden } = lesson, kinds = preset && run.lattice.kinds(preset.cells ?? this.start.cells, preset.scene.sides);   // whatever is loaded now
    Object.assign(this, { g: 0, picked: -1, run: kinds ? Object.create(run, { kinds: { value: kinds } }) : run }); lesson.hidden = true; this.drawBody();
    const { width, height } = canvas, ink = new Uint32Array(canvas.getContext("2d").getImageData(0, 0, width, height).data.buffer), across = Array.from(ink.keys()).filter((i) => ink[i] !== ink[0]);
    const [top, low] = [across[0], across.at(-1)].map((i) => Math.floor(i / width)), columns = across.map((i) => i % width), left = columns.reduce((a, b) => Math.min(a, b)), size = width / canvas.clientWidth * this.view.u, cells = run.lattice.shape[0];
    const sheet = Object.assign(make("canvas"), { width: columns.reduce((a, b) => Math.max(a, b)) + 1 - left, height: low + 1 - top + (ground ? 10 * size : 0) }), pen = sheet.getContext("2d");
    pen.drawImage(canvas, -left, -top);   // without what is empty around it
    if (ground) {
      pen.translate(width / canvas.clientWidth * this.view.x0 - left, low - top + 1.5 * size); pen.scale(size, size); pen.lineWidth = 0.05; pen.font = "2px sans-serif"; pen.textBaseline = "middle";
      for (let i = 0; i <= cells; i++) pen.strokeRect(i, 0, 0, 8);
      for (const y of [0, 3.97, 4.03, 8]) pen.strokeRect(0, y, cells, 0);
      pen.fillText("+", -1.5, 2); pen.fillText("−", -1.5, 6);
    }
    Object.assign(this, { g, picked, run }); lesson.hidden = hidden; this.drawBody();
    return sheet;
  }
  /** The body as it stands at this generation, in the whole canvas or a box of it. */
  drawBody(box = {}, values = this.values(), scale = this.scale()) {
    const { run, look, inks, t } = this, { lattice: L } = run;
    const moved = look.deformed && this.deformable ? this.deformed() : null, factor = moved ? this.magnification() : 0;
    const cut = L.dimension === 3 ? look.cut : null;
    const part = this.lesson && this.limit > 0 && !moved && !box.w ? this.lesson.part() : {}, view = this.view = new View(this.canvas, L, look.camera, this.lesson && !box.w ? { foot: 60, ...part } : box);
    paintCells(view, run.kinds, values, scale, inks, { moved, factor, cut });
    const shown = (k, cell) => !cut || cut.axis < 0 || cell[cut.axis] === cut.at;
    if (look.path && run.passed) paintPath(view, this.sums.passed.sum, inks, shown);
    if (look.arrows && this.g > 0 && !box.w) {
      const from = run.taken.offset[this.g - 1], to = run.taken.offset[this.g];
      paintLoads(view, { index: run.taken.index.subarray(from, to), value: run.taken.value.subarray(from, to) }, run.C, inks, shown);
    }
    if (this.lesson) paintNumbers(view, inks);
    this.loads.paint(view);
    if (this.picked >= 0) paintPick(view, L.cell(this.picked), inks);
    if (part.window) view.ctx.clearRect(0, view.h - 52, view.w, 52);
    if (!box.w && (!this.lesson || this.g > 0)) paintLegend(view, scale, this.word(look.colour), this.kindOf(scale), (v) => quantity(v, UNITS[look.colour], scale.log ? 0 : scale.high), inks, scale.whether ? [[0, t("no")], [1, t("yes")]] : null);
    const sensed = look.arrows && !box.w && run.C > L.D ? t("arrowKey") : "";
    const scaled = moved ? t("magnified", { n: quantity(factor, "") }) : run.grown && this.g >= run.generation ? t("grown") : run.atRest && !run.generation ? t("nothing") : look.colour === "taken" && this.picked >= 0 && !box.w && this.canvas.clientWidth > 520 && !sensed && values.some((v) => v > 1.001 * run.applied) ? t("takenMore") : "";
    const ruled = this.deformable && !box.w && moved ? t("keepsNone") : "";   // beside cuts a card says so
    const read = this.picked >= 0 && storyOf(this, this.picked), took = read ? `(${read.cell.join(", ")}): ${t("took")} ${quantity(read.total, "N")}` : "", asked = this.lesson?.question?.show?.rule ? `${t("agents")}: ${run.alive[this.g - 1] ?? 0}` : "";   // on a phone the panel is a long way down
    const numbers = [asked, took].filter(Boolean).join(" · "), notes = [scaled, ruled, sensed].filter(Boolean).join(" · ");
    this.parts.cap.replaceChildren(...(this.told ? [this.told] : [make("b", { textContent: numbers }), numbers && notes ? ` · ${notes}` : notes]));
  }
  /** What a legend says of its scale: in a lesson also that other examples have another. */
  kindOf({ log, whether }) { return whether ? "" : this.t(log ? "log" : "linear") + (this.lesson?.several && !/density|pull/.test(this.look.colour) ? ` · ${this.t("ownScale")}` : "") + (!this.lesson && this.look.colour === "von_mises" ? ` · ${this.t("largestOfEach")}` : ""); }
  words() {
    const { run, t, parts, g } = this, done = this.over, seen = this.seen = Math.max(this.seen, g), read = this.lesson && !this.lesson.teacher ? seen : Infinity;   // what a lesson lets read is played first
    this.tellTime(this.limit < run.generation ? t("generationOnly", { g }) : t(done ? "generation" : "running", { g, n: run.generation }));
    this.canvas.ariaLabel = t("picture", { g: parts.count.textContent, a: run.alive[g - 1] ?? 0 });
    if (!this.playing || this.picked >= 0) tellStory(this, parts.story);
    const at = performance.now();
    if (!parts.charts.isConnected || (this.playing && at - this.charted < 100)) return;   // curves need not keep up with frames
    this.charted = at;
    if (this.curves?.length !== run.generation) this.curves = { length: run.generation, list: curvesOf(run) };
    const over = run.alive.map((_, i) => i + 1);
    paintGrid(parts.charts, this.curves.list.filter(([word]) => this.lesson?.curves?.includes(word) ?? true).map(([word, unit, lists, names]) => ({ word: t(word), unit, over, lists: lists.map((list) => list.slice(0, read)), names: names.map(t), along: t("timeline"), now: g || null, limit: this.limit })), this.inks);
  }
  /** Where the page stands, at the timeline and the button. */
  tellTime(text) {
    const { parts, t, run, g } = this, on = Boolean(this.playing);
    parts.count.textContent = parts.time.ariaValueText = text;
    this.canvas.ariaLabel = `${this.say(this.title) || "kaju"}. ${text}`;
    if (!this.timed) this.look.speed = [1, 2, 4, 8, 15, 30, 60].find((n) => run.generation <= (this.lesson ? 20 : n < 15 ? 4 : 8) * n) ?? 60;   // nobody watches for minutes
    Object.assign(parts.time, { max: Math.min(run.generation, this.limit), value: g }); parts.speed.value = this.look.speed;   // no guess is told how long it goes on
    tellMarks(this); this.lesson?.tell();
    if (parts.shows === on) return;
    parts.shows = on;
    parts.play.replaceChildren(icon(on ? "pause" : "play"), ` ${t(on ? "pause" : "play")}`);
  }

  // -------------------------------------------------------------------------- building, themes
  buildStage() {
    this.canvas = make("canvas", { tabIndex: 0, role: "application" });
    this.parts.cap = make("div", { className: "cap", role: "status" });
    this.parts.tip = make("div", { className: "tip", hidden: true });
    this.stageBox = make("div", { className: "stage" }, make("div", {}, this.canvas, this.parts.cap, this.parts.tip));
    for (const [name, does] of [["down", "press"], ["move", "move"], ["up", "release"]]) this.canvas.addEventListener(`pointer${name}`, (event) => this[does](event));
    this.canvas.addEventListener("pointercancel", () => { this.hold = null; this.later(); });
    this.canvas.addEventListener("dblclick", (event) => { this.loads.double(event); });
    this.canvas.addEventListener("pointerleave", () => { this.parts.tip.hidden = true; });
  }
  /** Build all anew; what is read or chosen in the side stays where it was. */
  rebuild(seen = this.root.querySelector("aside .body")?.scrollTop ?? 0) {
    this.parts.shows = null;
    this.parts.header = buildHeader(this);
    const tries = this.touchable && !this.lesson && !this.mode?.alone ? [buildTries(this)] : [];
    this.anew(() => this.host.replaceChildren(this.parts.header, buildBar(this), ...tries, this.stageBox, buildFooter(this), buildAside(this)));
    this.root.querySelector("aside .body").scrollTop = seen;
    this.host.lang = this.language; this.host.dataset.sheet = this.sheet;
    this.certify(); this.header(); this.later();
  }
  /** What the way of looking says above the picture and beside it, anew; but nothing under a finger: its click would be lost. */
  refresh() {
    this.stale = this.pressed;
    if (this.stale) return;
    this.anew(() => { this.parts.bar.replaceWith(buildBar(this)); this.parts.cards.replaceChildren(...modeCards(this)); });
    this.later();
  }
  /** Build parts anew; what had the focus has it still. */
  anew(build) {
    const at = this.root.activeElement, focus = at?.textContent || at?.ariaLabel;
    build();
    if (at === this.canvas) at.focus();        // it was out of the page for a moment
    else if (focus && !at.isConnected) [...this.host.querySelectorAll("button, input, select, textarea")].find((b) => (b.textContent || b.ariaLabel) === focus)?.focus();
  }
  /** Whose picture it is, and who made it. */
  get whose() { return [...(this.own && this.touchable ? [] : [this.t(this.touchable && !this.presets.some((preset) => this.isAs(preset)) ? "changed" : this.kind)]), ...(this.own ? [this.studio?.asIs ? this.t("readyAgent", { n: this.say(this.studio.asIs.name) }) : this.t("ownAgents", { n: this.own.names.join(", ") })] : [])].join(" · "); }
  header() {
    this.parts.mode.textContent = this.whose;
    this.parts.presets?.forEach((b, n) => { b.ariaPressed = String(this.isAs(this.presets[n])); });
  }
  speak(language) { chosenLanguage(this.language = language); this.t = say(language); this.rebuild(); this.header(); }
  dress(dark) {
    this.dark = dark;
    this.root.host.classList.toggle("dark", dark);
    this.inks = inksOf(getComputedStyle(this.root.host));
    const toggle = this.parts.header?.querySelector("button.theme");
    if (toggle) toggle.ariaPressed = String(dark);
    if (this.root.host.whole) document.documentElement.style.background = this.inks.paper;
    this.later();
  }
  /** Say something for a while where the picture's words stand. */
  announce(text) {
    this.told = text;
    clearTimeout(this.saying);
    this.saying = setTimeout(() => { this.told = ""; this.later(); }, 4000);
    if (this.parts.cap) this.parts.cap.textContent = text;
  }

  // -------------------------------------------------------------------------- mouse and keys
  press(event) {
    this.canvas.setPointerCapture(event.pointerId); this.parts.tip.hidden = true;
    if (this.mode?.press?.(this, event)) return;
    if (this.solid) { this.hold = { x: event.clientX, y: event.clientY, ...this.look.camera }; return; }
    const grip = this.touchable && this.pen === "look" ? this.loads.grip(event) : null;
    this.hold = grip ?? { pen: true };
    if (!grip) { this.loads.chosen = -1; this.touch(this.view.cellAt(event.offsetX, event.offsetY)); }
    this.later();
  }
  release(event) {
    const { hold } = this;
    this.hold = null;                          // who has not turned the cubes has clicked one
    if (this.mode?.release?.(this, event)) return;
    if (hold?.ghost) this.loads.edit(hold.n, hold.ghost); else this.later();   // the arrow stands where its ghost was
    if (hold?.x !== undefined && Math.hypot(event.clientX - hold.x, event.clientY - hold.y) < 4) this.touch(this.view.cellAt?.(event.offsetX, event.offsetY));
  }
  move(event) {
    const { hold, view } = this;
    if (this.mode?.move?.(this, event)) return;
    if (this.turn(event)) return;
    const cell = view?.cellAt(event.offsetX, event.offsetY);
    if (hold?.grip && event.buttons) { this.loads.drag(hold, event); this.parts.tip.hidden = true; return; }
    if (hold?.pen && event.buttons && this.pen !== "look") { this.touch(cell); return; }
    this.tip(cell, event);
  }
  /** Turn a body in space by the hand. */
  turn({ buttons, clientX, clientY }) {
    const { hold, solid } = this;
    if (!solid || !hold || !buttons) return false;
    this.look.camera = { yaw: hold.yaw - (clientX - hold.x) / 150, pitch: Math.max(0.05, Math.min(1.5, hold.pitch + (clientY - hold.y) / 150)) };
    this.later();
    return true;
  }
  /** What a cell shows, in words: its value, or that no load has woken it. */
  shownAt(k) {
    const value = this.values()[k], { kinds, spawn } = this.run;
    return value >= 0 ? [quantity(value, UNITS[this.look.colour])] : this.g > 0 && kinds[k] >= 0 && spawn && !(spawn[k] > 0 && spawn[k] <= this.g) ? [this.t("asleepNow")] : [];
  }
  /** A tip at the cursor: the cell, and a line for its value. */
  tip(cell, event, lines = cell ? this.shownAt(this.run.lattice.key(cell)) : []) {
    const { tip } = this.parts, { offsetX: x, offsetY: y, target: { clientWidth: w, clientHeight: h } } = event;
    tip.hidden = !cell || event.pointerType === "touch";
    if (tip.hidden) return;
    tip.textContent = [`(${cell.join(", ")})`, ...lines].join("\n");
    tip.style.left = `${x > w - 150 ? Math.max(0, x - 14 - tip.offsetWidth) : x + 14}px`;
    tip.style.top = `${y > h - 66 - tip.offsetHeight ? y - 12 - tip.offsetHeight : y + 12}px`;   // off the legend
  }
  /** Read a cell's story, or draw it, as the pen says. */
  touch(cell) {
    if (!cell) return;
    if (this.pen === "look" || !this.touchable) { this.pick(this.run.lattice.key(cell), true); return; }
    const at = cell[0] * this.scene.lattice.shape[1] + cell[1], kind = Number(this.pen);
    if (this.cells[at] === kind) return;
    if (kind < 0 && this.scene.loads.some((load) => load.cell.every((c, a) => c === cell[a]))) { this.announce(this.t("needsCell")); return; }
    this.change(() => { this.cells = this.cells.slice(); this.cells[at] = kind; });
  }
  pick(k, open = false) {
    this.picked = k;
    if (open && this.look.mode === "body" && this.run.kinds[k] >= 0 && offered(this).some((mode) => mode.name === "cell")) this.setMode("cell");
    this.later();
  }
  seekChart(event) { this.stop(Math.round(1 + partOf(event) * (this.run.generation - 1))); }
  key(event) {
    const target = event.composedPath()[0], typing = target.matches?.("input, select, textarea, [role=tab]");
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && !target.matches?.("input[type=text], textarea")) {
      this.past.go(event.shiftKey ? 1 : -1);
      event.preventDefault();
      return;
    }
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Escape" && this.mode?.alone && !typing) { this.setMode(this.lesson?.home ?? "body"); this.canvas.focus(); return; }
    if (target === this.canvas && (this.mode?.key?.(this, event) || this.loads.key(event) || this.walk(event))) { event.preventDefault(); return; }
    if (event.key === " " && !(target.matches?.("button, select, summary, textarea, input[type=text], input[type=checkbox], input[type=radio]"))) { this.toggle(); event.preventDefault(); return; }
    if (typing) return;
    if (this.look.letters) {
      const mode = waysOf(this).find(({ letter }) => letter === event.key.toLowerCase());
      if (event.key === "?") { showKeys(this); return; }
      if (this.lesson && "1234".includes(event.key)) { this.lesson.enter(Number(event.key) - 1); return; }
      if (mode) { if (this.mode !== mode) this.setMode(mode.name); mode.called?.(this); return; }
    }
    const jump = { ArrowLeft: this.g - 1, ArrowRight: this.g + 1, Home: 0, End: Infinity, ",": this.g - 1, ".": this.g + 1 }[event.key];
    if (jump !== undefined) { this.stop(jump); event.preventDefault(); }
  }
  walk(event) {                                // arrows on the picture go from cell to cell
    const { lattice: L } = this.run, way = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1], PageDown: [2, -1], PageUp: [2, 1] }[event.key];
    if (way && way[0] < L.dimension) {
      const cell = this.picked >= 0 ? L.cell(this.picked) : (this.scene.loads[0]?.cell ?? L.shape.map((n) => n >> 1)).slice();
      if (this.picked >= 0) cell[way[0]] += way[1];
      if (L.contains(cell)) {
        const load = event.shiftKey && this.touchable && this.scene.loads.find((l) => L.key(l.cell) === this.picked);
        if (load) this.loads.edit(this.scene.loads.indexOf(load), { cell, force: load.force });
        this.pick(L.key(cell));
      }
      return true;
    }
    if (event.key === "Enter" && this.picked >= 0) { this.touch(L.cell(this.picked)); return true; }
    return false;
  }
  storyOf(k) { return storyOf(this, k); }
}

const size = (components, k) => Math.hypot(...components.map((u) => u[k]));

/** What everybody tries: presets for a scene that brings none. */
function usual(scene) {
  if (scene.rule.kind !== "prescribed") return [];
  const other = (edit) => { const s = structuredClone(scene); edit(s.rule); return s; };
  const alpha = scene.rule.alpha ?? (scene.lattice.shape.length === 2 ? [0.5, 0.5, 0.25] : [0.5, 0.5, 0.125]);
  return [
    { word: "tryFine", scene: other((r) => { r.threshold /= 10; }) },
    { word: "tryWalk", scene: other((r) => { r.beta = 1; }) },
    { word: "tryAdd", scene: other((r) => { r.accumulate = true; r.alpha = [alpha[0], 0.9 * alpha[1], 0.6 * alpha[2]]; r.beta = 0.7; }) },
    { word: "tryBlow", plays: true, scene: other((r) => { r.accumulate = true; r.alpha = [alpha[0], Math.max(alpha[1], 0.5), Math.max(alpha[2], 0.25)]; }) },
  ];
}
