// Agents written in the page: an editor, a worker that runs their Python, and the run that comes of it.
import { button, choice, make, slider, tick } from "./controls.js";
import { Log, Recorded } from "./history.js";
import { appliedLoads, dot, sharesOf } from "./rule.js";
import { hand } from "./save.js";
import { tomlOf } from "./scene.js";
import { general } from "./words.js";

const SILENCE = 2000, SEED = 1, CELLS = 40000, PRINTED = 200, MOST_PRINTED = 1000;   // ms without a word; at most so many cells, and lines that are shown

/** What Python is told of the scene: the tables that page and agents share. */
export function bodyOf({ scene, cells, stage }, run, parameters) {
  const { lattice: L, kinds } = run, { rule, materials } = scene, sense = Boolean(rule.sense);
  const shares = materials.map((m) => { const s = sharesOf(rule, m, L.dimension); return [s.own, s.forward, 0, s.friction, s.poisson, s.beta * m.poissons_ratio]; });
  const normal = (n) => L.normals[L.axes[n]], along = L.axes.map((_, a) => L.axes.map((_, n) => dot(normal(n), normal(a)) ** 2));
  const axis = Array.from({ length: L.D }, (_, d) => L.axes.findIndex((arm) => arm === d || L.opposite[arm] === d));
  return { lattice: { directions: L.D, states: sense ? 2 * L.D : L.D, stride: L.stride, padded: L.padded, steps: L.steps.map((s) => Array.from(s)), opposite: L.opposite,
    mirrored: L.mirrored, axis_of: axis, beside: L.beside.map((list) => list.toSorted((a, b) => a[0] - b[0])), along, cell_size: L.h, dimension: L.dimension, shape: L.shape },
  threshold: rule.threshold, accumulate: rule.accumulate, sense, cross_section: L.faceArea(scene.thickness), kinds: Array.from(kinds),
  materials: materials.map((m) => [m.name, m.youngs_modulus, m.poissons_ratio]), shares, loads: appliedLoads(scene, L, kinds, stage), parameters, seed: SEED };
}

/** A run that Python sends generation by generation. */
class Written extends Recorded {
  constructor(page, states) {
    super(page.scene, page.cells, page.stage);
    this.atRest = false; this.states = states;
    for (const name of ["passed", "dropped", "returned", "kept", "stretch", ...states.map(([n]) => `state ${n}`)]) this[name] = new Log(new Uint32Array(256), new Float64Array(256));
  }
  take(news) {
    this.generation++;
    let waits = 0;
    const put = (log, rows = {}) => { for (const [place, value] of Object.entries(rows)) log.push(Number(place), value); log.close(); };
    for (const value of Object.values(news.taken)) waits += value;
    put(this.taken, news.taken);
    for (const name of ["passed", "dropped", "returned", "kept", "stretch"]) put(this[name], news[name]);
    for (const [name] of this.states) put(this[`state ${name}`], news[name]);
    for (const [k, woken] of news.born) { this.spawn[k] = this.generation; this.woken[k] = woken; this.agents++; }
    this.alive.push(this.agents); this.waits.push(waits);
  }
}

// ------------------------------------------------------------------- what went wrong, in words

const ALLOWED = ["kaju", "math", "random", "typing", "dataclasses", "__future__"];
const REFUSED = /(?<![\w.])(eval|exec|compile|open|input|__import__|globals|locals|vars|breakpoint|window|document|javascript|browser|setattr|delattr|getattr)\b|\b__(?!init__|name__|main__|repr__|str__|class__|post_init__|future__)\w+__/;

/** The code without strings and comments: its lines stay where they are. */
const bare = (code) => code.replace(/("""|''')[\s\S]*?\1|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'|#.*/g, (text) => text.replace(/[^\n]/g, " "));

/** What no agent may use, before anything runs: {line, word}. */
export function refused(code) {
  const lines = bare(code).split("\n");
  for (const [n, text] of lines.entries()) {
    const brings = text.match(/^\s*(?:from\s+([\w.]+)\s+import|import\s+([\w.]+))/), from = brings && (brings[1] ?? brings[2]).split(".")[0];
    if (brings && !ALLOWED.includes(from)) return { line: n + 1, word: from, key: "notInPage" };
    const found = !brings && text.match(REFUSED);
    if (found) return { line: n + 1, word: found[0], key: "notAllowed" };
  }
  return null;
}

function distance(a, b) {
  let row = Array.from({ length: b.length + 1 }, (_, i) => i);
  for (let i = 1; i <= a.length; i++) row = row.reduce((next, _, j) => [...next, j ? Math.min(next[j - 1] + 1, row[j] + 1, row[j - 1] + (a[i - 1] === b[j - 1] ? 0 : 1)) : i], []);
  return row[b.length];
}
const NAMES = "MaterialAgent FreeBoundaryAgent RigidBoundaryAgent RollerBoundaryAgent Load Emission Shares Parameter State direction magnitude copies sense total arm share kept taken passed dropped squeezed index model material shares threshold generation emissions take pass_on shortening give_back turn spawn_step woken_by random super self load True False None return import range print super append hand_over uniform choice random own forward friction poisson".split(" ");
const closest = (word, code) => [...NAMES, ...new Set(bare(code).match(/[A-Za-z_]\w*/g))].filter((n) => n !== word && distance(n, word) <= Math.max(1, word.length >> 2)).sort((a, b) => distance(a, word) - distance(b, word))[0];

/** An error in the reader's language. */
export function told(t, { error, args = [], line }, code) {
  const text = args[0] ?? "", at = (words) => ({ error: t("atLine", { n: line, e: words }), line });
  const name = text.match(/(?:name|local variable|attribute|import name) '(\w+)'/)?.[1], near = name && closest(name, code), mean = near ? t("didYouMean", { n: near }) : "";
  if (error === "NameError" || error === "UnboundLocalError") return at(t("notKnown", { n: name }) + mean);
  if (error === "AttributeError" && /has no attribute/.test(text)) return at(t("hasNo", { a: text.match(/'([\w.]+)' object/)?.[1] ?? text.match(/'([\w.]+)'/)?.[1] ?? "", n: name }) + mean);
  if (error === "ImportError") return at(t("hasNo", { a: "kaju", n: name }) + mean);
  const word = { IndentationError: "indentation", TabError: "indentation", SyntaxError: "notPython", RecursionError: "recursion", ZeroDivisionError: "zeroDivision", KeyError: "noKey", IndexError: "noIndex" }[error];
  if (word) return at(t(word, { e: text }));
  return at(["AgentError", "ParameterError", "KajuError"].includes(error) ? text : `${error}: ${text}`);
}

// ------------------------------------------------------------------------------- the workshop

export class Workshop {
  constructor(page, { code, ready, blob, licence }) {
    Object.assign(this, { page, code, ready, blob, licence, first: code, states: [], parameters: [], names: [], values: {}, printed: "", problem: null, active: false, foreign: false });
    globalThis.kaju = { runAgent: (text) => this.run(text) };
    setTimeout(() => this.wake(), 50);
  }
  /** A worker that has read Brython and kaju's agents, before anybody asks. */
  wake() {
    if (this.worker) return;
    this.url ??= URL.createObjectURL(new Blob([this.blob], { type: "text/javascript" }));
    this.worker = new Worker(this.url);
    this.awake = new Promise((done) => { this.worker.onmessage = ({ data }) => { if (data.ready) { this.worker.onmessage = (event) => this.hear(event.data); done(); } }; });
  }
  /** Run a code on the page's scene: {agents, generations, taken} or {error, line}. */
  run(code = this.code, lines = false) {
    this.stop();
    if (code !== this.code) { this.code = code; if (this.field) { this.field.value = code; this.number(); } }
    Object.assign(this, { active: true, foreign: false, printed: "", problem: null, line: 0, shown: 0, fresh: null, retried: lines });
    const { page } = this, no = refused(code), result = this.pending ?? Promise.withResolvers?.() ?? {};
    if (!result.promise) result.promise = new Promise((resolve) => { result.resolve = resolve; });
    this.pending = result;
    if (no) { this.end({ error: page.t("atLine", { n: no.line, e: page.t(no.key, { n: no.word }) }), line: no.line }); return result.promise; }
    if (page.cells.length > CELLS) { this.end({ error: page.t("tooLarge", { n: CELLS }), line: 1 }); return result.promise; }
    this.wake();
    const worker = this.worker;
    this.awake.then(() => {
      if (worker !== this.worker || !this.active) return;
      worker.postMessage({ code, body: JSON.stringify(bodyOf(page, new Written(page, []), this.values)), lines });
      this.busy = true; this.wait();
    });
    return result.promise;
  }
  wait() {
    clearTimeout(this.watch);
    this.watch = setTimeout(() => {
      const { line } = this;
      this.drop();
      if (!line && !this.retried) { this.run(this.code, true); return; }   // once more, to see in which line
      this.end({ error: this.page.t("atLine", { n: line || 1, e: this.page.t("silent") }), line: line || 1 });
    }, SILENCE);
  }
  drop() { this.worker?.terminate(); this.worker = null; this.busy = false; clearTimeout(this.watch); }
  stop() { if (this.busy) this.drop(); }
  hear(data) {
    if (!this.busy) return;
    const told_ = typeof data === "string" ? JSON.parse(data) : data;
    if (told_.steps !== undefined) { this.line = told_.line; if (told_.steps !== this.steps) { this.steps = told_.steps; this.wait(); } return; }
    if (told_.print !== undefined) { this.wait(); this.print(told_); return; }
    if (told_.error) { this.busy = false; this.end(told(this.page.t, told_, this.code)); return; }
    if (told_.names) { Object.assign(this, { names: told_.names, states: told_.states, parameters: told_.parameters }); this.fresh = new Written(this.page, told_.states); return; }
    for (const news of told_.news) this.fresh.take(news);
    this.wait();
    if (told_.end) { this.busy = false; this.fresh.atRest = true; this.fresh.grown = told_.end.pending > 0; this.show(); this.end(told_.end); }
  }
  /** The first lines are shown; who prints a thousand has a loop that does not end in mind, or in the code. */
  print({ print, at }) {
    if (this.shown++ < PRINTED) this.printed += print;
    if (this.shown > MOST_PRINTED) { this.drop(); this.end({ error: this.page.t("atLine", { n: at, e: this.page.t("printed", { n: MOST_PRINTED }) }), line: at }); }
  }
  /** The page shows what came of it. */
  show() {
    const { page } = this;
    page.kind = "runnable"; page.own = { names: this.names, source: this.code };
    page.adopt(this.fresh);
    page.goTo(page.goal ?? Infinity); page.goal = null;
    if (!page.colours.includes(page.look.colour)) page.look.colour = "taken";
  }
  end(result) {
    clearTimeout(this.watch);
    this.problem = result.error ? result : null;
    if (result.error) this.active = false;
    this.result = result;
    const { pending } = this;
    this.pending = null;
    this.page.rebuild();
    if (result.error && this.field?.isConnected) this.mark(result.line);
    pending?.resolve(result.error ? { error: result.error, line: result.line } : result);
  }
  /** Back to the standard rule. */
  leave() { this.stop(); this.active = false; this.states = []; this.problem = null; this.page.own = null; this.page.look.colour = "taken"; this.page.renew(Infinity); this.page.rebuild(); }
  /** Code that came with a link or a file is shown, and runs when somebody says so. */
  offer(code) { this.code = code; this.foreign = true; this.page.tab = "code"; if (this.field) this.field.value = code; this.page.rebuild(); }

  // ------------------------------------------------------------------------------ the editor
  panel() {
    const { page, page: { t } } = this;
    this.field ??= make("textarea", { className: "code", spellcheck: false, autocapitalize: "off", autocomplete: "off", wrap: "off", rows: 18, value: this.code,
      oninput: () => { this.code = this.field.value; this.number(); }, onkeydown: (event) => this.key(event), onscroll: () => { this.gutter.scrollTop = this.field.scrollTop; } });
    this.field.ariaLabel = t("codeField");
    this.gutter ??= make("pre", { className: "gutter", ariaHidden: "true" });
    this.number();
    const titles = Object.keys(this.ready), choose = choice(t("readyAgents"), this.chosen ?? "", [["", "–"], ...titles.map((n) => [n, page.say(this.ready[n].name)])], (n) => { if (n) { this.chosen = n; this.values = {}; this.code = this.field.value = this.ready[n].code; this.run(); } });
    const asks = this.ready[this.chosen] && this.ready[this.chosen].code === this.code ? [make("p", { className: "soft", textContent: page.say(this.ready[this.chosen].question) })] : [];
    const bars = this.active ? this.parameters.map((p) => (typeof p.value === "boolean" ? tick(p.label, p.value, (on) => this.turn(p, on))
      : slider(p.label, { value: p.value, min: p.low, max: p.high, step: p.whole ? 1 : (p.high - p.low) / 100, show: (v) => general(v, 4), t }, (v) => this.turn(p, v)))) : [];
    const words = this.problem ? this.problem.error : this.foreign ? t("foreign") : this.active && this.result?.agents !== undefined ? this.score() : t("codeHint");
    const out = make("p", { className: this.problem ? "verdict bad" : "verdict open", role: "status", textContent: words });
    return [choose, ...asks, make("div", { className: "editor" }, this.gutter, this.field),
      make("div", { className: "tools" }, button(`${t("runCode")} (Ctrl+Enter)`, () => this.run(), { className: "main" }), button(t("saveAgent"), () => this.save()), button(t("standardRule"), () => this.leave())),
      out, ...bars, ...(this.printed ? [make("pre", { className: "printed", tabIndex: 0, textContent: this.printed + (this.shown > PRINTED ? `… ${this.shown}` : "") })] : [])];
  }
  score() {
    const { agents, generations, taken, arrived } = this.result, n = (x) => general(x, 4);
    return this.page.t("codeScore", { a: agents, g: generations, t: n(taken), r: n(arrived), f: n(this.foot()) });
  }
  /** What has reached the ground below the left half (N). */
  foot() {
    const { run } = this.page, { lattice: L, kinds } = run, last = run.passed;
    let sum = 0;
    for (let i = 0; i < (last?.n ?? 0); i++) {
      const k = Math.floor(last.index[i] / L.D), arm = last.index[i] % L.D;
      if (kinds[L.neighbour(k, arm)] === -2 && L.cell(k)[0] < L.shape[0] / 2) sum += last.value[i];
    }
    return sum;
  }
  turn(parameter, value) { this.values = { ...this.values, [parameter.name]: value }; this.run(); }
  number() {
    const lines = this.field.value.split("\n").length, bad = this.problem?.line;
    this.gutter.textContent = Array.from({ length: lines }, (_, n) => (n + 1 === bad ? `▸${n + 1}` : n + 1)).join("\n");
  }
  mark(line) {
    const start = this.field.value.split("\n").slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0), end = this.field.value.indexOf("\n", start);
    this.field.setSelectionRange(start, end < 0 ? this.field.value.length : end);
  }
  key(event) {
    const { field } = this, { value, selectionStart: at, selectionEnd: to } = field, start = value.lastIndexOf("\n", at - 1) + 1;
    const type = (text) => { event.preventDefault(); document.execCommand("insertText", false, text); };
    if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) { event.preventDefault(); this.run(); return; }
    if (event.key === "Escape") { this.left = true; return; }   // then Tab leaves the editor
    if (event.key === "Tab" && !this.left && !event.shiftKey) type(" ".repeat(4 - (at - start) % 4));
    else if (event.key === "Tab" && !this.left && value.slice(start, start + 4) === "    ") { field.setSelectionRange(start, start + 4); type(""); }
    else if (event.key === "Enter") { const line = value.slice(start, at), indent = line.match(/^ */)[0]; type(`\n${indent}${/:\s*(#.*)?$/.test(line) ? "    " : ""}`); }
    else if (event.key === "Backspace" && at === to && at > start && /^ +$/.test(value.slice(start, at))) { field.setSelectionRange(Math.max(start, at - ((at - start - 1) % 4 + 1)), at); type(""); }
    if (event.key !== "Tab") this.left = false;
  }
  /** The agent, its scene and six lines that run it, as a Python file. */
  save() {
    const { page, code, names, values } = this, toml = tomlOf(page.scene, page.cells).replaceAll("\\", "\\\\").replaceAll('"""', "'''");
    const given = Object.entries(values).map(([n, v]) => `, ${n}=${v === true ? "True" : v === false ? "False" : v}`).join("");
    const cls = [...code.matchAll(/^class (\w+)\((\w+)/gm)].map(([, n, base]) => [n, base]), kind = { FreeBoundaryAgent: "free", RigidBoundaryAgent: "rigid", RollerBoundaryAgent: "roller" };
    const material = cls.filter(([n, base]) => !kind[base] && (names.includes(n) || !names.length)).at(-1)?.[0], walls = cls.filter(([, base]) => kind[base]).map(([n, base]) => `"${kind[base]}": ${n}`);
    const how = `${material ? `, material_agent=${material}` : ""}${walls.length ? `, boundary_agents={${walls.join(", ")}}` : ""}${given}, seed=${SEED}`;
    return hand("agent.py", new Blob([`${code.trimEnd()}\n\n\nSCENE = """\n${toml}"""\n\nif __name__ == "__main__":\n    from kaju import LoadModel, Scene\n\n    model = LoadModel(Scene.from_toml(SCENE)${how})\n    last = model.run().last\n    print(len(last.cells), last.generations, last.ledger.taken)\n`], { type: "text/x-python" }));
  }
}
