// In the worker: Brython, kaju's agents, and a pupil's code. Nothing of it reaches a network.
const py = __BRYTHON__, post = postMessage.bind(globalThis), noted = py.set_lineno, MOST_ROWS = 2e6, MOST = 4000;
for (const name of ["log", "warn", "error", "debug", "info"]) console[name] = () => {};
let line = 0, beat = 0, every = false, steps = 0;
const live = () => { if (Date.now() - beat > 200) { beat = Date.now(); post({ line, steps }); } };
py.set_lineno = (frame, at, type) => {
  if (frame[2] === "agent") {
    line = at;
    if (every) beat = 0;
    live();
  } else if (frame[0] === "step") { steps++; live(); }   // an agent acts
  return noted(frame, at, type);
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
  const [numbers, states, classes] = python.begin(names.dict ?? py.builtins.vars(names), py.structuredclone2pyobj(run.told(parameters)));
  if (!warming) post({ declares: { states, names: classes, parameters: numbers.map(([name, label, low, high, value, whole]) => ({ name, label, low, high, value, whole })) } });
  run.begin(python, states);
  while (!run.over && run.generation < MOST && run.taken.n < MOST_ROWS && Date.now() < until) { run.step(); steps++; live(); }
  return run.shown;
}
/** What has run some times runs ten times as fast, the first of a pupil's too. */
let warmed = 0;
const warm = (data) => { if (warmed++ < 15) { beat = Infinity; play(data); setTimeout(warm, 0, data); } };
onmessage = ({ data }) => {
  if (data.warming) { warm(data); return; }
  line = 0; every = data.lines; beat = Date.now(); warmed = Infinity;
  try { post(play(data)); } catch (raised) {
    const error = raised.__cause__?.args ? raised.__cause__ : raised, args = error.args ? Array.from(error.args, String) : [String(error.message ?? error)];
    post({ error: namesOf(error), args, line: lineOf(error, args) });
  }
};
