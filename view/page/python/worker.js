// In the worker: Brython, kaju's agents, and a pupil's code. Nothing of it reaches a network.
const py = __BRYTHON__, post = postMessage.bind(globalThis), noted = py.set_lineno, MOST_ROWS = 2e6, MOST = 4000;
for (const name of ["log", "warn", "error", "debug", "info"]) console[name] = () => {};
let line = 0, lines = {}, beat = 0, every = false, steps = 0;
const live = () => { if (Date.now() - beat > 200) { beat = Date.now(); post({ line, steps }); } };
py.set_lineno = (frame, at, type) => {
  if (frame[2] === "agent") {
    line = at; lines[frame[0]] = at;
    if (every) beat = 0;
    live();
  } else if (frame[0] === "step") { steps++; live(); }   // an agent acts
  return noted(frame, at, type);
};
// Brython searches a class for all that its instances are asked for. What they hold themselves, plain methods, items of lists and of
// dictionaries, and super() are had at once, all else as before; so an agent acts in half the time.
let looked = [];
const { DICT, NULL, OB_TYPE, builtins } = py, { dict, object, super: parent } = builtins, { $getattr_pep657: asked, call_attr: called, $setattr: assigned, $getitem: got, $setitem: put, unpacker } = py;
const [GET, SET] = ["__getitem__", "__setitem__"].map((name) => py.search_in_mro(dict, name, NULL));
/** What instances of a class find in it under a name. */
function inClass(kind, name) {
  if (!kind.known) { kind.known = new Map(); looked.push(kind); }
  let found = kind.known.get(name);
  if (found === undefined) kind.known.set(name, found = py.search_in_mro(kind, name, NULL));
  return found;
}
/** What an instance holds itself; nothing of a class. */
const ownOf = (of) => (of?.tp_name === undefined && of?.ob_type?.tp_mro ? of[DICT] : undefined), isPlain = (of, own, name) => own?.hasOwnProperty(name) && inClass(of.ob_type, name) === NULL;
py.$getattr_pep657 = (of, name, inum) => { const own = ownOf(of); return isPlain(of, own, name) ? own[name] : asked(of, name, inum); };
py.$setattr = (of, name, value) => {
  const own = ownOf(of);
  if (isPlain(of, own, name) && of.ob_type.tp_setattro === object.tp_setattro) { own[name] = value; return builtins.None; }
  if (of?.tp_name !== undefined) { for (const kind of looked) kind.known = null; looked = []; }   // a class has changed
  return assigned(of, name, value);
};
py.call_attr = (of, name, inum, ...args) => {
  let found, self = of;
  if (of?.ob_type === parent) {
    const { type, obj, obj_type: { tp_mro: line } } = of;
    found = line?.slice(line.indexOf(type) + 1).find((kind) => kind[DICT]?.hasOwnProperty(name))?.[DICT][name]; self = obj;
  } else { const own = ownOf(of); if (own && !own.hasOwnProperty(name)) found = inClass(of.ob_type, name); }
  if (found?.ob_type !== py.function) return called(of, name, inum, ...args);
  try { return found(self, ...args); } catch (error) { py.set_inum(inum); throw error; }
};
py.$getitem = (of, item, inum) => {
  if (Array.isArray(of) && typeof item === "number" && item >= 0 && item < of.length && of.ob_type) return of[item];
  const kind = of?.[OB_TYPE];
  if (!kind || (kind !== dict && inClass(kind, "__getitem__") !== GET)) return got(of, item, inum);
  try { return dict.$getitem(of, item); } catch (error) { py.set_inum(inum); throw error; }
};
py.$setitem = (of, item, value, inum) => { const kind = of?.[OB_TYPE]; return kind && inClass(kind, "__setitem__") === SET ? dict.$setitem(of, item, value) : put(of, item, value, inum); };
class Unpacked { constructor(of) { this.of = of; this.index = -1; } read_one() { return this.of[++this.index]; } }
py.unpacker = (of, count, starred, ...rest) => (!starred && Array.isArray(of) && of.ob_type && of.length === count ? new Unpacked(of) : unpacker(of, count, starred, ...rest));
parent.$factory = (...given) => {
  const own = py.frame_obj?.frame[1], obj = own?.self, type = own?.ob_type;
  if (given.length || !type?.tp_mro || !obj?.ob_type?.tp_mro?.includes(type)) return builtins.type.tp_call(parent, ...given);
  const made = { ob_type: parent, type, obj, obj_type: obj.ob_type };
  py.init_dict(made);
  return made;
};
py.runPythonSource(ENGINE, { id: "kaju" });
const python = Object.fromEntries(["begin", "generation", "totals"].map((name) => [name, globalThis[name]]));
globalThis.tell = (print) => post({ print, at: line });
py.builtins.print = globalThis.show;
for (const [id, code] of Object.entries(OFFERED)) py.runPythonSource(code, { id });
for (const name of ["fetch", "XMLHttpRequest", "WebSocket", "EventSource", "WebTransport", "importScripts", "indexedDB", "caches", "BroadcastChannel", "Worker", "SharedWorker", "postMessage"]) {
  try { Object.defineProperty(globalThis, name, { value: name === "postMessage" ? post : undefined, writable: false, configurable: false }); } catch { /* it has none */ }
}
post({ ready: true });
const namesOf = (error) => { try { return py.class_name(error); } catch { return error.name ?? "Error"; } };
/** The last line of the pupil's on the way to an error; Python counts one on where it meets an indent. */
function lineOf(error, args) {
  let found = error.lineno ? error.lineno - (args[0] === "unexpected indent") : 0;
  for (let at = error.__traceback__; at?.tb_frame; at = at.tb_next) if (at.tb_frame[2] === "agent" && !error.lineno) found = at.tb_lineno;
  return found || line || 1;
}
/** Run the classes of a code on a scene. */
function play({ code, scene, cells, stage, parameters, warming }) {
  const run = new Written(scene, cells, stage), names = py.runPythonSource(code, { id: "agent" }), until = warming ? Date.now() + 100 : Infinity;
  const [numbers, states, classes, spare] = python.begin(names.dict ?? py.builtins.vars(names), py.structuredclone2pyobj(run.told(parameters)));
  if (!warming) post({ declares: { states, names: classes, spare, parameters: numbers.map(([name, label, low, high, value, whole]) => ({ name, label, low, high, value, whole })) } });
  run.begin(python, states);
  while (!run.over && run.generation < MOST && run.taken.n < MOST_ROWS && Date.now() < until) { run.step(); steps++; live(); }
  return { ...run.shown, grew: run.grown ? lines.emissions ?? lines.pass_on ?? lines.take ?? 0 : 0 };   // a line that lets more go than came
}
/** What has run some times runs ten times as fast, the first of a pupil's too. */
let warmed = 0;
const warm = (data) => { if (warmed++ < 15) { beat = Infinity; play(data); setTimeout(warm, 0, data); } };
onmessage = ({ data }) => {
  if (data.warming) { warm(data); return; }
  line = 0; lines = {}; every = data.lines; beat = Date.now(); warmed = Infinity;
  try { post(play(data)); } catch (raised) {
    const error = raised.__cause__?.args ? raised.__cause__ : raised, args = error.args ? Array.from(error.args, String) : [String(error.message ?? error)];
    post({ error: namesOf(error), args, line: lineOf(error, args) });
  }
};
