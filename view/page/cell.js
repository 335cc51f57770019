// The rule in one cell: what came in, what it keeps, what leaves arrow by arrow, what came back.
import { button, iconButton, make, MODES } from "./controls.js";
import { AIR, RIGID } from "./lattice.js";
import { colourOf, css, FONT, paintWord } from "./paint.js";
import { storyCard } from "./panels.js";
import { sharesOf, Transfer, Twin } from "./rule.js";
import { general, quantity } from "./words.js";

/** Every load that reached a cell up to a generation: {generation, channel, each, copies, from, arm, ends}; null if too many travel. */
export function arrivals({ scene, cells, stage }, k, until) {
  const run = new Twin(scene, cells, stage), { lattice: L, transfer: T, kinds, C } = run, { D } = L, { accumulate, threshold } = scene.rule;
  const list = [], near = new Set([k, ...Array.from({ length: D }, (_, arm) => L.neighbour(k, arm))]), least = accumulate ? 0 : threshold;
  const note = (row) => {
    const same = list.find((r) => r.generation === row.generation && r.channel === row.channel && r.from === row.from && (accumulate ? true : r.each === row.each));
    if (!same) list.push(row); else if (accumulate) same.each += row.each * row.copies; else same.copies += row.copies;
  };
  let seen = 0;
  for (let i = 0; i < run.waiting.n; i++) {
    const { state, magnitude, copies } = run.waiting;
    if (Math.floor(state[i] / C) === k) note({ generation: 1, channel: state[i] - k * C, each: magnitude[i], copies: copies[i], from: -1, arm: -1, ends: false });
  }
  for (let g = 1; g < until && !run.atRest; g++) {
    const { n, state, magnitude, copies } = run.waiting;
    if ((seen += n) > 3e6) return null;        // so many loads are looked through for those of one cell
    for (let i = 0; i < n; i++) {
      const from = Math.floor(state[i] / C);
      if (!near.has(from) || kinds[from] < 0) continue;
      for (const [arm, way, share] of T.rows[kinds[from] * C + state[i] - from * C]) {
        const out = share * magnitude[i], to = L.neighbour(from, arm), back = from === k && kinds[to] < 0;
        if (to !== k && !back) continue;
        const channel = back ? T.turned[kinds[to]][arm][way] : way;
        note({ generation: g + 1, channel, each: accumulate ? out * copies[i] : out, copies: accumulate ? 1 : copies[i], from: back ? to : from, arm: back ? arm : L.opposite[arm], ends: !(out > least) });
      }
    }
    run.step();
  }
  if (accumulate) {                            // what meets is judged together: at a boundary, then in the cell
    const came = list.filter((r) => !(r.ends = r.from >= 0 && kinds[r.from] < 0 && r.each <= threshold));
    for (const row of came) row.ends = came.reduce((sum, r) => (r.generation === row.generation && r.channel === row.channel ? sum + r.each : sum), 0) <= threshold;
  }
  return list.sort((a, b) => a.generation - b.generation || b.each - a.each);
}

/** What leaves of one load: {arm, channel, load, ends, kind}, and what is kept. */
export function leaving(scene, run, k, channel, load) {
  const { lattice: L, kinds } = run, T = run.transfer ?? new Transfer(scene, L), { threshold, accumulate } = scene.rule;
  const pull = channel >= L.D, ahead = pull ? L.opposite[channel - L.D] : channel;
  const list = T.rows[kinds[k] * T.C + channel].map(([arm, way, share]) => ({ arm, channel: way, load: share * load, ends: !accumulate && !(share * load > threshold), kind: way !== channel ? "outwards" : arm === ahead ? "ahead" : "along" }));
  return { list, own: T.shares[kinds[k]].own * load, total: list.reduce((sum, e) => sum + e.load, 0) };
}

/** All that the card and the picture of the picked cell need, found once for a picture. */
function studied(page) {
  const { run, g, picked: k } = page, known = page.study;
  if (known && known.run === run && known.k === k && known.g === g && known.far === run.generation) return known;
  const rows = run.transfer ? arrivals({ scene: run.scene, cells: page.cells, stage: run.stage }, k, g) : null;
  const taken = rows?.filter((r) => !r.ends) ?? [];
  let at = known?.k === k ? known.at : 0;
  if (known?.k === k && known.row) {           // the same load again, or the nearest that there is
    const far = (r) => (r.channel === known.row.channel ? 0 : 1e3) + (r.from === known.row.from ? 0 : 10) + Math.abs(r.generation - known.row.generation) + Math.abs(Math.log(r.each / known.row.each));
    taken.forEach((r, i) => { if (far(r) < far(taken[at] ?? r) || !taken[at]) at = i; });
  }
  at = Math.max(0, Math.min(at, taken.length - 1));
  page.study = { run, k, g, far: run.generation, rows, taken, at, row: taken[at] };
  return page.study;
}

const cellName = (L, k) => `(${L.cell(k).join(", ")})`;
function senderOf({ run: { lattice: L, kinds, woken, spawn }, t }, { from }, k) {
  if (from < 0) return t("outside");
  if (kinds[from] < 0) return t(kinds[from] === AIR ? "theAir" : kinds[from] === RIGID ? "theGround" : "theRoller");
  const arms = Array.from({ length: L.D }, (_, arm) => arm), woke = spawn[k] && arms.some((arm) => woken[k] >> arm & 1 && L.neighbour(k, arm) === from);
  return cellName(L, from) + (woke ? `: ${t("wokeIt")}` : "");
}
/** Which way a channel presses, as an arrow. */
function sign(L, channel) { const [x, y] = L.normals[channel % L.D]; return "→↗↑↖←↙↓↘"[(Math.round(Math.atan2(y, x) / (Math.PI / 4)) + 8) % 8]; }

/** How much of a load P leaves, by the names of its shares; a lesson says the one that has a long name in numbers, as its questions do. */
const formulaOf = (page, { kind, load }, P) => (kind === "outwards" && page.lesson ? `${general(load / P, 3)} P` : { ahead: "α₂P", along: "α₃P", outwards: "(1−β)να₁P" }[kind]);
/** An arrow stands where its load goes: so far over that side, back along itself, back along what came; and its length. In cells. */
const STANDS = { ahead: [0.46, 0, 0, 0.55], along: [0.78, 0.06, 0, 0.36], outwards: [0.54, 0, 0.34, 0.4] };
const newtons = (load, largest) => quantity(Number((load * (1 + 1e-9)).toPrecision(3)), "N", largest);   // halves go up

MODES.push({
  name: "cell", alone: true,
  offered: (page) => page.picked >= 0 && page.run.lattice?.dimension === 2 && Boolean(page.run.taken) && page.look.mode !== "guess" && (page.touchable || page.kind === "recorded") && page.limit > 0,
  tools(page) {
    const { t } = page, { taken, at } = page.picked >= 0 ? studied(page) : { taken: [] };
    const turn = (by) => { page.study = { ...page.study, at: (at + by + taken.length) % taken.length, row: taken[(at + by + taken.length) % taken.length] }; page.refresh(); };
    const choose = taken.length > 1 ? [make("span", { className: "soft", textContent: t("loadOf", { n: at + 1, m: taken.length }) }), iconButton("back", t("formerLoad"), () => turn(-1)), iconButton("step", t("nextLoad"), () => turn(1))] : [];
    const back = button(`‹ ${t("wholeBody")}`, () => page.setMode(page.lesson?.home ?? "body"));
    return [back, make("b", { textContent: t("cell") }), make("span", { className: "push" }), ...choose];
  },
  cards: (page) => [...cellCards(page), storyCard(page)],
  draw(page) {
    const { canvas: { clientWidth: w, clientHeight: h } } = page, wide = w > 520;   // a phone has room for the cell alone
    if (page.picked >= 0 && page.tooled !== studied(page)) { page.tooled = studied(page); page.refresh(); }
    const size = Math.min(0.32 * w, h), x = wide ? size + 12 : 4;
    page.drawBody({ x: wide ? 0 : -2 * w, y: Math.max(0, (h - size) / 2 - 30), w: size, h: size });
    if (page.picked >= 0) paintCell(page, { x, y: wide ? 6 : 28, w: w - x - 8, h: h - (wide ? 64 : 34) });
  },
  key(page, { key }) { return key === "Enter" && page.picked >= 0; },
  press(page, { offsetX, offsetY }) {
    const { view, close: { cx, cy, s } = {}, picked, run: { lattice: L } } = page, beside = picked >= 0 && L.dimension === 2 && !L.hexagon ? L.cell(picked).map((c, a) => c + Math.round((a ? cy - offsetY : offsetX - cx) / (1.02 * s))) : null;
    const cell = view.cellAt(offsetX, offsetY) ?? (beside && L.contains(beside) ? beside : null);   // a neighbour in the close-up is the next to be looked at
    if (cell && page.run.kinds[page.run.lattice.key(cell)] >= 0) { page.picked = page.run.lattice.key(cell); page.later(); }
    return true;
  },
});

// --------------------------------------------------------------------------------- the cards

function cellCards(page) {
  const { t, run, picked: k, g } = page, L = run.lattice;
  if (k < 0 || run.kinds[k] < 0) return [];
  const study = studied(page), { rows, taken, row, at } = study, story = storyOf(page, k);
  const card = (title, ...content) => make("div", { className: "card" }, make("h3", { textContent: title }), ...content);
  if (!rows) return [card(t("cellOf", { c: cellName(L, k) }), make("p", { textContent: t(run.transfer ? "tooMany" : "ownArrows") }))];
  if (!taken.length) {
    const largest = rows.reduce((best, r) => (r.each > (best?.each ?? 0) ? r : best), null);
    return largest ? [card(t("cellOf", { c: cellName(L, k) }), make("p", { textContent: t("largestWas", { x: newtons(largest.each), w: senderOf(page, largest, k) }) }))] : [];
  }
  const cells = (...list) => list.map((text) => make("td", {}, text)), pickRow = (i) => { page.study = { ...study, at: i, row: taken[i] }; page.refresh(); };
  const table = make("table", {}, make("tr", {}, ...["", t("each"), t("howMany"), t("from")].map((text) => make("th", {}, text))),
    ...taken.map((r, i) => make("tr", { className: i === at ? "on" : "", onclick: () => pickRow(i) }, ...cells(`${sign(L, r.channel)}${run.C > L.D ? ` ${t(r.channel < L.D ? "pushes" : "pulls")}` : ""}`, newtons(r.each), String(r.copies), senderOf(page, r, k)))));
  const { list, own, total } = leaving(run.scene, run, k, row.channel, row.each), kinds = ["ahead", "along", "outwards"];
  const parts = kinds.flatMap((kind) => {
    const some = list.filter((e) => e.kind === kind), [first] = some;
    if (!first) return [];
    const to = kind === "ahead" ? `${t("ahead")}, ${cellName(L, L.neighbour(k, first.arm))}` : t(kind === "along" ? "sideways" : kind);
    return [make("tr", { className: first.ends ? "faint" : "" }, ...cells(to, formulaOf(page, first, row.each), `${some.length > 1 ? `${some.length} × ` : ""}${newtons(first.load, row.each)}${first.ends ? `, ${t("ends_")}` : ""}`))];
  });
  const mine = Array.from({ length: L.D }, (_, arm) => L.neighbour(k, arm)).filter((n) => Array.from({ length: L.D }, (_, arm) => arm).some((arm) => run.woken[n] >> arm & 1 && L.neighbour(n, arm) === k));
  const sum = (of) => taken.filter(of).reduce((s, r) => s + r.each * r.copies, 0);
  const line = (word, value) => make("tr", {}, ...cells(word, newtons(value)));
  const edge = sum((r) => r.from >= 0 && run.kinds[r.from] < 0);
  const out = total / row.each, balance = make("p", {}, make("b", { textContent: t("inOut", { x: quantity(Number(out.toPrecision(4)), "N") }) }));
  return [make("p", {}, make("b", { textContent: story ? t(story.pulled && !story.squeezed ? "inAllPulled" : "inAll", { a: newtons(story.total), b: newtons(story.squeezed || story.pulled), c: newtons(story.passed ? story.passed.reduce((a, b) => a + b, 0) : 0) }) + (story.pulled && story.squeezed ? t("pulledBy", { x: newtons(story.pulled) }) : "") + (story.dropped ? t("endedHere", { d: newtons(story.dropped) }) : "") : "" }), ...(run.scene.rule.accumulate ? [` ${t("addsUp")}`] : [])),
    card(t("cameIn", { g, c: cellName(L, k) }), table),
    card(t("ofThisLoad", { p: newtons(row.each) }), make("table", {}, make("tr", {}, ...cells(t(row.channel < L.D ? "keeps" : "stretches"), "α₁P", newtons(own, row.each))), ...parts)),
    card(t("cameBack"), make("table", {}, line(t("fromWoken"), sum((r) => mine.includes(r.from))), line(t("fromEdge"), edge))), ...(Math.abs(out - 1) > 1e-9 ? [balance] : [])];
}

// -------------------------------------------------------------------------------- the picture

/** A thick arrow whose width is its load; `ghost`: an outline only, for what ends. */
function thick(ctx, x, y, dx, dy, length, width, ink, inks, ghost) {
  const head = Math.min(length * 0.45, Math.max(9, width * 0.7)), half = width / 2, wing = Math.max(half + 4, half * 1.25), [px, py] = [-dy, dx];
  const at = (along, aside) => [x + dx * along + px * aside, y + dy * along + py * aside], points = [[0, half], [length - head, half], [length - head, wing], [length, 0], [length - head, -wing], [length - head, -half], [0, -half]];
  ctx.beginPath(); points.forEach(([a, b]) => ctx.lineTo(...at(a, b))); ctx.closePath();
  ctx.lineJoin = "round"; ctx.setLineDash(ghost ? [4, 3] : []); ctx.fillStyle = ghost ? inks.paper : ink;
  ctx.strokeStyle = ghost ? inks.soft : inks.paper; ctx.lineWidth = ghost ? 1.4 : 2;
  ctx.fill(); ctx.stroke(); ctx.setLineDash([]);
}

function paintCell(page, box) {
  const { view: { ctx }, view: small, run, inks, t, picked: k } = page, { lattice: L } = run, { row } = studied(page), hex = L.hexagon;
  const s = Math.min(box.w / 2.45, box.h / 2.45), cx = box.x + box.w / 2, cy = box.y + box.h / 2, out = (arm) => [L.normals[arm][0], -L.normals[arm][1]];
  page.close = { cx, cy, s };
  const outline = (x, y, size = s) => small.outline([x, y], size);
  const font = FONT.replace("12px", s > 130 ? "13px" : "12px"), bold = `600 ${FONT.replace("12px", s > 130 ? "15px" : "12px")}`;
  const corner = small.corners(small.at(...small.centre(L.cell(k)))), right = Math.max(...corner.map((p) => p[0]));
  ctx.save(); ctx.strokeStyle = right > 0 ? inks.line : inks.paper; ctx.lineWidth = 1;                       // where on the body this is
  ctx.beginPath(); ctx.moveTo(right, corner[0][1]); ctx.lineTo(cx - 1.2 * s, cy - 1.2 * s); ctx.moveTo(right, corner[2]?.[1] ?? corner[0][1]); ctx.lineTo(cx - 1.2 * s, cy + 1.2 * s); ctx.stroke();
  ctx.beginPath(); ctx.rect(cx - 1.21 * s, cy - 1.21 * s, 2.42 * s, 2.42 * s); ctx.clip();
  const wide = 1.02 * s;
  for (const x of [-1, 0, 1]) for (const y of [-1, 0, 1]) if (!hex && (x || y)) {
    const there = L.contains([L.cell(k)[0] + x, L.cell(k)[1] - y]) && run.kinds[L.key([L.cell(k)[0] + x, L.cell(k)[1] - y])] >= 0;
    outline(cx + x * wide, cy + y * wide);
    if (there) { ctx.fillStyle = inks.cell; ctx.fill(); }
    ctx.setLineDash(there ? [] : [3, 4]); ctx.strokeStyle = there ? inks.cell : inks.line; ctx.stroke(); ctx.setLineDash([]);
  }
  if (hex) for (let arm = 0; arm < L.D; arm++) { const [x, y] = out(arm); outline(cx + x * wide, cy + y * wide); ctx.fillStyle = inks.cell; ctx.fill(); }
  outline(cx, cy); ctx.fillStyle = inks.paper; ctx.fill(); ctx.setLineDash([4, 3]); ctx.strokeStyle = inks.ink; ctx.stroke(); ctx.setLineDash([]);
  for (let arm = 0; arm < L.D; arm++) {        // its name in the far corner of a neighbour, out of the arrows' way
    const [x, y] = out(arm), n = L.neighbour(k, arm), kind = run.kinds[n], word = kind >= 0 ? cellName(L, n) : t(kind === AIR ? "air_" : kind === RIGID ? "ground" : "roller");
    const flat = Math.abs(y) < 0.5;
    if (!flat || s >= 100) paintWord(ctx, word, cx + (flat ? 1.17 * Math.sign(x) : hex ? 1.17 * x : -0.46) * s, cy + (flat ? -0.44 : 1.13 * y) * s, inks.soft, inks, { font, align: flat && x > 0 ? "right" : "left" });
  }
  if (!row) { paintOwn(page, cx, cy, s, outline, bold); ctx.restore(); return; }
  const { list, own } = leaving(run.scene, run, k, row.channel, row.each), P = row.each, scale = 0.2 * s / P, width = (load) => Math.max(2, load * scale * 1.3);
  const [dx, dy] = out(row.channel % L.D), pull = row.channel >= L.D, squeeze = 0.94;   // drawn squeezed along the load
  const colour = colourOf(own, page.scale("kept"), inks), paint = css(colour);
  ctx.save(); ctx.translate(cx, cy); const tilt = Math.atan2(dy, dx); ctx.rotate(tilt); ctx.scale(pull ? 1 / squeeze : squeeze, pull ? squeeze : 1.01); ctx.rotate(-tilt); ctx.translate(-cx, -cy);
  outline(cx, cy, s - 1); ctx.fillStyle = paint; ctx.fill(); ctx.restore();
  // A load that came along a side stands at that side; one that came ahead stands behind.
  const side = row.arm >= 0 && row.from >= 0 ? out(row.arm) : [-dx, -dy], behind = (side[0] * dx + side[1] * dy) * (pull ? -1 : 1) < -0.5 || row.from < 0, inkOf = (channel) => (channel < L.D ? inks.load : inks.elastic);
  const off = (pull ? 0.46 : -1.08) * s, start = behind ? [cx + dx * off, cy + dy * off] : [cx + side[0] * 0.3 * s - dx * 0.42 * s, cy + side[1] * 0.3 * s - dy * 0.42 * s];
  thick(ctx, ...start, dx, dy, (behind ? 0.62 : 0.5) * s, width(P), inkOf(row.channel), inks, false);
  const words = [], say = (text, x, y, ink, f = bold, align = "center") => words.push([text, x, y, ink, { font: f, align }]);
  const inwards = !behind && side[0] > 0.5 ? -1 : 1;   // words stand within the cell, off what it passes on
  const beside = Math.abs(dy) > 0.5 ? [start[0] + inwards * (width(P) / 2 + 12), start[1] + (dy > 0 ? 0.1 : -0.2) * s, inwards < 0 ? "right" : "left"] : [start[0] + dx * 0.3 * s, start[1] - width(P) / 2 - 26, "center"];
  say(`P = ${newtons(P)}`, beside[0], beside[1], inkOf(row.channel), bold, beside[2]);
  if (s > 120) say(`${t("cameFrom")} ${row.from < 0 ? t("outside") : run.kinds[row.from] >= 0 ? cellName(L, row.from) : senderOf(page, row, k)}`, beside[0], beside[1] + 18, inks.ink, font, beside[2]);
  for (const { arm, channel, load, ends, kind } of list) {
    const [ax, ay] = out(arm), [ex, ey] = out(channel % L.D), [over, along, back, long] = STANDS[kind], length = long * s, far = over + (ax * ex + ay * ey < -0.5 ? long : 0);   // a pull points back at the cell
    const x = cx + s * (far * ax - along * ex - back * dx), y = cy + s * (far * ay - along * ey - back * dy);
    thick(ctx, x, y, ex, ey, length, Math.max(ends ? 8 : 2, width(load)), inkOf(channel), inks, ends);
    const text = `${newtons(load, P)}${ends ? `: ${t("ends_")}` : ""}`, upright = Math.abs(ey) > 0.5;
    const [wx, wy] = kind === "ahead" ? [x + ex * length * 0.6 + (upright ? width(load) / 2 + 10 : 0), y + ey * length * 0.6 + (upright ? 0 : width(load) / 2 + 14)] : kind === "along" ? [x + ex * length * (upright ? 0.5 : 0.5), y + ey * length + (upright ? ey * 14 : 18)] : upright ? [x - 12, y + ey * length * 0.5] : [x + ex * length * 0.5, y + 17];
    const align = !upright || kind === "along" ? "center" : kind === "ahead" ? "left" : "right";
    say(text, wx, wy, ends ? inks.ink : inkOf(channel), ends ? `600 ${font}` : bold, align);
    if (s > 120) say(formulaOf(page, { kind, load }, P), wx, wy + (kind === "along" && ey < -0.5 ? -17 : 17), inks.soft, font, align);
  }
  const middle = cy + (behind ? 0 : 0.3 * s);
  const [word, load] = [t(pull ? "stretches" : "keeps"), newtons(own, P)], lines = s > 120 ? [[`${word} ${load}`, bold], ["α₁P", font]] : [[word, font], [load, bold]];   // a phone's cell is narrower than both
  lines.forEach(([text, face], n) => say(text, cx, middle - 6 + 19 * n, inks.ink, face));
  words.forEach(([text, x, y, ink, options]) => paintWord(ctx, text, x, y, ink, inks, options));
  ctx.restore();
  const key = t("cellKey", { g: quantity(run.scene.rule.threshold, "N") }).split(" · ");
  if (run.scene.rule.accumulate) key[1] = t("addsUp");   // no arrow ends alone
  if (s > 120) (key.join(" · ") + (run.C > L.D ? t("pullKey") : "")).split(" · ").forEach((line, n) => paintWord(ctx, line, cx - 1.2 * s, cy + 1.21 * s + 6 + 15 * n, inks.soft, inks));
}

/** What agents of one's own passed on so far, by arm: no formula is theirs. */
function paintOwn(page, cx, cy, s, outline, font) {
  const { view: { ctx }, run: { lattice: L }, inks, picked, t } = page, story = storyOf(page, picked);
  outline(cx, cy); ctx.fillStyle = inks.cell; ctx.fill();
  paintWord(ctx, story ? `${t("keeps")} ${story.kept === null ? "–" : newtons(story.kept)}` : t("asleepNow"), cx, cy - 0.25 * s, inks.ink, inks, { font, align: "center" });
  const most = Math.max(1e-300, ...(story?.passed ?? [0]));
  story?.passed?.forEach((load, arm) => {
    const [x, y] = [L.normals[arm][0], -L.normals[arm][1]];
    if (!load) return;
    thick(ctx, cx + x * 0.46 * s, cy + y * 0.46 * s, x, y, 0.5 * s, Math.max(2, 0.26 * s * load / most), inks.load, inks, false);
    paintWord(ctx, newtons(load), cx + x * 0.8 * s, cy + y * 0.8 * s + (y ? 0 : 26), inks.load, inks, { font, align: "center" });
  });
}

// ----------------------------------------------------------------------- what a cell can tell

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
  const on = (c, axis) => c % D === axis || L.opposite[c % D] === axis;
  const pulled = own === null || sums.kept ? 0 : own * taken.slice(D).reduce((a, b) => a + b, 0);   // stretches it
  const along = own === null || (sums.kept && !known) ? null : sums.kept ? page.keptAlong(k) : L.axes.map((axis) => own * taken.reduce((sum, v, c) => sum + (c < D && on(c, axis) ? v : 0), 0)), squeezed = along && along.reduce((a, b) => a + b);
  return { cell: L.cell(k), material: material.name, spawn: spawn[k], wakers, taken, total, along, squeezed, pulled, kept: along && squeezed + pulled,
    passed: at("passed", D), dropped: at("dropped")?.[0] ?? null, returned: at("returned")?.[0] ?? null, now };
}

/** Write the story of a cell into an element. */
export function tellStory(page, element) {
  const { run, picked: k, t } = page, L = run.lattice;
  const paragraph = (text) => make("p", { textContent: text });
  if (k < 0) { element.replaceChildren(paragraph(t(page.touchable && !page.lesson ? "begin" : "pick"))); return; }
  const kind = run.kinds[k], { materials } = run.scene, head = t("cellOf", { c: `(${L.cell(k).join(", ")})` }) + (kind >= 0 && materials.length > 1 ? `, ${materials[kind].name}` : "");
  if (kind < 0) {
    element.replaceChildren(make("b", { textContent: head }), paragraph(run.walls?.[kind] ? t("ownWall", { n: run.walls[kind] }) : t(kind === AIR ? "isAir" : kind === RIGID ? "isRigid" : "isRoller")));
    return;
  }
  const story = storyOf(page, k);
  if (!story) { element.replaceChildren(make("b", { textContent: head }), paragraph(t("asleep"))); return; }
  const name = (c) => L.names[c % L.D] + (run.C > L.D ? ` ${t(c < L.D ? "pushes" : "pulls")}` : "");
  const data = (value) => make("data", { value: String(value), textContent: quantity(value, "N") });
  const several = (list) => (list.length ? list.flatMap(([word, value], i) => [`${i ? ", " : ""}${word} `, data(value)]) : ["–"]);
  const nonzero = (list, word) => list.map((value, c) => [word(c), value]).filter(([, value]) => value > 0);
  const later = t(run.late ? "atEnd" : "unknown"), rows = [];
  const row = (word, ...content) => rows.push(make("dt", { textContent: t(word) }), make("dd", {}, ...content));
  const wakers = story.wakers.map((w) => `(${L.cell(w).join(", ")})`).join(", ");
  row("woken", t("byWhom", { g: story.spawn, w: wakers || t("outside") }));
  row("took", data(story.total), ": ", ...several(nonzero(story.taken, name)));
  row("keptIt", ...(story.along ? [data(story.squeezed), ": ", ...several(nonzero(story.along, (n) => L.names[L.axes[n]].replace("+", "")))] : [later]));   // a cut counts what is along the load alone
  if (story.pulled) row("stretchedIt", data(story.pulled));
  if (!page.lesson || page.mode?.name !== "cell") row("passedOn", ...(story.passed ? several(nonzero(story.passed, (a) => L.names[a])) : [later]));
  row("ended", story.dropped === null ? later : data(story.dropped));
  for (const [key, label, whether] of run.states ?? []) {
    const value = page.sums[`state ${key}`]?.sum[k] ?? 0;
    rows.push(make("dt", { textContent: page.say(label) }), make("dd", {}, whether ? t(value ? "yes" : "no") : String(Number(value.toPrecision(6)))));
  }
  row("gotBack", story.returned !== null ? data(story.returned) : run.late && run.returned ? later : t("unknown"));
  if (story.now.length) row("thisGeneration", ...several(story.now.map(([c, v]) => [name(c), v])));
  element.replaceChildren(make("b", { textContent: head }), make("dl", {}, ...rows));
}
