// What stands round the picture: header, bar, timeline and side, and the panels of the side.
import { button, choice, icon, iconButton, labelled, make, picker, rendered, segments, slider, tick, waysOf } from "./controls.js";
import { lessonSide } from "./lesson.js";
import { loadsPanel } from "./loads.js";
import { largestForce, savePng, saveScene, saveTable } from "./scene.js";
import { copyLink } from "./state.js";
import { general, LANGUAGES, quantity } from "./words.js";

// ------------------------------------------------------------------------------------- header

export function buildHeader(page) {
  const { t, parts, lesson } = page;
  const menu = make("details", { className: "menu" }, make("summary", { title: t("save"), ariaLabel: t("save") }, icon("save"), make("span", { className: "wide", textContent: t("save") })), make("div", {}, ...saves(page)));
  const language = picker(t("language"), page.language, Object.entries(LANGUAGES), (key) => page.speak(key));
  for (const option of language.children) option.lang = option.value;
  parts.undo = iconButton("undo", t("undo"), () => page.past.go(-1), { disabled: !page.past?.can(-1) });
  parts.redo = iconButton("redo", t("redo"), () => page.past.go(1), { disabled: !page.past?.can(1) });
  parts.mode = make("span", { className: page.own ? "mode own" : "mode", textContent: page.whose });
  const score = page.studio && (lesson?.step ?? "try") === "try" ? [make("output", { className: "score", textContent: page.studio.challenge()[0] })] : [];
  const right = make("div", { className: "right" }, ...(page.touchable || lesson ? [parts.undo, parts.redo] : []),
    labelled("link", t("copyLink"), () => copyLink(page)), menu, language,
    iconButton("theme", t("theme"), () => page.dress(!page.dark), { className: "icon theme", ariaPressed: String(page.dark) }));
  const more = iconButton("more", t("more"), () => { more.ariaExpanded = String(right.classList.toggle("open")); }, { className: "icon more", ariaExpanded: "false" });
  const back = lesson?.index ? [make("a", { className: "lessons", href: lesson.index, title: t("lessons"), ariaLabel: t("lessons") }, icon("lessons"), make("span", { className: "wide", textContent: t("lessons") }))] : [];
  return make("header", {}, ...back, make("h1", { textContent: page.say(page.title) || "kaju" }), parts.mode, ...score, more, right);
}

function saves(page) {
  const { t } = page, item = (word, save) => button(t(word), async (event) => {
    event.target.closest("details").open = false;
    try { page.announce(t("saved", { name: await save(page) })); } catch (error) { page.announce(t("noAnswer", { why: error.message })); }
  });
  return [...(page.touchable ? [item("saveScene", saveScene)] : []), item("savePng", savePng), ...(page.run.taken ? [item("saveCsv", saveTable)] : [])];
}

/** Above the picture: ways of looking, and what the present one brings. */
export function buildBar(page) {
  const { t, mode } = page, modes = waysOf(page), tools = mode?.tools?.(page) ?? [];
  const choose = modes.length && !mode?.alone ? [segments(t("views"), page.look.mode, [["body", t("body")], ...modes.map(({ name }) => [name, t(name === "twin" && page.ruleAlone ? "ruler" : name)])], (name) => page.setMode(name))] : [];
  return page.parts.bar = make("div", { className: "bar", hidden: !choose.length && !tools.length }, ...choose, ...tools);
}

// ------------------------------------------------------------------------------------- footer

export function buildFooter(page) {
  const { t, parts } = page;
  parts.play = make("button", { type: "button", className: "play main", onclick: () => page.toggle() });
  parts.time = make("input", { type: "range", min: 0, step: 1, ariaLabel: t(page.along ? { s: "time" }[page.along] ?? `along_${page.along}` : "timeline"), oninput: () => page.stop(Number(parts.time.value)) });
  parts.marks = make("div", { className: "marks", ariaHidden: "true" });
  parts.count = make("span", { className: "count" });
  const stages = page.stages > 1 ? [picker(t("stage"), page.stage, Array.from({ length: page.stages }, (_, i) => [i + 1, t("stageOf", { n: i + 1, m: page.stages })]), (n) => page.change(() => { page.stage = Number(n); }))] : [];
  parts.speed = Object.assign(picker(t("speed"), page.look.speed, [1, 2, 4, 8, 15, 30, 60].map((n) => [n, t("perSecond", { n })]), (n) => { page.look.speed = Number(n); page.timed = true; }), { className: "end" });
  return make("footer", {}, iconButton("first", t("first"), () => page.stop(0), { className: "icon end" }), iconButton("back", t("back"), () => page.stop(page.g - 1)),
    parts.play, iconButton("step", t("step"), () => page.stop(page.g + 1)), iconButton("last", t("last"), () => page.stop(Infinity), { className: "icon end" }),
    make("span", { className: "line" }, parts.time, parts.marks), parts.count, ...stages, parts.speed);
}

/** The numbers under the timeline: every generation while they are few, then round ones. */
export function tellMarks(page) {
  const { parts: { marks }, run, limit } = page, n = Math.min(run.generation, limit), key = `${n} ${page.view?.w}`;
  if (page.marked === key && marks.childElementCount) return;
  const room = Math.floor(marks.clientWidth / 28);
  page.marked = key;
  const every = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find((e) => n / e < room) ?? 2000, named = page.at && (page.along === "s" || page.at.at(-1) !== run.generation) ? page.moments(room) : Array.from({ length: Math.floor(n / every) + 1 }, (_, i) => [i * every, i * every]);
  marks.replaceChildren(...named.filter(([g]) => room > 1 && g <= n).map(([g, text]) => make("span", { textContent: text, style: `left: ${100 * g / (n || 1)}%` })));
}

// --------------------------------------------------------------------------------------- side

export function buildAside(page) {
  const { t, parts } = page;
  parts.verdict = make("div", { className: "verdict", role: "status" });
  parts.story = make("div", { className: "story", role: "status", ariaLabel: t("agent") });
  parts.charts?.remove();
  parts.charts = make("div", { className: "charts", role: "img", ariaLabel: t("charts"), onpointerdown: (e) => page.seekChart(e) });
  const { tabs, body, foot = [] } = page.lesson ? lessonSide(page) : freeSide(page);
  const grip = button("", () => { page.host.dataset.sheet = page.sheet = (page.sheet + 1) % 3; page.later(); }, { className: "grip", ariaLabel: t("sheet"), title: t("sheet") });
  return make("aside", {}, tabs, make("div", { className: "body", tabIndex: 0 }, grip, make("div", { className: "flow" }, ...body)), make("div", { className: "foot", hidden: !foot.length }, ...foot));
}

export const storyCard = (page) => make("section", {}, ...((page.fields && !page.born) || (page.lesson && page.studio) ? [] : [make("h2", { textContent: page.t("agent") })]), page.parts.story);   // rods and faces are no agents
/** What the way of looking brings to the side. */
export const modeCards = (page) => page.mode?.cards?.(page) ?? [];
export const cardsBox = (page) => page.parts.cards = make("div", { className: "cards" }, ...modeCards(page));

/** Which panels a page has, by the word of each. */
export function panelsOf(page) {
  const panels = {};
  if (page.studio) panels.code = () => page.studio.panel();
  if (page.touchable) panels.rule = () => rulePanel(page);
  panels.look = () => lookPanel(page);
  if (page.touchable && page.run.lattice.dimension === 2) panels.draw = () => drawPanel(page);
  if (page.text || page.studio) panels.about = () => [...(page.text ? [rendered(page.say(page.text))] : []), ...(page.studio ? [make("details", { className: "soft small" }, make("summary", { textContent: page.studio.licence.split(":")[0] }), page.studio.licence)] : [])];
  const declared = page.touchable ? [] : page.own?.parameters ?? [];   // as they were in the run
  if (page.own?.source && !page.studio) panels.source = () => [...declared.map(({ label, value }) => make("div", { className: "row" }, make("span", { textContent: label }), make("data", { value: String(value), textContent: String(value) }))), make("pre", { tabIndex: 0, textContent: page.own.source })];
  return panels;
}

function freeSide(page) {
  const { t, parts } = page, panels = panelsOf(page), names = Object.keys(panels);
  if (!names.includes(page.tab)) page.tab = names[0];
  const bodies = names.map((name) => make("div", { role: "tabpanel", id: `panel-${name}`, ariaLabel: t(name), hidden: name !== page.tab }, ...panels[name]()));
  const tabs = tabList(page, names, page.tab, (name) => make("span", { textContent: t(name) }), (name) => {
    page.tab = name;
    bodies.forEach((body, i) => { body.hidden = names[i] !== name; });
  });
  return { tabs, body: [parts.verdict, cardsBox(page), ...bodies, ...(page.mode?.alone ? [] : [storyCard(page)]), parts.charts] };
}

/** Tabs: arrows walk, a click or Enter chooses. */
export function tabList(page, names, chosen, face, choose) {
  const list = make("div", { role: "tablist", ariaLabel: page.t("tabs") });
  const show = (name, focus) => names.forEach((n, i) => {
    const tab = list.children[i], on = n === name;
    tab.ariaSelected = String(on); tab.tabIndex = on ? 0 : -1;
    if (on && focus) tab.focus();
  });
  const go = (name, focus) => { chosen = name; show(name, focus); choose(name); };
  list.append(...names.map((name) => make("button", { type: "button", role: "tab", "aria-controls": `panel-${name}`, onclick: () => go(name) }, face(name))));
  list.onkeydown = (event) => {
    const turn = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!turn) return;
    event.stopPropagation(); event.preventDefault();
    go(names[(names.indexOf(chosen) + turn + names.length) % names.length], true);
  };
  show(chosen);
  return list;
}

export function buildTries(page) {
  const tries = page.parts.presets = page.presets.map((preset) => button(page.nameOf(preset), () => page.load(preset), { title: page.say(preset.note) ?? "" }));
  return make("nav", { className: "tries", ariaLabel: page.t("tries") }, make("span", { className: "hint", textContent: page.t("tries") }), ...tries);
}

const two = (v) => general(Number(v.toFixed(3)), 4);

/** What keys do; those of one letter can be turned off. */
export function showKeys(page) {
  const { t, look } = page, rows = t("keys").split("\n").map((line) => line.split("|"));
  const table = make("table", { className: "keys" }, ...rows.map(([key, does]) => make("tr", {}, make("th", { scope: "row", textContent: key }), make("td", { textContent: does }))));
  const dialog = make("dialog", { ariaLabel: t("keyTable"), onclose: () => dialog.remove() }, tick(t("letters"), look.letters, (on) => page.set("letters", on)), table, button(t("close"), () => dialog.close(), { className: "main" }));
  page.host.append(dialog);
  dialog.showModal();
}

/** The sliders of the rule; `few`: its five numbers only. */
export function rulePanel(page, few = false) {
  const { t, scene } = page, names = Object.keys(scene.rule.materials ?? {}), list = [];
  const bar = (key, options, edit) => list.push(slider(t(key), { ...options, t }, (v) => page.change(() => edit(v))));
  if (names.length) {
    const others = scene.materials.map((m) => m.name).filter((name) => !names.includes(name)).join(", ");
    page.material ||= others ? "" : names[0];
    list.push(choice(t("material"), page.material, [...(others ? [["", others]] : []), ...names.map((n) => [n, n])],
      (name) => { page.material = name; page.rebuild(); }));
  }
  const rule = page.material && names.includes(page.material) ? scene.rule.materials[page.material] : scene.rule;
  const usual = [0.5, 0.5, scene.lattice.shape.length === 2 ? 0.25 : 0.125];
  ["alpha1", "alpha2", "alpha3"].forEach((key, i) => bar(key, { value: (rule.alpha ?? usual)[i], min: 0, max: i < 2 ? 1 : 0.5, show: two }, (v) => {
    rule.alpha = [...(rule.alpha ?? usual)];
    rule.alpha[i] = v;
  }));
  bar("beta", { value: rule.beta, min: 0, max: 1, show: two }, (v) => { rule.beta = v; });
  const strongest = largestForce(page.start.scene) || 1;
  const gamma = () => bar("gamma", { value: scene.rule.threshold, min: 10 ** (Math.floor(Math.log10(strongest)) - 5), max: 10 ** Math.ceil(Math.log10(strongest)), unit: "N", log: true }, (v) => { scene.rule.threshold = v; });
  if (few) { gamma(); return list; }
  const material = scene.materials.find((m) => m.name === page.material) ?? scene.materials.find((m) => !names.includes(m.name)) ?? scene.materials[0];
  if (material) {
    bar("nu", { value: material.poissons_ratio, min: 0, max: 0.5, show: two }, (v) => { material.poissons_ratio = v; });
    bar("modulus", { value: material.youngs_modulus, min: 1e3, max: 1e12, unit: "Pa", log: true }, (v) => { material.youngs_modulus = v; });
  }
  gamma();
  bar("loadFactor", { value: page.factor, min: -2, max: 5, step: 0.05, show: two }, (v) => page.scaleLoads(v));
  list.push(tick(t("accumulate"), scene.rule.accumulate, (on) => page.change(() => { scene.rule.accumulate = on; })));
  if (page.senseful) list.push(tick(t("sense"), scene.rule.sense, (on) => page.change(() => { scene.rule.sense = on; })));
  return [...list, make("p", { className: "hint", textContent: t("ruleHint") })];
}

function lookPanel(page) {
  const { t, look } = page, solid = page.run.kinds && page.solid;
  const set = (key) => (value) => page.set(key, value), list = [], usual = page.deformable && page.magnification() / 10 ** look.magnify;
  if (page.colours.length > 1) list.push(choice(t("colour"), look.colour, page.colours.map((key) => [key, page.word(key)]), set("colour")));
  if (page.deformable) list.push(tick(t("deformed"), look.deformed, set("deformed")),
    slider(t("magnify"), { value: page.magnification(), min: 0.1 * usual, max: 10 * usual, step: 0.05, log: true, show: (v) => quantity(v, "").replace(" × ", "·"), t }, (v) => page.set("magnify", Math.log10(v / usual))));
  if (page.run.taken) list.push(tick(t("arrows"), look.arrows, set("arrows")));
  if (page.run.passed) list.push(tick(t("path"), look.path, set("path")));
  if (solid) {
    const axes = ["none", "x", "y", "z"], shape = page.run.lattice.shape, put = (part) => page.set("cut", { ...look.cut, ...part });
    list.push(choice(t("cut"), axes[look.cut.axis + 1], axes.map((a) => [a, a === "none" ? t("none") : a]), (v) => put({ axis: axes.indexOf(v) - 1 })),
      slider(t("cutAt"), { value: look.cut.at, min: 0, max: Math.max(...shape) - 1, step: 1, show: String, t }, (v) => put({ at: v })),
      tick(t("only"), look.cut.only, (on) => put({ only: on })));
  }
  if (page.solid) list.push(make("p", { className: "hint", textContent: t("turn") }));
  return [...list, make("div", { className: "tools" }, button(t("keyTable"), () => showKeys(page)))];
}

function drawPanel(page) {
  const { t, scene } = page, group = `pen-${Math.random().toString(36).slice(2)}`;
  const pens = [["look", t("inspect")], ...scene.materials.map((m, i) => [String(i), t("penMaterial", { name: m.name })]), ["-1", t("air")], ["-2", t("rigid")], ["-3", t("rollerPen")]];
  const radios = pens.map(([value, text]) => make("label", { className: "tick" },
    make("input", { type: "radio", name: group, value, checked: page.pen === value, onchange: () => { page.pen = value; } }), text));
  const held = page.run.lattice.sides.map((side) => choice(t(side), scene.sides[side],
    [["free", t("free")], ["rigid", t("rigidSide")], ["roller", t("roller")]], (v) => page.change(() => { scene.sides[side] = v; })));
  return [make("fieldset", { className: "pens" }, make("legend", { textContent: t("pen") }), ...radios), ...loadsPanel(page),
    make("h2", { textContent: t("hold") }), ...held, make("div", { className: "tools" }, button(t("reset"), () => page.load(page.start), { title: t("resetHint") }))];
}
