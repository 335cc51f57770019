// What a reader has made of a page, as plain data: undone and done again, and handed on as a link.
import { bytesOf, through } from "./history.js";

/** The states of a page one after another. A gesture (one drag, one key) is one step back. */
export class Past {
  constructor(page) { this.page = page; this.gesture = 0; this.begin(); }
  begin() { this.list = [stateOf(this.page)]; this.at = 0; this.noted = -1; this.tell(); }
  /** Note the present state; within a gesture it replaces the one before. */
  note() {
    if (this.busy) return;
    if (this.noted === this.gesture && this.at > 0) this.at--;
    this.noted = this.gesture;
    this.list.splice(this.at + 1, Infinity, stateOf(this.page));
    if (this.list.length > 60) this.list.shift();   // so far back one can go
    this.at = this.list.length - 1;
    this.tell();
  }
  can(turn) { return this.at + turn >= 0 && this.at + turn < this.list.length; }
  go(turn) {
    if (!this.can(turn)) return;
    this.at += turn; this.gesture++;
    this.busy = true;
    restore(this.page, this.list[this.at]);
    this.busy = false;
    this.tell();
  }
  tell() {
    const { undo, redo } = this.page.parts;
    if (undo) { undo.disabled = !this.can(-1); redo.disabled = !this.can(1); }
  }
}

/** What is undone and linked; cells are never edited in place, so that they need no copy. */
export function stateOf(page) {
  const { scene, cells, stage, factor, look, lesson, studio } = page;
  return { scene: structuredClone(scene), cells, stage, factor, look: structuredClone({ ...look, camera: undefined, speed: undefined }), guesses: structuredClone(lesson?.guesses), ran: studio?.ran, chosen: studio?.chosen };
}
export function restore(page, { scene, cells, stage, factor, look, guesses, ran, chosen }) {
  const { camera, speed } = page.look, mode = page.look.mode;
  const same = JSON.stringify([scene, stage]) === JSON.stringify([page.scene, page.stage]) && cells === page.cells;
  Object.assign(page.look, structuredClone(look), { camera, speed });
  if (page.lesson && guesses) page.lesson.guesses = structuredClone(guesses);
  if (page.studio && ran !== page.studio.ran) { page.studio.chosen = chosen; page.studio.run(ran); }
  if (!same) {
    Object.assign(page, { scene: structuredClone(scene), cells, stage, factor, material: "" });
    page.change(() => {});
  }
  if (page.look.mode !== mode) page.setMode(page.look.mode, true);
  page.rebuild();
}

/** The part after # that opens a page as it stands now. */
export async function hashOf(page) {
  const { scene, cells, stage, factor, look } = stateOf(page), { g, picked, start, language, dark } = page;
  const own = page.touchable && cells.some((c, i) => c !== start.cells[i]) ? Array.from(cells) : undefined;
  const told = { look, g, picked, code: page.studio && page.studio.code !== page.studio.first ? page.studio.code : undefined, best: page.studio?.best, ...(page.touchable ? { scene, stage, factor, cells: own } : {}) };
  const packed = await through(new TextEncoder().encode(JSON.stringify(told)), new CompressionStream("deflate-raw")), coded = btoa(Array.from(packed, (b) => String.fromCharCode(b)).join(""));
  return `#${new URLSearchParams({ lang: language, theme: dark ? "dark" : "light", s: coded.replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "") })}`;
}
export async function copyLink(page) {
  const link = location.href.split("#")[0] + await hashOf(page);
  try { history.replaceState(null, "", link); } catch { /* a frame of a notebook has no address of its own */ }
  try { await navigator.clipboard.writeText(link); page.announce(page.t("linkCopied")); } catch { page.announce(page.t("linkThere")); }
}
/** Open what a link says; a link that cannot be read changes nothing and says so. */
export async function follow(page, packed) {
  try {
    const told = JSON.parse(new TextDecoder().decode(await through(bytesOf(packed.replaceAll("-", "+").replaceAll("_", "/")), new DecompressionStream("deflate-raw"))));
    const cells = told.cells ? Int8Array.from(told.cells) : page.start?.cells;
    if (told.scene && page.touchable) {
      Object.assign(page, { scene: told.scene, cells, stage: told.stage, factor: told.factor });
      page.change(() => {});
    }
    Object.assign(page.look, told.look, { camera: page.look.camera, speed: page.look.speed });
    page.picked = told.picked;
    if (page.studio && told.best > 0) page.studio.best = Number(told.best);
    if (typeof told.code === "string" && page.studio) page.studio.offer(told.code);
    if (told.scene && page.kind === "runnable") page.renew(told.g); else page.seek(told.g);
    page.setMode(page.look.mode ?? "body", true);
  } catch (error) { page.announce(page.t("linkBroken", { why: error.message })); }
}
