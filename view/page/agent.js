// Agents written in the page: an editor, a worker that runs their Python, and the run that comes of it.
import { button, choice, make, slider, tick } from "./controls.js";
import { Recorded } from "./history.js";
import { appliedLoads } from "./rule.js";
import { hand, tomlOf } from "./scene.js";
import { general, roundDown } from "./words.js";

const SILENCE = 2000, CELLS = 40000, PRINTED = 200, MOST_PRINTED = 1000, LINES = 5;   // ms without a word; at most so many cells, and lines that are shown

// ------------------------------------------------------------------- what went wrong, in words

const ALLOWED = ["kaju", "math", "random", "typing", "dataclasses", "__future__"];
const REFUSED = /(?<![\w.])(eval|exec|compile|open|input|__import__|globals|locals|vars|breakpoint|window|document|javascript|browser|setattr|delattr|getattr|_page)\b|\b__(?!init__|name__|main__|repr__|str__|class__|post_init__|future__)\w+__/;

/** The code without strings and comments: its lines stay where they are. */
const bare = (code) => code.replace(/("""|''')[\s\S]*?\1|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'|#.*/g, (text) => text.replace(/[^\n]/g, " "));

/** What no agent may use, before anything runs: {line, word}. */
export function refused(code) {
  const lines = bare(code).split("\n"), methodOf = (text) => text.match(/^\s+def ([a-z]\w*)/)?.[1], hooked = lines.some((text) => HOOKS.includes(methodOf(text)));
  for (const [n, text] of lines.entries()) {
    const brings = text.match(/^\s*(?:from\s+([\w.]+)\s+import|import\s+([\w.]+))/), from = brings && (brings[1] ?? brings[2]).split(".")[0];
    if (brings && !ALLOWED.includes(from)) return { line: n + 1, word: from, key: "notInPage" };
    const found = !brings && text.match(REFUSED);
    if (found) return { line: n + 1, word: found[0], key: "notAllowed" };
    const method = methodOf(text), bareName = method?.toLowerCase().replace(/^(on|do)_|_agent$/g, ""), called = () => RegExp(`\\.${method}\\b`).test(lines.join("\n"));
    const hook = method && !HOOKS.includes(method) && !called() && (MEANT[bareName] ?? HOOKS.find((name) => name === bareName || near(bareName, name)) ?? (!hooked && /\(self, load\b/.test(text) && "take"));   // without any hook
    if (hook) return { line: n + 1, word: method, key: "notCalled", hook };
    if (method === "step" && !/\.step\b|\binbox\b/.test(lines.join("\n"))) return { line: n + 1, word: "super().step()", key: "neverTakes" };
  }
  return null;
}

const HOOKS = ["step", "take", "emissions", "pass_on", "shortening", "give_back", "turn"], MEANT = { emit: "emissions", receive: "take", go: "step", tick: "step", advance: "step" };   // as in own_agents.py
const near = (a, b) => a !== b && distance(a, b) <= Math.max(1, b.length >> 2);
function distance(a, b) {
  let row = Array.from({ length: b.length + 1 }, (_, i) => i);
  for (let i = 1; i <= a.length; i++) row = row.reduce((next, _, j) => [...next, j ? Math.min(next[j - 1] + 1, row[j] + 1, row[j - 1] + (a[i - 1] === b[j - 1] ? 0 : 1)) : i], []);
  return row[b.length];
}
const NAMES = "MaterialAgent FreeBoundaryAgent RigidBoundaryAgent RollerBoundaryAgent Load Emission Shares Parameter State direction magnitude copies sense total arm share kept taken passed dropped squeezed index position cell neighborhood agents agent_at model material shares threshold generation emissions take pass_on shortening give_back turn spawn_step woken_by random super self load True False None return import range print super append hand_over uniform choice random own forward friction poisson".split(" ");
/** The name that is meant: small letters stay small. */
const KEYWORD = /^(and|as|class|def|elif|else|for|from|if|import|in|is|lambda|not|or|pass|return|try|while|with|yield)$/;
const closest = (word, code) => [...NAMES, ...new Set(bare(code).match(/[A-Za-z_]\w*/g))].filter((n) => n.length > 2 && near(n, word) && !KEYWORD.test(n)).sort((a, b) => far(a, word) - far(b, word))[0], far = (a, b) => distance(a, b) + (a[0] !== b[0]) / 2;

/** What a guard of kaju says, in the reader's language; in English as it is. */
function guarded(t, text) {
  const [, hook, cls, cell, g, said] = text.match(/^(\w+): (\w+) at cell (\(.*?\)) in generation (\d+) (.*)$/s) ?? [];
  for (const [pattern, words] of t("guards").split("\n").map((row) => row.split("\t"))) {
    const found = words && (said ?? text).match(new RegExp(pattern, "s")), what = found && words.replace(/\$(\d)/g, (_, n) => found[n] ?? "");
    if (found) return said ? t("guard", { hook, cls, cell, g, what }) : what;
  }
  return text;
}
/** An error in the reader's language. */
export function told(t, { error, args = [], line }, code) {
  const text = args[0] ?? "", lost = text.match(/^(\w+): .* has this attribute/)?.[1];   // said at the end of the run, when no line of the code acts
  const n = code.split("\n").findIndex((row) => lost && row.includes(`.${lost}`)) + 1 || line, at = (words) => ({ error: t("atLine", { n, e: words }), line: n });
  const name = text.match(/(?:name|local variable|attribute|import name) '(\w+)'/)?.[1], from = code.split("\n")[n - 1]?.match(/^\s*from (\w+)/)?.[1] ?? "kaju", near = name && from === "kaju" && closest(name, code), mean = near ? t("didYouMean", { n: near }) : "";
  if (error === "NameError" || error === "UnboundLocalError") return at(t("notKnown", { n: name }) + (NAMES.slice(0, 9).includes(name) ? t("importIt", { n: name }) : mean));
  if (error === "ImportError" || (error === "AttributeError" && /has no attribute/.test(text))) return at(t("hasNo", { a: error === "ImportError" ? from : text.match(/'([\w.]+)' object/)?.[1] ?? text.match(/'([\w.]+)'/)?.[1] ?? "", n: name }) + mean);
  const word = { IndentationError: "indentation", TabError: "indentation", SyntaxError: "notPython", RecursionError: "recursion", ZeroDivisionError: "zeroDivision", KeyError: "noKey", IndexError: "noIndex", TypeError: "wrongType", ValueError: "wrongValue" }[error];
  const assigned = text === "invalid syntax" && /\b(if|elif|while|and|or|not)\b[^#]*[^=!<>:]=(?!=)/.test(bare(code).split("\n")[n - 1]);
  if (word) return at(t(word, { e: text }) + (assigned ? t("didYouMean", { n: "==" }) : ""));
  return at(["AgentError", "ParameterError", "KajuError"].includes(error) ? guarded(t, text) : t("wentWrong", { e: `${error}: ${text}` }));
}

// ------------------------------------------------------------------------------- the workshop

export class Workshop {
  constructor(page, { code, needs, values, ready, blob, licence }) {
    Object.assign(this, { page, code, needs, ready, blob, licence, first: code, ran: code, brought: code, words: Object.assign({}, ...Object.values(ready).map((one) => one.words)), parameters: [], names: [], values, begun: values, printed: "", problem: null, active: false, foreign: false, asks: !page.own?.source });
    this.chosen = this.named(code);
    globalThis.kaju = { runAgent: (text) => this.run(text) };
    setTimeout(() => this.wake(), 50);
  }
  /** A worker that has read Brython and kaju's agents, before anybody asks. */
  wake() {
    if (this.worker) return;
    this.url ??= URL.createObjectURL(new Blob([this.blob], { type: "text/javascript" }));
    this.worker = new Worker(this.url);
    this.awake = new Promise((done) => { this.worker.onmessage = ({ data }) => { if (data.ready) { this.worker.onmessage = (event) => this.hear(event.data); done(); } }; });
    this.worker.postMessage({ ...this.given(this.ready.standard.code), warming: true });
  }
  given(code) { const { page: { scene, cells, stage } } = this; return { code, scene, cells, stage, parameters: this.values }; }
  /** Run a code on the page's scene: {agents, generations, taken} or {error, line}. */
  run(code = this.code, lines = false) {
    if (this.busy) this.drop();
    if (code !== this.code) { this.code = code; if (this.field) { this.field.value = code; this.number(); } }
    const other = code !== this.ran;
    Object.assign(this, { active: true, ran: code, foreign: false, printed: "", problem: null, again: false, line: 0, shown: 0, retried: lines });
    if (other) this.page.past.note();
    const { page } = this, no = refused(code), result = this.pending ?? Promise.withResolvers?.() ?? {};
    if (!result.promise) result.promise = new Promise((resolve) => { result.resolve = resolve; });
    this.pending = result;
    const problem = no ? { error: page.t("atLine", { n: no.line, e: page.t(no.key, { n: no.word }) + (no.hook ? page.t("didYouMean", { n: no.hook }) : "") }), line: no.line } : page.cells.length > CELLS ? { error: page.t("tooLarge", { n: CELLS }), line: 1 } : null;
    if (problem) { this.end(problem); return result.promise; }
    this.wake();
    const worker = this.worker;
    this.awake.then(() => {
      if (worker !== this.worker || !this.active || code !== this.ran) return;   // of runs asked for while it wakes the last
      worker.postMessage({ ...this.given(code), lines });
      this.busy = true; this.wait();
    });
    return result.promise;
  }
  /** Run what a reader asks for; a question's guess comes first. */
  start() { this.page.goal = null; if (this.page.limit) this.run(); else requestAnimationFrame(() => this.page.lesson.ask()); this.say(); }
  wait() {
    clearTimeout(this.watch);
    this.watch = setTimeout(() => {
      this.drop();
      if (!this.line && !this.retried) { this.run(this.code, true); return; }   // once more, to see in which line
      this.end({ error: this.page.t("atLine", { n: this.line || 1, e: this.page.t("silent") }), line: this.line || 1 });
    }, SILENCE);
  }
  drop() { this.worker?.terminate(); this.worker = null; this.busy = false; clearTimeout(this.watch); }
  hear({ line, steps, print, at, error, args, declares, run, end, grew }) {
    if (!this.busy) return;
    if (steps !== undefined) { this.line = line; if (steps !== this.steps) { this.steps = steps; this.wait(); } return; }
    if (print !== undefined) { this.wait(); this.print(print, at); return; }
    if (error) { this.busy = false; this.end(told(this.page.t, { error, args, line }, this.code)); return; }
    if (declares) { Object.assign(this, declares); return; }
    this.busy = false;
    const recorded = this.otherThan(run);
    this.show(run); this.end({ ...end, ...(grew ? { grew } : {}), ...(recorded ? { recorded } : {}) });
  }
  /** Of whom a run was recorded whose source the page does not have. */
  get whose() { const { kind, own } = this.page; return kind === "recorded" && own && !own.source ? own.names.join(", ") : ""; }
  /** What was recorded in Python, if the same code has just done something else in the page. */
  otherThan(now) {
    const { page: { kind, run }, code, first, values, begun, whose } = this, sum = ({ taken }) => general(taken.value.reduce((a, b) => a + b, 0), 4);
    const same = kind !== "recorded" || whose || code !== first || values !== begun || (run.agents === now.agents && run.generation === now.generation && sum(run) === sum(now));
    return same ? null : { a: run.agents, g: run.generation, t: sum(run) };
  }
  /** The first lines are shown; who prints a thousand has a loop that does not end in mind, or in the code. */
  print(text, at) {
    if (this.shown++ < PRINTED) this.printed += text;
    if (this.shown > MOST_PRINTED) { this.drop(); this.end({ error: this.page.t("atLine", { n: at, e: this.page.t("printed", { n: MOST_PRINTED }) }), line: at }); }
  }
  /** The ready agent whose code nobody has changed. */
  get asIs() { const one = this.ready[this.chosen]; return one?.code === this.code ? one : null; }
  /** What a class calls a number of it; of the ready ones in every language. */
  called(label) { return this.words[label] ?? label; }
  /** The page shows what came of it. */
  show(run) {
    const { page } = this;
    run.states.forEach((state) => { state[1] = this.called(state[1]); });
    page.kind = "runnable"; page.own = { names: this.names, source: this.code };
    page.adopt(Object.assign(new Recorded(page.scene, page.cells, page.stage), run));
    page.goTo(page.goal ?? Infinity); page.goal = null;
    if (!page.colours.includes(page.look.colour)) page.look.colour = "taken";
  }
  end(result) {
    clearTimeout(this.watch);
    if (this.again) { this.run(); return; }
    Object.assign(this, { result, problem: result.error ? result : null, active: !result.error });
    this.pending?.resolve(result.error ? { error: result.error, line: result.line } : result);
    this.pending = null; this.tell();
  }
  /** Say how it went; but what a finger draws stays under it. */
  tell() {
    if (this.page.pressed) setTimeout(() => this.tell(), 50);
    else { this.page.rebuild(); if (this.problem && this.field?.isConnected) this.mark(this.problem.line); }
  }
  /** Which of the ready agents a code is. */
  named(code) { return Object.keys(this.ready).find((n) => this.ready[n].code === code) ?? ""; }
  /** The code that was begun with. */
  get base() { return this.ready[this.chosen]?.code ?? this.brought; }
  /** Begin with an agent, again too; lines that were not yet run can be got back. */
  put(chosen) {
    const { page: { past }, code, ran, foreign } = this;
    if (code !== ran && !foreign) { this.ran = code; past.note(); past.gesture++; }
    Object.assign(this, { chosen, values: chosen ? {} : this.begun });
    this.code = this.field.value = this.base; this.page.goal = null;
  }
  /** Back to the standard rule, in the picture and in the editor. */
  leave() { if (this.busy) this.drop(); this.put("standard"); Object.assign(this, { active: false, foreign: false, problem: null, ran: this.code }); this.page.past.note(); this.page.look.colour = "taken"; this.page.renew(Infinity); this.page.rebuild(); }
  /** Code that came with a link or a file is shown, and runs when somebody says so. */
  offer(code) { this.code = this.brought = code; this.chosen = this.named(code); this.foreign = true; this.page.tab = "code"; if (this.field) this.field.value = code; this.page.rebuild(); }

  // ------------------------------------------------------------------------------ the editor
  panel() {
    const { page, page: { t } } = this;
    this.field ??= make("textarea", { className: "code", spellcheck: false, autocapitalize: "off", autocomplete: "off", value: this.code,
      oninput: () => { this.code = this.field.value; this.number(); this.say(); }, onkeydown: (event) => this.key(event) });
    this.field.ariaLabel = t("codeField");
    this.gutter ??= make("div", { className: "gutter", ariaHidden: "true" });
    this.number();
    const titles = Object.keys(this.ready), choose = choice(t("readyAgents"), this.chosen, [...(this.chosen ? [] : [["", "–"]]), ...titles.map((n) => [n, page.say(this.ready[n].name)])], (n) => { if (n) { this.put(n); this.start(); page.rebuild(); } });
    this.anew = button(t("startAgain"), () => { this.put(this.chosen); if (!this.foreign) this.start(); page.rebuild(); });
    const asks = this.asIs ? [make("p", { className: "soft", textContent: page.say(this.asIs.question) })] : [];
    const bars = this.active ? this.parameters.map((p) => (typeof p.value === "boolean" ? tick(page.say(this.called(p.label)), p.value, (on) => this.turn(p, on))
      : slider(page.say(this.called(p.label)), { value: p.value, min: p.low, max: p.high, step: p.whole ? 1 : roundDown((p.high - p.low) / 500), show: (v) => general(v, 4), t }, (v) => this.turn(p, v)))) : [];
    this.out = make("p", { role: "status" }); this.say();
    const game = make("p", { className: "soft small", textContent: t("challengeIs", { a: general(this.applied(), 3), w: general(0.95 * this.applied(), 3) }) }), score = make("p", { className: "small", role: "status", textContent: this.challenge().filter(Boolean).join(" · ") });
    return [choose, ...asks, this.out, ...(this.problem ? [make("p", { className: "soft small", textContent: t(page.own ? "oldPicture" : "standardPicture") })] : []), ...bars, make("div", { className: "editor" }, this.gutter, this.field),
      make("div", { className: "tools" }, button(`${t("runCode")} (${/Mac|iP/.test(navigator.platform) ? "⌘ Enter" : t("runKeys")})`, () => this.start(), { className: "main" }), this.anew, button(t("saveAgent"), () => this.save()), button(t("standardRule"), () => this.leave())),
      ...([undefined, page.lesson?.questions.at(-1)].includes(page.lesson?.question) && this.asks ? [game, score] : []), ...(this.printed ? [make("pre", { className: "printed", tabIndex: 0, textContent: this.printed + (this.shown > PRINTED ? `… ${this.shown}` : "") })] : [])];
  }
  /** Say how the run went, or what hinders one; also that the lines are others by now. */
  say() {
    const { page, page: { t }, code, problem, foreign } = this, no = refused(code), lacks = no ? [no.word] : code === this.first ? this.needs : [], score = this.active && page.limit && this.result?.agents !== undefined && this.score();
    const words = problem ? problem.error : code !== this.ran && !foreign ? (score ? `${t("notRun")} ${score}` : t("codeHint")) : lacks.length ? t("notInPage", { n: lacks.join("`, `") }) : foreign ? t("foreign") : this.pending ? t("solving") : score || t(...(this.whose ? ["otherAgents", { n: this.whose }] : ["codeHint"]));
    this.anew.disabled = code === this.base;
    Object.assign(this.out, { className: problem ? "verdict bad" : "verdict open" }).replaceChildren(...words.split("`").map((part, n) => (n % 2 ? make("code", { textContent: part }) : part)));
  }
  score() {
    const { page, page: { t, run } } = this, { agents, generations, taken, air, ground, rollers, absorbed, lost, idle, grew, recorded } = this.result, n = (x) => general(x, 4);
    if (grew) return t("atLine", { n: grew, e: t("grew") });
    const states = (run.states ?? []).filter(([, , whether]) => whether).map(([name, meaning]) => `, ${run[`state ${name}`].value.reduce((a, b) => a + b, 0)} ${page.say(meaning)}`);
    return t("codeScore", { a: agents, g: generations, t: n(taken), s: states.join("") }) + (ground ? t(this.asks ? "footGot" : "toRigid", { x: n(ground), f: n(this.foot()) }) : "") + (air ? t("toAir", { x: n(air) }) : "") + (rollers ? t("toRollers", { x: n(rollers) }) : "") + (absorbed ? t("absorbed", { x: n(absorbed) }) : "") + (lost > 1e-9 ? t("lost", { x: general(100 * lost, 3) }) : "") + (idle.length ? t("idleWall", { n: idle.join("`, `") }) : "") + (this.spare?.length ? t("spare", { n: this.spare.join("`, `") }) : "") + (recorded ? ` ${t("otherRun", recorded)}` : "");
  }
  /** The challenge: with five lines most of the load to the left foot, nearly all of it to the ground. The header has the score, [1] says why it does not count. */
  challenge() {
    if (!this.asks) return ["", ""];
    const { page, page: { t }, result, ran: code } = this, n = (x) => general(x, 3), put = this.applied(), least = 0.95 * put, foot = this.foot(), over = this.active && !this.pending && !page.due && result?.agents;
    const lines = bare(code).split("\n").filter((line) => line.trim() && !/^\s*(from|import|class|def|@)/.test(line)).length;
    const why = !over ? "" : lines > LINES ? t("tooLong", { n: lines }) : !page.isAs(page.start) ? t("otherBody") : result.ground < least || result.ground > 1.002 * put ? t("groundGot", { r: n(result.ground), w: n(least), a: n(put) }) : "";
    if (over && !why) this.best = Math.max(foot, this.best ?? 0);
    return [[over && foot > 0 && t("leftFoot", { f: n(foot) }), this.best && t("classBest", { b: n(this.best) })].filter(Boolean).join(" · "), why];
  }
  /** All that is applied (N). */
  applied() { const { scene, run, stage } = this.page; return appliedLoads(scene, run.lattice, run.kinds, stage).reduce((sum, [, , load]) => sum + load, 0); }
  /** What has reached the ground below the left half (N). */
  foot() {
    const { lattice: L, kinds, passed } = this.page.run, below = (k, arm) => kinds[L.neighbour(k, arm)] === -2 && L.cell(k)[0] < L.shape[0] / 2;
    return passed?.value.reduce((sum, x, n) => sum + (x && below(Math.floor(passed.index[n] / L.D), passed.index[n] % L.D) ? x : 0), 0) ?? 0;
  }
  /** Run with another number: at once, or when the worker is free. */
  turn(parameter, value) { this.values = { ...this.values, [parameter.name]: value }; this.again = this.busy; if (!this.busy) this.run(); }
  /** The lines once more behind the field, unseen: they hold the numbers, and the height of lines that wrap. */
  number() {
    this.gutter.replaceChildren(...this.field.value.split("\n").map((text, n) => make("div", { className: n + 1 === this.problem?.line ? "bad" : "", textContent: text || " " })));
  }
  mark(line) {
    const before = this.field.value.split("\n").slice(0, line), end = before.join("\n").length;
    this.field.setSelectionRange(end - (before.at(-1) ?? "").length, end);
    for (const part of [this.gutter.children[line - 1], this.out]) part?.scrollIntoView({ block: "nearest" });
  }
  key(event) {
    const { field } = this, { value, selectionStart: at, selectionEnd: to } = field, start = value.lastIndexOf("\n", at - 1) + 1;
    const type = (text) => { event.preventDefault(); document.execCommand("insertText", false, text); };
    if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) { event.preventDefault(); this.start(); return; }
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && value === this.ran) { event.preventDefault(); this.page.past.go(event.shiftKey ? 1 : -1); return; }   // nothing typed since it ran
    if (event.key === "Escape") { this.left = true; return; }   // then Tab leaves the editor
    if (event.key === "Tab" && !this.left && !event.shiftKey) type(" ".repeat(4 - (at - start) % 4));
    else if (event.key === "Tab" && !this.left && value.slice(start, start + 4) === "    ") { field.setSelectionRange(start, start + 4); type(""); }
    else if (event.key === "Enter") { const line = value.slice(start, at), indent = line.match(/^ */)[0]; type(`\n${indent}${/:\s*(#.*)?$/.test(line) ? "    " : ""}`); }
    else if (event.key === "Backspace" && at === to && at > start && /^ +$/.test(value.slice(start, at))) { field.setSelectionRange(Math.max(start, at - ((at - start - 1) % 4 + 1)), at); type(""); }
    if (event.key !== "Tab") this.left = false;
  }
  /** The agent, its scene and six lines that run it, as a Python file. */
  save() {
    const { page, code, values } = this, toml = tomlOf(page.scene, page.cells).replaceAll("\\", "\\\\").replaceAll('"""', "'''"), plain = bare(code);
    const bases = Object.fromEntries([...[...plain.matchAll(/import (\w+) as (\w+)/g)].map(([, of, n]) => [n, [of]]), ...[...plain.matchAll(/^class (\w+)\(([^)]*)/gm)].map(([, n, of]) => [n, of.match(/\w+/g) ?? []])]), is = (n, base) => n === base || bases[n]?.some((of) => is(of, base));
    const last = (base) => Object.keys(bases).findLast((n) => is(n, base)), kinds = { free: "FreeBoundaryAgent", rigid: "RigidBoundaryAgent", roller: "RollerBoundaryAgent" };
    const walls = Object.entries(kinds).filter(([, base]) => last(base)).map(([kind, base]) => `"${kind}": ${last(base)}`).join(", "), order = [...plain.matchAll(/^def (\w+)\(waiting\b|^order = (\w+)/gm)].at(-1)?.slice(1).find(Boolean);
    const given = Object.entries(values).filter(([n]) => new RegExp(`^ +${n}\\b.*\\bParameter\\b`, "m").test(plain)).map(([n, v]) => [n, v === true ? "True" : v === false ? "False" : String(v)]);
    const how = [["material_agent", last("MaterialAgent")], ["boundary_agents", walls && `{${walls}}`], ["order", order], ...given, ["seed", String(values.seed ?? 1)]].filter(([, v]) => v).map(([n, v]) => `, ${n}=${v}`).join("");
    return hand("agent.py", new Blob([`${code.trimEnd()}\n\n\nSCENE = """\n${toml}"""\n\nif __name__ == "__main__":\n    from kaju import LoadModel, Scene\n\n    model = LoadModel(Scene.from_toml(SCENE)${how})\n    last = model.run().last\n    print(len(last.cells), last.generations, last.ledger.taken)\n`], { type: "text/x-python" }));
  }
}
