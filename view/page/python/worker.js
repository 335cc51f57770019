// In the worker: Brython, kaju's agents in plain Python, and a pupil's code. Nothing of it reaches a network.
const py = __BRYTHON__, post = postMessage.bind(globalThis), lineNoted = py.set_lineno;
for (const name of ["log", "warn", "error", "debug", "info"]) console[name] = () => {};
let line = 0, beat = 0, every = false, steps = 0;
py.set_lineno = (frame, at, type) => {
  if (frame.__file__?.endsWith("#agent")) {
    line = at;
    if (every || Date.now() - beat > 200) { beat = Date.now(); post({ line, steps }); }
  }
  return lineNoted(frame, at, type);
};
globalThis.tick = () => {                      // an agent acts
  steps++;
  if (Date.now() - beat > 200) { beat = Date.now(); post({ line, steps }); }
};
globalThis.lineNow = () => line;
py.runPythonSource(ENGINE, { id: "kaju" });
py.builtins.print = globalThis.show;
for (const [id, code] of Object.entries(OFFERED)) py.runPythonSource(code, { id });
for (const name of ["fetch", "XMLHttpRequest", "WebSocket", "EventSource", "WebTransport", "importScripts", "indexedDB", "caches", "BroadcastChannel", "Worker", "SharedWorker", "postMessage"]) {
  try { Object.defineProperty(globalThis, name, { value: name === "postMessage" ? post : undefined, writable: false, configurable: false }); } catch { /* it has none */ }
}
post({ ready: true });
const namesOf = (error) => { try { return py.class_name(error); } catch { return error.name ?? "Error"; } };
onmessage = ({ data: { code, body, lines } }) => {
  line = 0; every = lines; beat = Date.now();
  try {
    const module = py.runPythonSource(code, { id: "agent" });
    globalThis.play(py.builtins.vars ? py.builtins.vars(module) : module.dict, body);
  } catch (error) {
    const args = error.args ? Array.from(error.args, String) : [String(error.message ?? error)];
    post({ error: namesOf(error), args, line: error.lineno ?? (line || 1) });
  }
};
