// Recorded pictures: parts that move and change (springs, creep, elastic agents, agents of many
// sizes). The page is the same; what is drawn is not a rule's history but frames.
import { paintGrid, partOf, ticksOf } from "./charts.js";
import { draw, make } from "./controls.js";
import { bytesOf, Recorded, through, unpack } from "./history.js";
import { Page } from "./page.js";
import { arrow, colourOf, css, fillBox, fillRimmed, lineOfGround, packed, paintLegend, rgb, SHEET, View } from "./paint.js";
import { general, largest, quantity, recounted, roundDown } from "./words.js";

const SHOWN = 0.066;                           // of the body: its largest displacement, magnified

export class MotionPage extends Page {
  begin({ dimension, corners, at, along, colours, curves, forces, shares, outcome, visits, ground, outlines, lesson, columns }) {
    const { points, parts, held, moved, born, gone } = columns;
    Object.assign(this, { dimension, corners, at, along, units: colours, outcome, visits, ground, outlines, points, parts, held, born, gone });
    this.count = parts.length / corners;
    this.fields = Object.fromEntries(Object.keys(colours).map((name) => [name, this.framesOf(columns[`value ${name}`], this.count)]));
    this.moved = moved && this.framesOf(moved, moved.length / (along === "share" ? 1 : at.length));
    const [first] = this.moved?.slice(1) ?? [], far = (i) => (first ? Math.hypot(...first.subarray(i * dimension, (i + 1) * dimension)) : 0), most = Math.max(...[...held].map(far));
    this.pulled = new Set([...held].filter((i) => most && far(i) > 0.5 * most));   // nodes that are held, and moved: others at most slide
    this.each = moved ? dimension * points.length / this.moved[0].length : 0;   // numbers in points to one displacement
    this.look.colour = lesson && "level" in colours ? "level" : Object.keys(colours)[0] ?? "";   // a lesson asks first who is there
    this.curveList = curves;
    this.run = { generation: at.length - 1, atRest: true };
    this.sums = {}; this.scales = new Map();
    this.frame();
    if (lesson && (born || along === "share")) this.look.deformed = false;
    this.shares = shares;                         // of the forces, by frame; none: all act throughout
    this.whole = forces.map(({ place, force, wide }) => ({ cell: place.map((p, a) => (p - this.low[a]) / this.unit - 0.5), force, wide: wide / this.unit, near: this.nearest(place) }));
    for (const load of this.whole) load.out = load.force.some((x, a) => (x > 0.9 * Math.hypot(...load.force) && load.cell[a] + 0.5 > this.run.lattice.shape[a] - this.edge - 0.01) || (x < -0.9 * Math.hypot(...load.force) && load.cell[a] + 0.5 < this.edge + 0.01));   // out of the box round the body
  }
  get forces() {
    const share = this.shares.length && !this.lesson?.secret ? this.shares[this.g] || 1e-9 : 1, { points, low, unit, dimension: d } = this;   // they go with what they act on; a guess is told the whole
    return this.whole.map(({ cell, force, wide, near, out }) => ({ out, wide, cell: this.where(near).map((x, a) => cell[a] + x - (points[near * d + a] - low[a]) / unit), force: force.map((x) => share * x) }));
  }
  /** The point at rest that is nearest to a place. */
  nearest(place) {
    const { dimension: d, points } = this;
    let best = 0, least = Infinity;
    for (let i = 0; i * d < points.length; i++) { let far = 0; for (let a = 0; a < d; a++) far += (points[i * d + a] - place[a]) ** 2; if (far < least) { least = far; best = i; } }
    return best;
  }
  /** An answer at rest is told once: its frames are shares of it. */
  framesOf(column, size) {
    if (this.along === "share") return this.at.map((share) => column.map((x) => share * x));
    return Array.from({ length: column.length / size }, (_, f) => column.subarray(f * size, (f + 1) * size));
  }
  /** A box round everything, in whose hundredths points are drawn. */
  frame() {
    const { dimension: d, points, parts } = this, low = Array(d).fill(Infinity), high = Array(d).fill(-Infinity);
    for (const i of parts) for (let a = 0; a < d; a++) { low[a] = Math.min(low[a], points[i * d + a]); high[a] = Math.max(high[a], points[i * d + a]); }
    const extent = this.extent = Math.max(...this.sides = high.map((h, a) => h - low[a])) || 1;
    const room = this.moved ? Math.max(SHOWN * extent, this.usual * this.scale("move").far) : 0;   // what moves stays in the picture
    this.unit = extent / 100; this.low = low.map((x) => x - 0.5 * room); this.edge = 0.5 * room / this.unit;
    this.run.lattice = { shape: high.map((h, a) => (h - low[a] + room) / this.unit), dimension: d, hexagon: false };
    this.look.deformed = Boolean(this.moved);
  }
  /** Small displacements are magnified: the largest is shown as a fifteenth of the body. */
  get usual() {
    const { extent } = this, far = this.scale("move").far;
    return far > 0.5 * SHOWN * extent || !far ? 1 : roundDown(SHOWN * extent / far);
  }
  get deformable() { return Boolean(this.moved); }
  get colours() { return [...Object.keys(this.units), ...(this.moved ? ["move"] : [])]; }
  unitOf(name) { return name === "move" ? "m" : this.units[name]; }
  word(key) { return this.t(key === "move" ? key : `value_${key}`); }
  certify() {
    this.tellVerdict(recounted(this.t, this.outcome), null);
  }
  /** Round moments of a run with the frame of each, at most so many. */
  moments(most) {
    const { at, along } = this, last = at.length - 1, near = (v) => at.reduce((best, x, g) => (Math.abs(x - v) < Math.abs(at[best] - v) ? g : best), 0);
    const list = ticksOf(at[0], at[last], 8).map((v) => [near(v), `${general(v, 3)}${along === "s" ? " s" : ""}`]);
    return list.reduce((kept, tick) => (kept.length && tick[0] - kept.at(-1)[0] < 1.2 * last / most ? kept : [...kept, tick]), []);
  }
  goTo(g) { this.g = Math.max(0, Math.min(g, this.run.generation)); }
  magnification() { return this.usual * 10 ** this.look.magnify; }

  /** Where a point is in a frame, in hundredths of the body. */
  where(i) {
    const { dimension: d, points, low, unit, times } = this, p = new Array(d), moved = times ? this.moved[this.g] : null;
    const from = moved ? d * Math.floor(i * d / this.each) : 0;
    for (let a = 0; a < d; a++) p[a] = (points[i * d + a] - low[a] + (moved ? times * moved[from + a] : 0)) / unit;
    return p;
  }
  there(part) {
    const { born, gone, at, g, solid } = this;   // cubes that are less than half full hide the others
    return !(born && born[part] > at[g]) && !(gone && gone[part] <= at[g]) && !(solid && this.value(part, "density") < 0.5);
  }
  /** Springs that tear at this frame. */
  get breaking() { const { gone, at, g, corners } = this; return g && gone && corners === 2 ? Array.from(gone.keys()).filter((s) => gone[s] > at[g - 1] + 1 && gone[s] <= at[g] + 1) : []; }
  value(part, name = this.look.colour) {
    if (name === "move") return this.shift(part);
    const frames = this.fields[name];
    return frames ? (frames[this.g] ?? frames[0])[part] : NaN;
  }
  /** A number of the picked part in words; a millionth of the largest is the rounding of a 0. */
  read(name = this.look.colour) {
    const v = this.value(this.picked, name), { log, high } = this.scale(name);
    return quantity(!log && Math.abs(v) < 1e-6 * high ? 0 : v, this.unitOf(name), log ? 0 : high);
  }
  /** The same for a lesson's caption: beside the questions the card of what was clicked is a long way down. */
  get reading() { return this.lesson && this.picked >= 0 && this.there(this.picked) ? `${this.word(this.look.colour)} ${this.read()}${this.side}` : ""; }
  /** How wide the agent is that was clicked; of one that an outline cuts, how wide it was. */
  get side() {
    const { corners, parts, points, dimension: d, fields: { level } } = this, wide = (i) => { const x = [...parts.subarray(i * corners, (i + 1) * corners)].map((n) => points[n * d]); return Math.max(...x) - Math.min(...x); };
    return level ? ` · ${this.t("sideLength")} ${quantity(largest(Array.from({ length: this.count }, (_, i) => wide(i) * 2 ** this.value(i, "level"))) / 2 ** this.value(this.picked, "level"), "m")}` : "";
  }
  /** How far the middle of a part has moved. */
  shift(part) {
    const { parts, corners, dimension: d, each, moved: { [this.g]: moved } } = this;
    let far = 0;
    for (let a = 0; a < d; a++) {
      let sum = 0;
      for (let i = part * corners; i < (part + 1) * corners; i++) sum += moved[d * Math.floor(parts[i] * d / each) + a];
      far += (sum / corners) ** 2;
    }
    return Math.sqrt(far);
  }
  far(moved, i) {
    let sum = 0;
    for (let a = 0, d = this.dimension; a < d; a++) sum += moved[i * d + a] ** 2;
    return Math.sqrt(sum);
  }
  /** Ends of the colours over all frames; what was seen of them before is not looked at again. */
  scale(name = this.look.colour) {
    const known = this.scales.get(name) ?? { seen: 0, least: 0, far: 0 }, d = this.dimension;
    const frames = (name === "move" ? this.moved : this.fields[name]) ?? [];
    for (; known.seen < frames.length; known.seen++) for (let i = 0, f = frames[known.seen]; i < f.length; i += name === "move" ? d : 1) {
      const v = name === "move" ? this.far(f, i / d) : f[i];
      if (v > known.far) known.far = v;
      if (v < known.least) known.least = v;
    }
    let { least: low, far: high } = known;
    const log = low === 0 && high > 0 && (!this.moved ? /load|mises/ : this.born ? /load|gap/ : /^$/).test(name);
    if (name === "gap" && this.born) high = Array.from({ length: this.count }, (_, i) => (this.there(i) ? this.value(i, name) : 0)).reduce((a, b) => Math.max(a, b));   // of this generation: where it still is
    if (/density|pull/.test(name)) high = 1;      // their ends are those of every body
    if (low < 0) { if (!this.fields.strength) high = Math.max(high, -low); low = -high; }   // what tears, tears by a pull: the ends are the largest, whatever is pushed more
    this.scales.set(name, known);
    return Object.assign(known, { low: log ? high * (name === "gap" ? 1e-2 : 1e-4) : low, high: high || 1, log });
  }

  /** Where the gap is the colour: in how many agents nine tenths of it are, the largest first, and of how many. */
  get mostOfGap() {
    if (!this.born || this.look.colour !== "gap") return "";
    const gaps = Array.from({ length: this.count }, (_, i) => i).filter((i) => this.there(i)).map((i) => this.value(i, "gap")).sort((a, b) => b - a);
    let left = 0.9 * gaps.reduce((a, b) => a + b, 0), n = 0;
    while (left > 0) left -= gaps[n++];
    return this.t("mostOfGap", { n, m: gaps.length });
  }
  drawBody() {
    const { inks: own, look, t } = this, inks = look.colour === "density" ? { ...own, steps: [own.paper, ...own.steps.slice(1)], packed: Uint32Array.from(own.packed, (ink, n) => (n ? ink : packed(rgb(own.paper)))) } : own;   // where all has gone nothing is seen
    const view = this.view = new View(this.canvas, this.run.lattice, look.camera, { foot: this.whole.some(({ force }) => force[1] > 0) ? 96 : 64 }), { ctx, r } = view;
    ctx.setTransform(r, 0, 0, r, 0, 0); ctx.clearRect(0, 0, view.w, view.h);
    const { secret } = this.lesson ?? {};         // neither colours nor a deformed shape tell what is to be guessed
    this.times = look.deformed && this.moved && !secret ? this.magnification() : 0;
    const scale = look.colour && !secret ? this.scale() : null, unknown = packed(rgb(inks.cell)), plain = secret ? unknown : packed(rgb(inks.accent));
    const inkOf = (v) => (Number.isNaN(v) ? unknown : colourOf(v, scale, inks)), ink = (part) => (scale ? inkOf(this.value(part)) : plain);
    if (this.corners === 2) this.drawSprings(view, ink); else this.drawParts(view, ink);
    if (this.outlines?.length) this.cutOut(view);
    if (this.corners > 2 && !this.solid) {        // a dark edge
      ctx.save(); ctx.resetTransform(); Object.assign(ctx, { globalCompositeOperation: "destination-over", shadowColor: inks.ink, shadowBlur: 2 * r });
      ctx.drawImage(view.canvas, 0, 0); ctx.restore();
    }
    Object.assign(ctx, { strokeStyle: inks.soft, lineWidth: 1.5 }); ctx.beginPath();
    for (const { from, to, out, kind } of this.ground) lineOfGround(ctx, ...[from, to].map((p) => view.point(p.map((x, a) => (x - this.low[a]) / this.unit))), out, kind === "roller");
    ctx.stroke();
    this.loads.paint(view);
    if (this.picked >= 0 && this.there(this.picked)) {
      const [x, y] = view.point(this.middle(this.picked));
      ctx.strokeStyle = inks.paper; ctx.lineWidth = 5; ctx.beginPath(); ctx.arc(x, y, 9, 0, 7); ctx.stroke();
      ctx.strokeStyle = inks.ink; ctx.lineWidth = 2; ctx.stroke();
    }
    if (scale && this.lesson?.limit !== 0 && !(this.lesson?.step === "step" && this.g === 0 && look.colour !== "density")) paintLegend(view, scale, this.word(look.colour), this.kindOf(scale), (v) => quantity(v, this.unitOf(look.colour), scale.log ? 0 : scale.high), inks);
    const level = this.visits[this.g], block = Array(this.dimension).fill(2 ** level).join("×");
    this.parts.cap.textContent = this.told || [level > 0 && t("parents", { n: block }), this.mostOfGap, this.times && Math.abs(this.times - 1) > 1e-9 && t("magnified", { n: quantity(this.times, "") }), this.lesson && t("measures", { s: this.sides.map((side) => quantity(Number(side.toPrecision(3)), "m")).join(" × ") }), this.lesson && this.corners === 2 && t(this.pulled.size ? "pulledMark" : "heldMark"), this.breaking.length > 0 && t("breaksNow"), this.reading, this.lesson && this.breaking.length > 0 && this.g === this.run.generation && this.parts.verdict.textContent].filter(Boolean).join(" · ");
  }
  placesOf(part) { return Array.from({ length: this.corners }, (_, i) => this.where(this.parts[part * this.corners + i])); }
  middle(part) {
    const list = this.placesOf(part);
    return list[0].map((_, a) => list.reduce((sum, p) => sum + p[a], 0) / list.length);
  }
  drawParts(view, ink) {
    const { corners, count } = this, { ctx } = view, px = new Float64Array(8), py = new Float64Array(8), solid = corners === 8;
    SHEET.start(ctx, view.W, view.H);
    if (!solid) { this.fillFlat(view, ink, px, py); ctx.putImageData(SHEET.image, 0, 0); return; }
    const order = Array.from({ length: count }, (_, i) => i).filter((i) => this.there(i));
    const far = new Float64Array(count);
    for (const i of order) far[i] = this.middle(i).reduce((sum, x, a) => sum + x * view.depth[a], 0);
    order.sort((a, b) => far[b] - far[a]);
    for (const part of order) fillBox(view, this.placesOf(part).map((p) => view.point(p)), ink(part));
    ctx.putImageData(SHEET.image, 0, 0);
  }
  /** Squares, hexagons, diamonds: 80,000 of them, so nothing is made for each. */
  fillFlat({ r, u, x0, y0 }, ink, px, py) {
    const { corners, parts, points, low, unit, times, each, count } = this, moved = times ? this.moved[this.g] : null;
    this.view.rim = this.born && this.lesson?.secret ? 0 : moved ? 1.08 : 1;   // sizes are guessed first; parts that slide a little past each other still have a line between them, which is double in few places
    this.view.least = this.look.colour === "level" ? 5 : 9;   // where sizes are looked at, small ones have lines, too
    for (let part = 0; part < count; part++) {
      if (!this.there(part)) continue;
      for (let i = 0; i < corners; i++) {
        const p = 2 * parts[part * corners + i], from = moved ? 2 * Math.floor(p / each) : 0;
        px[i] = r * (x0 + u * (points[p] - low[0] + (moved ? times * moved[from] : 0)) / unit);
        py[i] = r * (y0 - u * (points[p + 1] - low[1] + (moved ? times * moved[from + 1] : 0)) / unit);
      }
      fillRimmed(this.view, px, py, corners, ink(part), 1);
    }
  }
  /** Leave of the parts what is within closed lines, to which the last points belong. */
  cutOut(view) {
    const { outlines, points, inks } = this, { ctx, r, W, H } = view, mask = new OffscreenCanvas(W, H), pen = mask.getContext("2d");
    let n = points.length / 2 - outlines.reduce((a, b) => a + b, 0);
    pen.setTransform(r, 0, 0, r, 0, 0);
    for (const count of outlines) for (let k = 0; k < count; k++) pen[k ? "lineTo" : "moveTo"](...view.point(this.where(n++)));
    pen.fill("evenodd");
    ctx.save(); ctx.resetTransform();
    ctx.globalCompositeOperation = "destination-over";   // parts that moved apart a little get their neighbours' colours between them, no edge
    for (const [x, y] of [[r, 0], [-r, 0], [0, r], [0, -r]]) ctx.drawImage(view.canvas, x, y);
    ctx.globalCompositeOperation = "destination-in"; ctx.drawImage(mask, 0, 0);
    ctx.restore();
  }
  drawSprings(view, ink) {
    const { parts, count, held, points, dimension, inks } = this, { ctx } = view, nodes = points.length / dimension;
    const room = Math.min(1, view.w / 600, view.h / 600);   // a phone, or a frame beside others
    const width = Math.max(1, room * Math.min(5, 260 / Math.sqrt(count))), lists = new Map();
    for (let s = 0; s < count; s++) if (this.there(s)) { const c = ink(s); if (!lists.has(c)) lists.set(c, []); lists.get(c).push(s); }
    const stroke = (list, ink, wide) => {
      ctx.lineCap = "round"; ctx.lineWidth = wide; ctx.strokeStyle = ink; ctx.beginPath();
      for (const s of list) { ctx.moveTo(...view.point(this.where(parts[2 * s]))); ctx.lineTo(...view.point(this.where(parts[2 * s + 1]))); }
      ctx.stroke();
    };
    stroke([...lists.values()].flat(), inks.line, width + 1.5);   // where nothing pulls, a spring is still there
    for (const [c, list] of lists) stroke(list, css(c), width);
    ctx.strokeStyle = inks.load; ctx.lineWidth = 2; ctx.setLineDash([3, 4]); ctx.beginPath();   // what breaks now
    for (const s of this.breaking) { const [a, b, m] = [this.where(parts[2 * s]), this.where(parts[2 * s + 1]), this.middle(s)].map((p) => view.point(p)); ctx.moveTo(...a); ctx.lineTo(...b); ctx.moveTo(m[0] + 11, m[1]); ctx.arc(...m, 11, 0, 7); }
    ctx.stroke(); ctx.setLineDash([]);
    const fixed = new Set(held), radius = Math.max(1.5, 0.8 * width - 0.5);
    for (let i = 0; i < nodes; i++) {
      const [x, y] = view.point(this.where(i));
      ctx.fillStyle = fixed.has(i) ? inks.load : inks.ink; ctx.beginPath();
      if (fixed.has(i)) ctx.rect(x - radius - 2, y - radius - 2, 2 * radius + 4, 2 * radius + 4); else ctx.arc(x, y, radius, 0, 7);
      ctx.fill();
    }
    ctx.strokeStyle = inks.load; ctx.lineWidth = 2; ctx.beginPath();   // which way is pulled; aside they may slide
    for (const i of this.pulled) {
      const [x, y] = view.point(this.where(i)), [dx, dy] = this.moved[1].subarray(i * dimension), level = Math.abs(dx) > Math.abs(dy);
      arrow(ctx, x, y, level ? 16 * Math.sign(dx) : 0, level ? 0 : -16 * Math.sign(dy), 6);
    }
    ctx.stroke();
  }
  words() {
    this.parts.cap.classList.toggle("wide", !this.whole.length);   // no arrow stands beside it
    const { t, g, run, along, at } = this, shares = at.at(-1) <= 1 && at.length > 2;
    this.tellTime(`${this.way} ${along === "s" ? `${general(at[g], 4)} s` : shares ? quantity(at[g], "") : t("moment", { g: general(at[g], 4), n: general(at.at(-1), 4) })}`);
    this.parts.verdict.hidden = !this.outcome || (this.along === "share" || (this.lesson && (this.born || this.along === "step")) ? this.lesson : g < run.generation) || this.limit < run.generation;   // how it ended is told at the end, but no lesson's number
    this.tell(); this.drawCurves();
    if (this.canvas.clientWidth !== this.view.w) this.later();   // charts that have gone leave room, which no observer sees
  }
  /** What a run goes along, in a word: time, breaks, shares of the load ... */
  get way() { const { t, along, at } = this; return along === "s" ? t("time") : t(`along_${along === "stage" && at.at(-1) <= 1 && at.length > 2 ? "share" : along}`); }
  /** How the parts of a rod stand, drawn, and what each has of the dent. */
  rod(g = this.g) { return rodOf(this, g); }
  tell() {
    const { picked, parts, t } = this, rod = this.lesson && this.along === "s" && this.corners === 2 ? this.rod() : [];
    if (picked < 0 || !this.there(picked)) { parts.story.replaceChildren(...rod, make("p", { textContent: t(rod.length ? "rodDrawn" : this.corners === 2 ? (this.along === "s" ? "pickRod" : "pickSpring") : this.fields.level ? "pickAgent" : "pickPart") })); return; }
    const row = (name) => [make("dt", { textContent: this.word(name) }), make("dd", {}, make("data", { value: String(this.value(picked, name)), textContent: this.read(name) }))];
    const known = (name) => (name === "move" && this.born ? this.moved[this.g].some(Boolean) : !Number.isNaN(this.value(picked, name)));   // generations before the last tell less
    const rows = (this.lesson && this.born ? [this.look.colour] : this.colours).filter(known).flatMap((name) => row(name));
    if (this.born && !this.fields.spawn_step) rows.push(make("dt", { textContent: t("woken") }), make("dd", {}, `${t(`along_${this.along}`)} `, make("data", { value: String(this.born[picked]), textContent: String(this.born[picked]) })));
    parts.story.replaceChildren(make("b", { textContent: this.born || this.fields.level ? `${t("agent")} ${picked}` : t(this.corners > 2 ? "part" : this.along === "s" ? "rod" : "spring", { n: picked }) }), ...rod, make("dl", {}, ...rows));
  }
  drawCurves() {
    const { parts: { charts: box }, curveList, inks, at, g, t } = this, named = (of) => of.split(": ").map((part) => t(`curve_${part}`, { otherwise: part })).join(": ");
    box.hidden = !curveList.length;
    if (!box.isConnected) return;
    const { lesson } = this, seen = this.seen = Math.max(this.seen ?? 0, g), limit = !lesson || lesson.teacher ? Infinity : at[seen];   // what a lesson lets read is played first
    const list = lesson?.curves ? lesson.curves.flatMap((name) => curveList.find(({ title }) => title.startsWith(name)) ?? []) : curveList.slice(0, 6), shown = (lines, all = Object.entries(lines)) => all.filter(([, list]) => all.length < 4 || largest(list) > 0.01 * Math.max(...Object.values(lines).map(largest)));   // of many, those that are not nothing
    if (g && lesson && this.canvas.clientWidth < 520) this.parts.cap.textContent = list.filter(({ place }) => !place).map(({ title, unit, at: over, lines }) => `${named(title)}: ${Object.values(lines).map((line) => quantity(line[over.findIndex((v) => v >= at[g])], unit, largest(line))).join(", ")}`).concat(this.mostOfGap || [], this.reading || [], this.breaking.length && g === this.run.generation ? this.parts.verdict.textContent : []).join(" · ");   // on a phone the charts, and what was clicked, are a long way down
    const end = at[Math.min(this.limit, at.length - 1)];   // axes go no further than the question
    paintGrid(box, list.map(({ title, unit, at: over, axis, lines, logarithmic, course, bars, place }, _, $, open = place || course ? over.length : over.filter((v) => v <= end).length) =>
      ({ word: named(title), unit, over: over.slice(0, open), lists: shown(lines).map(([, list]) => list.slice(0, open)), names: shown(lines).map(([name]) => named(name)), now: place ? null : at[g], colours: lines.push ? [7, 1].map((n) => inks.differences[n]) : null, log: logarithmic, course, bars, axis, along: course ? "" : place || this.way, end: place || course ? 0 : end, limit: place && limit < at.at(-1) ? -Infinity : limit })), inks);
  }
  seekChart(event) {
    const { curveList, at } = this;
    if (!curveList.length || curveList[0].place) return;
    const { at: over } = curveList[0], wanted = over[0] + partOf(event) * (over.at(-1) - over[0]);
    this.seek(at.reduce((best, v, i) => (Math.abs(v - wanted) < Math.abs(at[best] - wanted) ? i : best), 0));
  }
  press(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.hold = { x: event.clientX, y: event.clientY, ...this.look.camera };
    let best = Infinity;
    const part = this.look.colour ? 0.005 / this.scale().high : 0;
    for (let i = 0; i < this.count; i++) {
      if (!this.there(i)) continue;
      const [x, y] = this.view.point(this.middle(i)), off = Math.hypot(x - event.offsetX, y - event.offsetY), far = this.fields.level ? Math.max(8, off) - 0.01 * this.value(i, "level") - part * Math.abs(this.value(i) || 0) : off;   // of agents too small to be hit one by one, the smallest, and of these the one of the largest value
      if (far < best) { best = far; this.picked = i; }
    }
    this.later();
  }
  move(event) { this.turn(event); }
  release() { this.hold = null; }
  walk(event) {                                // arrows go from part to part
    const way = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
    if (!way) return false;
    const { count, picked } = this, next = Array.from({ length: count }, (_, n) => (picked + way * (n + 1) + 2 * count) % count).find((i) => this.there(i));
    this.picked = next ?? picked;
    this.later();
    return true;
  }
}

/** What the picked rod is made of, as it stands now, pushed or pulled as far as its force says; none picked: the one that is pushed most. While a force acts the second damper goes on, and stays; spring and damper beside it have the rest. */
function rodOf({ t, at, curveList, fields: { tension }, picked }, g) {
  const [dent, force] = ["Displacement", "History"].map((name) => Object.values(curveList.find(({ title }) => title === name).lines)[0]), most = Math.max(...dent), forces = tension[dent.indexOf(most)], words = t("rodParts").split("|");
  const px = 42 / most * (picked < 0 ? 1 : -forces[picked] / largest(forces));   // by which it is shortened
  const pushed = (n) => force.slice(1, n + 1).reduce((sum, f, i) => sum + 0.5 * (f + force[i]) * (at[i + 1] - at[i]), 0), stays = dent.at(-1) * pushed(g) / pushed(at.length);
  const told = (v) => quantity(Math.abs(v) < 1e-4 * most ? 0 : v, "m", most), a = 150 - px * (dent[g] - stays), b = a + 130 - px * stays, wave = Array.from({ length: 10 }, (_, i) => `L${32 + (a - 44) * (i + 0.5) / 10} ${i % 2 ? 20 : 36}`).join(""), damper = (x, to, y) => `M${x} ${y}h12m70 -9h-70v18h70M${to - 73} ${y - 7}v14m0 -7H${to}`;
  return [draw("svg", { class: "chart rod", viewBox: "0 0 320 98", role: "img", "aria-label": words.join(", ") }, draw("path", { d: `M20 28V66M${a} 28V66M20 28h12${wave}L${a - 12} 28H${a}${damper(20, a, 66)}${damper(a, b, 47)}` }), ...[14, b + 6].map((cx) => draw("circle", { cx, cy: 47, r: 6 })), ...words.map((word, n) => draw("text", { x: [90, 90, a + 65][n], y: [12, 92, 74][n], "text-anchor": "middle" }, word))), make("p", { textContent: t("rodGives", { a: told(dent[g] - stays), b: told(stays) }) })];
}

// ------------------------------------------------------------------------------------- a file

function dressed(root, text) {                 // by script, so that the content policy needs no styles
  const sheet = new CSSStyleSheet();
  sheet.replaceSync(text);
  root.adoptedStyleSheets = [sheet];
}

/** A page in a file, or in a frame of a notebook: everything is in the text. The keys that nobody else takes are its own. */
export async function openPage(element, base64) {
  element.whole = true;
  dressed(document, "html, body { margin: 0; height: 100%; } body > main { height: 100%; } @page { margin: 6mm 8mm; }");
  dressed(element.attachShadow({ mode: "open" }), STYLE);
  document.addEventListener("keydown", (event) => { if (event.target === document.body) element.page?.key(event); });
  const { header, columns } = await unpack(bytesOf(base64));
  const { cells } = columns;
  if (header.python) header.python.blob = new TextDecoder().decode(await through(bytesOf(document.getElementById("kaju-python").textContent), new DecompressionStream("deflate")));
  if (header.kind === "pictures") return new MotionPage(element, { ...header, columns });
  const run = columns.offset ? Object.assign(new Recorded(header.scene, cells), { late: header.late, states: header.states, absorbed: header.absorbed, ended: header.dropped, walls: header.walls ?? {} }).read(columns) : null;
  const presets = (header.presets ?? []).map((preset, n) => ({ ...preset, cells: columns[`cells${n}`] ?? cells }));
  return new Page(element, { ...header, cells, run, presets });
}
