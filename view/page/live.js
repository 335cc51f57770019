// Python behind a channel: the page asks for generations, packed pieces come back one by one.
import { bytesOf, Recorded, unpack } from "./history.js";
import { mount } from "./open.js";

const AT_ONCE = 64, AHEAD = 8;                 // generations in one answer; ahead of what is played

/** One question on its way at a time; what is asked meanwhile waits, and only the last counts. */
export class Channel {
  constructor(page, send) { Object.assign(this, { page, send, wanted: 0, busy: false, next: null }); }
  /** Ask for what has happened up to a generation. */
  want(g) {
    this.wanted = g;
    this.ask();
  }
  /** Begin anew with another scene. */
  change(scene, cells, stage) {
    let text = "";
    for (const cell of cells) text += String.fromCharCode(cell & 255);
    const { run, g } = this.page, generation = run.atRest ? AT_ONCE : Math.min(run.generation, 1000);
    this.wanted = g >= run.generation ? generation : g;
    this.next = { type: "scene", scene, cells: btoa(text), stage, generation };
    this.page.given = {};
    this.ask();
  }
  ask() {
    if (this.busy) return;
    const { run, playing } = this.page, missing = this.wanted + (playing ? AHEAD : 0) - run.generation;
    const question = this.next
      ?? (missing > 0 && !run.atRest ? { type: "step", generations: Math.min(missing, AT_ONCE) } : null);
    this.next = null;
    if (!question) return;
    this.busy = true;
    this.send(question);
  }
  async heard(bytes) {
    const { page } = this, { header, columns } = await unpack(bytes);
    this.busy = false;
    if (columns.offset && !this.next) this.take(header, columns);   // else it is out of date
    if (!header.error) { this.ask(); return; }
    this.wanted = page.run.generation;
    page.playing = false;
    complain(page, header.error);
  }
  take(header, columns) {
    const { page } = this;
    if (header.fresh) page.adopt(new Recorded(page.scene, page.cells, page.stage));
    page.run.append(columns);
    page.run.atRest = header.at_rest;
    if (header.at_rest && page.run.passed) page.adopt(page.run);
    if (header.certificate && !this.next) { page.given = header.certificate; page.certify(); }
    page.scales.clear();
    page.curves = null;
    if (!page.playing) page.goTo(Math.min(this.wanted, page.run.generation));
    page.later();
  }
}

/** Say what went wrong where the certificate stands. */
export function complain(page, text) {
  if (!page) return;
  const { verdict } = page.parts;
  verdict.textContent = text; verdict.hidden = false;
  verdict.classList.add("bad");
}

/** A page whose run is computed elsewhere: `send` takes a question, `listen` a listener for answers. */
export async function connect(element, base64, send, listen, elastic = null) {
  const { header, columns: { cells } } = await unpack(bytesOf(base64));
  const run = new Recorded(header.scene, cells);
  run.atRest = false;
  const page = mount(element, { ...header, cells, run, presets: [], elastic });
  page.channel = new Channel(page, send);
  listen((bytes) => page.channel.heard(bytes));
  page.channel.busy = true;
  page.channel.wanted = 1;
  send({ type: "hello" });
  return page;
}
