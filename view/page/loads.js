// Loads in the hand: arrows with number and unit, moved by their tails, turned by their heads,
// added, deleted, typed.
import { button, make, numberField } from "./controls.js";
import { AIR } from "./lattice.js";
import { arrow, FONT, paintWord } from "./paint.js";
import { dot, entering } from "./rule.js";
import { largestForce } from "./scene.js";
import { quantity } from "./words.js";

export class Loads {
  constructor(page) { this.page = page; this.chosen = -1; this.spots = []; }
  get list() { return this.page.scene?.loads ?? this.page.forces ?? []; }
  get strongest() { return largestForce({ loads: this.page.whole ?? this.list }) || 1; }

  /** Where arrows stand: their heads at the surface, as long as the root of the force; those on one cell side by side. */
  placed(view) {
    const seen = new Map(), { list, strongest } = this, every = Math.max(1, Math.ceil(list.length * 14 / Math.max(60, view.u * view.lattice.shape[0]))), whole = this.alongSides(view.lattice);
    return list.flatMap((load, n) => {
      const own = whole.get(n), size = own ?? Math.hypot(...load.force);
      if (!size || (own === undefined && (n - (every >> 1)) % every)) return [];
      const key = load.cell.join(), beside = seen.get(key) ?? 0;
      seen.set(key, beside + 1);
      return [{ n, load, size, ...this.ends(view, load, 18 + 26 * Math.sqrt(Math.min(1, size / strongest)), 14 * (beside + 1 >> 1) * (beside & 1 ? 1 : -1)) }];
    });
  }
  /** Loads along a side lie over each other: the one in their middle stands for all, with their sum; the others have none. */
  alongSides({ normals }) {
    const groups = new Map(), found = new Map();
    this.list.forEach(({ force, face }, n) => {
      const size = Math.hypot(...force), normal = normals?.[face];
      if (!normal || Math.abs(dot(force, normal)) > 0.5 * size) return;
      const key = `${face}:${force.map((f) => (f / size).toFixed(6))}`;
      groups.set(key, [...(groups.get(key) ?? []), n]);
    });
    for (const group of groups.values()) if (group.length > 3) {
      const middle = group[group.length >> 1], sum = group.reduce((all, n) => all + Math.hypot(...this.list[n].force), 0);
      for (const n of group) found.set(n, n === middle ? sum : 0);
    }
    return found;
  }
  ends(view, { cell, force, wide = 0, out }, length, aside = 0) {
    const size = Math.hypot(...force) || 1, unit = force.map((f) => f / size);
    const [dx, dy] = view.way(unit), [cx, cy] = view.point(view.centre(cell)), gap = view.u / 2 + 3, pulls = out ?? this.pulls(cell, unit), s = pulls ? 1 : -1;
    const room = (at, d, most) => d ? Math.abs((d > 0 ? most : 0) - at) / Math.abs(d) - gap - 12 : Infinity;   // an arrow ends on the picture
    length = Math.max(12, Math.min(length, room(cx, s * dx, view.w), room(cy, s * dy, view.h)));
    const away = pulls ? gap + length : -gap;   // outside of the body either way
    const x = cx + dx * away - dy * aside, y = cy + dy * away + dx * aside;
    return { dx, dy, head: [x, y], tail: [x - dx * length, y - dy * length], length, pulls, half: 0.5 * view.u * wide - 2 };
  }
  /** Whether a force points out of the body at its cell, from a neighbour in the body. */
  pulls(cell, unit) {
    const { lattice: L, kinds } = this.page.run, arm = L.normals.findIndex((n) => dot(n, unit) > 0.9), beyond = (a) => kinds[L.neighbour(L.key(cell), a)];
    return arm >= 0 && beyond(arm) === AIR && beyond(L.opposite[arm]) >= 0;
  }
  paint(view) {
    const { page: { inks, touchable, hold, mode }, list, chosen } = this, { ctx } = view;
    const spots = this.spots = this.placed(view), stroke = (ink, width, each) => {
      ctx.strokeStyle = ink; ctx.lineWidth = width; ctx.beginPath();
      for (const { tail: [x, y], head: [hx, hy], dx, dy, length, half, pulls } of each) {
        arrow(ctx, x, y, dx * length, dy * length, 9);
        const [ax, ay] = pulls ? [x, y] : [hx, hy];   // a bar along the surface, as long as the force is spread
        if (half > 9) { ctx.moveTo(ax - half * dy, ay + half * dx); ctx.lineTo(ax + half * dy, ay - half * dx); }
      }
      ctx.stroke();
    };
    ctx.lineCap = "round"; ctx.lineJoin = "round";
    stroke(inks.paper, 6, spots);
    stroke(inks.load, 3, spots);
    if (touchable && !mode?.alone) for (const { n, tail: [x, y] } of spots) {   // a ring to hold it by
      ctx.fillStyle = inks.paper; ctx.strokeStyle = n === chosen ? inks.accent : inks.load; ctx.lineWidth = n === chosen ? 3 : 2;
      ctx.beginPath(); ctx.arc(x, y, 5, 0, 7); ctx.fill(); ctx.stroke();
    }
    const taken = spots.map(({ tail, head }) => [Math.min, Math.max].flatMap((end) => [end(tail[0], head[0]), end(tail[1], head[1])]));
    if (spots.length <= 12) spots.forEach((spot, n) => this.label(view, spot, n, taken));
    if (hold?.ghost) this.paintGhost(view, hold);
  }
  /** An arrow's number beside it, or above if it lies: where it meets none of the boxes that other arrows and numbers have taken. */
  label({ ctx, w }, { size, tail: [x, y], dx, dy, length, pulls }, own, taken) {
    const { inks } = this.page, text = quantity(size < 1e-6 * this.strongest ? 0 : Number(size.toPrecision(4)), "N"), font = `600 ${FONT.replace("12px", "14px")}`;
    ctx.font = font;
    const wide = ctx.measureText(text).width, mx = x + dx * length * 0.4, lies = Math.abs(dx) > Math.abs(dy), my = y + dy * length * 0.4 - (lies ? 14 : 0);
    const meet = ([l, b, r, t], other) => l - 6 < other[2] && r + 6 > other[0] && b < other[3] && t > other[1];
    const box = (lies ? [(pulls ? x : x + dx * length) - (pulls === dx < 0 ? wide + 4 : -4), mx - wide / 2] : [mx + 11, mx - 11 - wide]).map((left) => [left, my - 8, left + wide, my + 8]).find((one) => one[0] > 4 && one[2] < w - 4 && !taken.some((other, n) => n !== own && meet(one, other)));
    if (!box) return;
    taken.push(box); paintWord(ctx, text, box[0], my, inks.load, inks, { font });
  }
  paintGhost(view, { ghost, grip, n }) {
    const { ctx } = view, { inks } = this.page, size = Math.hypot(...ghost.force);
    const { tail: [x, y], dx, dy, length } = this.ends(view, ghost, 18 + 26 * Math.sqrt(size / this.strongest));
    ctx.globalAlpha = 0.6; ctx.setLineDash([5, 4]); ctx.strokeStyle = inks.load; ctx.lineWidth = 3;
    ctx.beginPath(); arrow(ctx, x, y, dx * length, dy * length, 9); ctx.stroke();
    ctx.setLineDash([]); ctx.globalAlpha = 1;
    if (grip === "head" || n >= 0) paintWord(ctx, grip === "head" ? quantity(size, "N") : `(${ghost.cell.join(", ")})`, x + 12, y - 10, inks.load, inks, { font: `600 ${FONT}` });
  }

  // ------------------------------------------------------------------------------ by the hand
  /** What of an arrow is under the pointer: its tail or shaft, or its head, where the body is not. */
  grip({ offsetX: x, offsetY: y, pointerType }) {
    const reach = pointerType === "touch" ? 22 : 14, inBody = Boolean(this.cellAt(x, y));
    let best = null, least = Infinity;
    for (const spot of this.spots) {
      const along = Math.max(0, Math.min(spot.length, (x - spot.tail[0]) * spot.dx + (y - spot.tail[1]) * spot.dy));
      const far = Math.hypot(x - spot.tail[0] - along * spot.dx, y - spot.tail[1] - along * spot.dy);
      if (far < (inBody ? 7 : reach) && far < least) { least = far; best = { n: spot.n, spot, grip: along > 0.72 * spot.length ? "head" : "tail" }; }
    }
    if (best) { this.chosen = best.n; this.tell(); }
    return best;
  }
  cellAt(x, y) {
    const { page: { view, run } } = this, cell = view.cellAt(x, y);
    return cell && run.kinds[run.lattice.key(cell)] >= 0 ? cell : null;
  }
  /** The cell of the body whose middle is nearest to a pixel: never none. */
  nearest(x, y) {
    const { view, run: { lattice: L, kinds } } = this.page;
    let best = null, least = Infinity;
    L.each((k) => {
      if (kinds[k] < 0) return;
      const cell = L.cell(k), [px, py] = view.at(...view.centre(cell)), far = Math.hypot(px - x, py - y);
      if (far < least) { least = far; best = cell; }
    });
    return best;
  }
  /** While the pointer moves: a ghost shows where the arrow will be. */
  drag(hold, { offsetX: x, offsetY: y, shiftKey }) {
    const load = this.list[hold.n], { spot } = hold;
    if (hold.grip === "tail") {
      const aim = this.cellAt(x, y) ?? this.nearest(x + spot.dx * spot.length, y + spot.dy * spot.length);
      hold.ghost = { ...load, cell: aim };
    } else {
      const [tx, ty] = spot.tail, step = Math.PI / 12, far = Math.hypot(x - tx, y - ty) || 1;
      let turn = Math.atan2(ty - y, x - tx);
      if (!shiftKey) turn = Math.round(turn / step) * step;
      const size = Number((spot.size * (far / spot.length) ** 2).toPrecision(2));   // its length is the root of the force
      hold.ghost = { ...load, force: forceOf(size, turn) };
    }
    this.page.later();
  }
  /** Where a load stands and how it presses; `typed`: its fields say so already, and the focus is on its way to the next one. */
  edit(n, { cell, force }, typed = false) {
    const load = this.list[n], { page } = this, { lattice: L, kinds } = page.run, k = L.key(cell);
    if (kinds[k] < 0) { page.announce(page.t("needsCell")); return; }
    page.change(() => Object.assign(load, { cell: [...cell], force: [...force], sense: load.sense === "side" ? "surface" : load.sense, face: entering(L, kinds, k, force) }));
    if (!typed) this.tell();
  }
  /** A double click in the air beside the body adds a load that presses on it there. */
  double({ offsetX: x, offsetY: y }) {
    const { page } = this;
    if (!page.touchable || page.solid || page.mode?.alone || page.pen !== "look" || this.cellAt(x, y)) return;
    this.add(this.nearest(x, y));
  }
  add(cell) {
    const { page } = this, { lattice: L, kinds } = page.run, k = L.key(cell);
    if (kinds[k] < 0) { page.announce(page.t("needsCell")); return; }
    const size = Number((largestForce(page.scene) || largestForce(page.start.scene) || 1).toPrecision(3));
    const order = [...L.sides.keys()].reverse(), face = order.find((arm) => kinds[L.neighbour(k, arm)] === -1) ?? -1;   // the top first
    const force = face < 0 || L.hexagon ? forceOf(size, -Math.PI / 2, L.dimension) : L.normals[face].map((x) => -size * x + 0);
    page.change(() => page.scene.loads.push({ cell: [...cell], force, face: entering(L, kinds, k, force), steps: 1, sense: "surface" }));
    this.chosen = this.list.length - 1;
    page.rebuild();
  }
  remove(n = this.chosen) {
    if (!this.list[n]) return;
    this.chosen = -1;
    this.page.change(() => this.page.scene.loads.splice(n, 1));
    this.page.rebuild();
  }
  /** Keys on the picture: L the next load, A one more here, Delete, Enter its number. */
  key({ key }) {
    const { page } = this, letter = page.look.letters && key.toLowerCase();
    if (!page.touchable || page.mode?.alone) return false;
    if (letter === "l" && this.list.length) {
      this.chosen = (this.chosen + 1) % this.list.length;
      page.picked = page.run.lattice.key(this.list[this.chosen].cell);
      this.tell(); page.later();
    } else if (letter === "a" && page.picked >= 0) this.add(page.run.lattice.cell(page.picked));
    else if ((key === "Delete" || key === "Backspace") && this.chosen >= 0) this.remove();
    else if (key === "Enter" && this.chosen >= 0) this.type();
    else return false;
    return true;
  }
  /** Open the field of the chosen load. */
  type() {
    const { page } = this;
    if (!page.lesson && page.tab !== "draw") { page.tab = "draw"; page.rebuild(); }
    page.root.querySelector(".load input")?.focus();
  }
  tell() {
    this.card?.replaceChildren(...fields(this));
    if (this.deleter) this.deleter.hidden = !this.list[this.chosen];
  }
}

const forceOf = (size, turn, dimension = 2) => (dimension === 3 ? [0, 0, -size]
  : [Math.cos(turn), Math.sin(turn)].map((x) => (Math.abs(x) < 1e-12 ? 0 : Number((size * x).toPrecision(6)))));

/** The chosen load in numbers. */
function fields(loads) {
  const { page, list, chosen } = loads, { t } = page, load = list[chosen];
  if (!load) return [make("p", { className: "hint", textContent: t("loadHint") })];
  const size = () => Math.hypot(...load.force), turn = Math.atan2(load.force[1], load.force[0]), put = (force) => loads.edit(chosen, { cell: load.cell, force }, true), row = (label, options, change) => {
    const { field, error } = numberField({ ...options, label, t }, change);
    return make("div", { className: "row" }, make("span", { textContent: label }), field, error);
  };
  const strength = row(t("load"), { value: size(), min: 1e-12, max: 1e9, unit: "N", log: true, step: 0.1 }, (v) => put(load.force.map((f) => f * v / size())));
  const angle = load.force.length === 2 ? [row(t("angle"), { value: turn * 180 / Math.PI, min: -180, max: 180, unit: "°", step: 1, show: (v) => `${Number(v.toFixed(1))}°` }, (v) => put(forceOf(size(), v * Math.PI / 180)))] : [];
  return [make("p", { className: "hint", textContent: t("loadAt", { n: chosen + 1, m: list.length, c: `(${load.cell.join(", ")})` }) }), strength, ...angle];
}

export function loadsPanel(page) {
  const { loads, t } = page;
  loads.card = make("div", { className: "load" });
  loads.deleter = button(t("deleteLoad"), () => loads.remove());
  loads.tell();
  return [make("h2", { textContent: t("loads") }), loads.card, make("div", { className: "tools" }, loads.deleter, button(t("addLoad"), () => {
    const { lattice: L, kinds } = page.run, [nx, ny] = L.shape;
    loads.add(page.picked >= 0 && kinds[page.picked] >= 0 ? L.cell(page.picked) : loads.nearest(...page.view.at(nx / 4, ny)));
  }))];
}
