// Python behind a channel: the page asks for generations, packed pieces come back one by one.
import { bytesOf, Recorded, unpack } from "./history.js";
import { MotionPage } from "./motion.js";
import { mount } from "./open.js";
import { takeElastic } from "./answer.js";

const AT_ONCE = 64, AHEAD = 8;                 // generations in one answer; ahead of what is played
const MOST_NUMBERS = 5e7;                      // of all frames in the page's memory

/** One question on its way at a time; what is asked meanwhile waits, and only the last counts. */
export class Channel {
  constructor(page, send) { Object.assign(this, { page, send, wanted: 0, every: 1, most: MOST_NUMBERS, busy: false, next: null, elastic: false }); }
  /** Ask for what has happened up to a generation. */
  want(g) { this.wanted = g; this.ask(); }
  /** Ask for the elastic answer. */
  solve() { this.elastic = true; this.ask(); }
  /** Begin anew with another scene. */
  change(scene, cells, stage) {
    let text = "";
    for (const cell of cells) text += String.fromCharCode(cell & 255, cell >> 8 & 255);
    const { run, g } = this.page, generation = run.atRest ? AT_ONCE : Math.min(run.generation, 1000);
    this.wanted = g >= run.generation ? generation : g;
    const parameters = Object.fromEntries((this.page.own?.parameters ?? []).map(({ name, value }) => [name, value]));
    this.next = { type: "scene", scene, cells: btoa(text), stage, generation, ...(this.page.own ? { parameters } : {}) };
    this.page.given = {};
    this.ask();
  }
  ask() {
    if (this.busy) return;
    const { run, playing } = this.page, missing = this.wanted + (playing ? AHEAD : 0) - run.generation;
    const question = this.next ?? (this.elastic ? { type: "elastic" } : null)
      ?? (missing > 0 && !run.atRest ? { type: "step", generations: Math.min(missing, AT_ONCE), every: this.every } : null);
    if (!question) return;
    if (question === this.next) this.next = null;
    this.solving = question.type === "elastic";
    if (this.solving) this.elastic = false;
    this.busy = true;
    this.send(question);
  }
  async heard(bytes) {
    const { page } = this, { header, columns } = await unpack(bytes);
    this.busy = false;
    if (this.solving) { takeElastic(page, header, columns); this.ask(); return; }
    if ((columns.offset || columns.born) && !this.next) this.take(header, columns);   // else it is out of date
    if (!header.error) { this.ask(); return; }
    this.wanted = page.run.generation;
    page.playing = false;
    complain(page, header.error);
  }
  take(header, columns) {
    const { page } = this, { g } = page;
    if (page.curveList) this.takeFrames(header, columns);
    else {
      const run = header.fresh ? new Recorded(page.scene, page.cells, page.stage) : page.run;
      run.append(columns);
      if (header.fresh) page.adopt(run); else page.scales.clear();
      if (header.certificate && !this.next) { page.given = header.certificate; page.certify(); }
      page.curves = null;
    }
    page.run.atRest = header.at_rest;
    page.goTo(page.playing ? g : Math.min(this.wanted, page.run.generation));
    page.later();
  }
  /** Frames of agents on faces; when they are too many, every second is forgotten, and steps double. */
  takeFrames({ fresh, at, visits, outcome, curves }, columns) {
    const { page } = this, { fields, count } = page;
    if (fresh) {
      Object.assign(page, { at: [], visits: [], moved: [], scales: new Map() });
      for (const name in fields) fields[name] = [];
      for (const curve of page.curveList) { curve.at = []; for (const name in curve.lines) curve.lines[name] = []; }
    }
    page.at.push(...at); page.visits.push(...visits);
    for (const name in fields) fields[name].push(...page.framesOf(columns[`value ${name}`], count));
    page.moved.push(...page.framesOf(columns.moved, count * page.dimension));
    page.born = columns.born;
    curves.forEach((news, n) => {
      const curve = page.curveList[n];
      curve.at.push(...news.at);
      for (const name in curve.lines) curve.lines[name].push(...news.lines[name]);
    });
    if (page.at.length * count * 4 > this.most) {
      const half = (list) => list.filter((_, i) => i % 2 === 0 || i === list.length - 1);
      Object.assign(page, { at: half(page.at), visits: half(page.visits), moved: half(page.moved), scales: new Map(), g: page.g >> 1 });
      for (const name in fields) fields[name] = half(fields[name]);
      this.every *= 2;
      if (this.wanted < Infinity) this.wanted = this.wanted >> 1;
    }
    page.run.generation = page.at.length - 1;
    page.outcome = outcome; page.certify();
  }
}

/** Say what went wrong where the certificate stands. */
export const complain = (page, text) => page?.tellVerdict(text, false);

/** A page whose run is computed elsewhere: `send` takes a question, `listen` a listener for answers. */
export async function connect(element, base64, send, listen) {
  const { header, columns } = await unpack(bytesOf(base64)), { cells } = columns;
  let page;
  if (header.scene) {
    const run = Object.assign(new Recorded(header.scene, cells), { atRest: false });
    page = mount(element, { ...header, cells, run, presets: [] });
  } else page = mount(element, { ...header, columns }, MotionPage);
  page.channel = new Channel(page, send);
  listen((bytes) => page.channel.heard(bytes));
  page.channel.busy = true;
  page.channel.wanted = 1;
  send({ type: "hello" });
  return page;
}
