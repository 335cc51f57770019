// The controls: what can be pressed, dragged and typed, and what it does.
import { saveFilm, savePng, saveScene, saveSvg, saveTable } from "./save.js";
import { largestForce } from "./scene.js";
import { LANGUAGES, quantity } from "./words.js";

/** An element: properties, attributes (where it has no such property), children. */
export function make(tag, props = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(props)) {
    if (key in element && key !== "list") element[key] = value;
    else element.setAttribute(key, value);
  }
  element.append(...children);
  return element;
}

const ICONS = { first: "M2 2h2v12H2zM14 2v12L5 8z", back: "M12 2v12L3 8z", step: "M4 2v12l9-6z", last: "M12 2h2v12h-2zM2 2v12l9-6z",
  play: "M4 2v12l10-6z", pause: "M3 2h4v12H3zM9 2h4v12H9z" };
export function icon(name) {
  const NS = "http://www.w3.org/2000/svg", svg = document.createElementNS(NS, "svg"), path = document.createElementNS(NS, "path");
  svg.setAttribute("viewBox", "0 0 16 16"); svg.setAttribute("aria-hidden", "true"); path.setAttribute("d", ICONS[name]);
  svg.append(path);
  return svg;
}
const button = (text, onclick, props = {}) => make("button", { type: "button", textContent: text, onclick, ...props });
const iconButton = (name, label, onclick) => make("button", { type: "button", className: "icon", onclick, title: label, ariaLabel: label }, icon(name));

function choice(label, value, options, change) {
  const select = make("select", { onchange: () => change(select.value) }, ...options.map(([key, text]) => make("option", { value: key, textContent: text })));
  select.value = value;
  return make("label", { className: "row" }, label, select);
}
function tick(label, checked, change) {
  const box = make("input", { type: "checkbox", checked, onchange: () => change(box.checked) });
  return make("label", { className: "tick" }, box, label);
}
function slider(label, { value, min, max, step = "any", show }, change) {
  const output = make("output", { textContent: show(value) });
  const input = make("input", { type: "range", min, max, step, value, ariaValueText: show(value) });
  input.oninput = () => {
    const v = Number(input.value);
    change(v);
    output.textContent = show(v); input.ariaValueText = show(v);
  };
  return make("label", { className: "row" }, label, input, output);
}

// ------------------------------------------------------------------------------------- header

export function buildHeader(page) {
  const { t } = page, mode = page.changed ? "changed" : page.kind;
  const menu = make("details", { className: "menu" }, make("summary", { textContent: t("save") }), make("div", {}, ...saves(page)));
  const language = make("select", { ariaLabel: t("language"), onchange: () => page.speak(language.value) },
    ...Object.entries(LANGUAGES).map(([key, text]) => make("option", { value: key, textContent: text, lang: key })));
  language.value = page.language;
  return make("header", {}, make("h1", { textContent: page.title || "kaju" }), make("span", { className: "mode", textContent: t(mode) }),
    make("div", { className: "right" }, menu, language,
      button("◐", () => page.dress(!page.dark), { className: "icon", ariaLabel: t("theme"), title: t("theme"), ariaPressed: String(page.dark) })));
}

function saves(page) {
  const { t } = page, item = (word, save) => button(t(word), async (event) => {
    event.target.closest("details").open = false;
    if (save === saveFilm) page.announce(t("filming"));
    try { page.announce(t("saved", { name: await save(page) })); } catch (error) { page.announce(t("noAnswer", { why: error.message })); }
  });
  const items = [item("savePng", savePng), item("saveSvg", saveSvg), item("saveFilm", saveFilm)];
  if (page.touchable) items.unshift(item("saveScene", saveScene));
  if (page.run.taken) items.push(item("saveCsv", saveTable));
  return items;
}

// ------------------------------------------------------------------------------------- footer

export function buildFooter(page) {
  const { t, parts } = page;
  parts.play = button("", () => page.toggle(), { className: "play" });
  parts.time = make("input", { type: "range", min: 0, step: 1, ariaLabel: t("timeline"), oninput: () => page.seek(Number(parts.time.value)) });
  parts.count = make("span", { className: "count" });
  const footer = make("footer", {}, iconButton("first", t("first"), () => page.seek(0)), iconButton("back", t("back"), () => page.seek(page.g - 1)),
    parts.play, iconButton("step", t("step"), () => page.seek(page.g + 1)), iconButton("last", t("last"), () => page.seek(Infinity)),
    make("span", { className: "line" }, parts.time), parts.count);
  if (page.stages > 1) {
    const select = make("select", { ariaLabel: t("stage"), onchange: () => page.setStage(Number(select.value)) },
      ...Array.from({ length: page.stages }, (_, i) => make("option", { value: i + 1, textContent: t("stageOf", { n: i + 1, m: page.stages }) })));
    select.value = page.stage;
    footer.append(select);
  }
  const speed = make("select", { ariaLabel: t("speed"), onchange: () => { page.look.speed = Number(speed.value); } },
    ...[1, 2, 4, 8, 15, 30, 60].map((n) => make("option", { value: n, textContent: t("perSecond", { n }) })));
  speed.value = page.look.speed;
  footer.append(speed);
  return footer;
}

// --------------------------------------------------------------------------------------- aside

export function buildAside(page) {
  const { t, parts } = page, panels = {};
  parts.verdict = make("div", { className: "verdict", role: "status" });
  parts.story = make("div", { className: "story", role: "status", ariaLabel: t("agent") });
  parts.charts = make("canvas", { role: "img", ariaLabel: t("charts"), onpointerdown: (e) => page.seekChart(e.offsetX) });
  if (page.touchable) { panels.rule = rulePanel(page); }
  panels.look = lookPanel(page);
  if (page.touchable && page.run.lattice.dimension === 2) panels.draw = drawPanel(page);
  if (page.text) panels.about = [aboutText(page.text)];
  const names = Object.keys(panels);
  if (!names.includes(page.tab)) page.tab = names[0];
  return make("aside", { tabIndex: -1 }, parts.verdict, ...tabs(page, panels),
    make("section", {}, make("h2", { textContent: t("agent") }), parts.story),
    make("div", { className: "charts" }, parts.charts));
}

function tabs(page, panels) {
  const { t } = page, names = Object.keys(panels), list = make("div", { role: "tablist", ariaLabel: t("tabs") });
  const bodies = names.map((name) => make("div", { role: "tabpanel", id: `panel-${name}`, ariaLabel: t(name) }, ...panels[name]));
  const show = (chosen, focus) => names.forEach((name, i) => {
    const tab = list.children[i], on = name === chosen;
    if (on) page.tab = name;
    tab.ariaSelected = String(on); tab.tabIndex = on ? 0 : -1; bodies[i].hidden = !on;
    if (on && focus) tab.focus();
  });
  list.append(...names.map((name) => make("button", { type: "button", role: "tab", textContent: t(name), "aria-controls": `panel-${name}`, onclick: () => show(name) })));
  list.onkeydown = (event) => {
    const turn = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!turn) return;
    event.stopPropagation(); event.preventDefault();
    show(names[(names.indexOf(page.tab) + turn + names.length) % names.length], true);
  };
  show(page.tab);
  return [list, ...bodies];
}

export function buildTries(page) {
  const tries = page.presets.map((preset) => button(preset.word ? page.t(preset.word) : preset.name, () => page.load(preset), { title: preset.note ?? "" }));
  return make("nav", { className: "tries", ariaLabel: page.t("tries") }, make("span", { className: "hint", textContent: page.t("tries") }), ...tries);
}

function aboutText(text) {                     // plain text; "# " starts a heading, "- " a list
  const blocks = text.trim().split(/\n{2,}/).map((block) => {
    const lines = block.split("\n");
    if (lines[0].startsWith("#")) return [make("h3", { textContent: lines[0].replace(/^#+\s*/, "") }), ...lines.slice(1).map((line) => make("p", { textContent: line }))];
    if (lines.every((line) => line.startsWith("- "))) return [make("ul", {}, ...lines.map((line) => make("li", { textContent: line.slice(2) })))];
    return [make("p", { textContent: block })];
  });
  return make("div", { className: "text" }, ...blocks.flat());
}

const two = (v) => v.toFixed(2);

function rulePanel(page) {
  const { t } = page, { scene } = page, names = Object.keys(scene.rule.materials ?? {});
  const list = [];
  if (names.length) {
    page.material ||= "";
    list.push(choice(t("material"), page.material, [["", scene.materials.filter((m) => !names.includes(m.name)).map((m) => m.name).join(", ") || "*"], ...names.map((n) => [n, n])],
      (name) => { page.material = name; page.rebuild(); }));
  }
  const rule = page.material && names.includes(page.material) ? scene.rule.materials[page.material] : scene.rule;
  const dimension = scene.lattice.shape.length, share = (i, max) => ({ value: (rule.alpha ?? [0.5, 0.5, dimension === 2 ? 0.25 : 0.125])[i], min: 0, max, step: 0.01, show: two });
  const alpha = (i) => (v) => page.change(() => {
    rule.alpha = [...(rule.alpha ?? [0.5, 0.5, dimension === 2 ? 0.25 : 0.125])];
    rule.alpha[i] = v;
  });
  list.push(slider(t("alpha1"), share(0, 1), alpha(0)), slider(t("alpha2"), share(1, 1), alpha(1)), slider(t("alpha3"), share(2, 0.5), alpha(2)),
    slider(t("beta"), { value: rule.beta, min: 0, max: 1, step: 0.01, show: two }, (v) => page.change(() => { rule.beta = v; })));
  const material = scene.materials.find((m) => m.name === page.material) ?? scene.materials.find((m) => !names.includes(m.name)) ?? scene.materials[0];
  if (material) list.push(
    slider(t("nu"), { value: material.poissons_ratio, min: 0, max: 0.5, step: 0.01, show: two }, (v) => page.change(() => { material.poissons_ratio = v; })),
    slider(t("modulus"), { value: Math.log10(material.youngs_modulus), min: 3, max: 12, step: 0.01, show: (v) => quantity(10 ** v, "Pa") }, (v) => page.change(() => { material.youngs_modulus = 10 ** v; })));
  const strongest = largestForce(page.start.scene) || 1;
  list.push(slider(t("gamma"), { value: Math.log10(scene.rule.threshold), min: Math.floor(Math.log10(strongest)) - 5, max: Math.ceil(Math.log10(strongest)), step: 0.01, show: (v) => quantity(10 ** v, "N") }, (v) => page.change(() => { scene.rule.threshold = 10 ** v; })),
    slider(t("loadFactor"), { value: page.factor, min: -2, max: 5, step: 0.05, show: two }, (v) => page.change(() => { page.scaleLoads(v); })),
    tick(t("accumulate"), scene.rule.accumulate, (on) => page.change(() => { scene.rule.accumulate = on; })));
  if (page.senseful) list.push(tick(t("sense"), scene.rule.sense, (on) => page.change(() => { scene.rule.sense = on; })));
  return list;
}

function lookPanel(page) {
  const { t, look } = page, solid = page.run.lattice?.dimension === 3;
  const set = (key) => (value) => { look[key] = value; page.later(); };
  const list = [];
  if (page.colours.length > 1) list.push(choice(t("colour"), look.colour, page.colours.map((key) => [key, page.word(key)]), (v) => { look.colour = v; page.later(); }));
  if (page.deformable) list.push(tick(t("deformed"), look.deformed, (on) => { look.deformed = on; page.later(); }),
    slider(t("magnify"), { value: look.magnify, min: -1, max: 1, step: 0.05, show: (v) => `× ${two(10 ** v)}` }, set("magnify")));
  if (page.run.taken) list.push(tick(t("arrows"), look.arrows, set("arrows")));
  if (page.run.passed || (page.run.taken && page.kind === "live")) list.push(tick(t("path"), look.path, set("path")));
  if (page.solvable) list.push(tick(t("beside"), look.beside, (on) => page.showElastic(on)));
  if (solid) {
    const axes = ["none", "x", "y", "z"], shape = page.run.lattice.shape;
    list.push(choice(t("cut"), axes[look.cut.axis + 1], axes.map((a) => [a, a === "none" ? t("none") : a]), (v) => { look.cut.axis = axes.indexOf(v) - 1; page.later(); }),
      slider(t("cutAt"), { value: look.cut.at, min: 0, max: Math.max(...shape) - 1, step: 1, show: String }, (v) => { look.cut.at = v; page.later(); }),
      tick(t("only"), look.cut.only, (on) => { look.cut.only = on; page.later(); }));
  }
  if (page.solid) list.push(make("p", { className: "hint", textContent: t("turn") }));
  list.push(make("p", { className: "hint", textContent: t("keys") }));
  return list;
}

function drawPanel(page) {
  const { t, scene } = page, group = `pen-${Math.random().toString(36).slice(2)}`;
  const pens = [["look", t("inspect")], ...scene.materials.map((m, i) => [String(i), t("penMaterial", { name: m.name })]), ["-1", t("air")], ["-2", t("rigid")]];
  const radios = pens.map(([value, text]) => make("label", { className: "tick" },
    make("input", { type: "radio", name: group, value, checked: page.pen === value, onchange: () => { page.pen = value; } }), text));
  const words = { left: "left", right: "right", bottom: "bottom", top: "top" };
  const held = page.run.lattice.sides.map((side) => choice(t(words[side]), scene.sides[side],
    [["free", t("free")], ["rigid", t("rigidSide")], ["roller", t("roller")]], (v) => page.change(() => { scene.sides[side] = v; })));
  return [make("fieldset", { className: "pens" }, make("legend", { textContent: t("pen") }), ...radios),
    make("h2", { textContent: t("hold") }), ...held, make("div", { className: "tools" }, button(t("reset"), () => page.load(page.start), { title: t("resetHint") }))];
}
