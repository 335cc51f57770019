#!/usr/bin/env node
// kaju in a browser's Python, under node: in-pyodide WHEEL, beside node_modules/pyodide.
// Where NumPy's build for it cannot be fetched, this says so and leaves the rest out.
import { readFileSync } from "node:fs";
import { basename, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const { loadPyodide } = await import(pathToFileURL(resolve("node_modules/pyodide/pyodide.mjs")));
const wheel = process.argv[2], python = await loadPyodide(), quiet = { messageCallback() {}, errorCallback() {} };
console.log("Python", python.runPython("import platform; platform.python_version()"), "in Pyodide");
try {
  await python.loadPackage(["numpy", "scipy", "pandas", "matplotlib", "networkx", "pydantic", "pillow", "micropip"], quiet);
  python.runPython("import numpy, scipy");
} catch {
  console.log("left out: NumPy's build for Pyodide cannot be fetched here");
  process.exit(0);
}
python.FS.writeFile(`/${basename(wheel)}`, readFileSync(wheel));
await python.runPythonAsync(`
import micropip
await micropip.install("emfs:/${basename(wheel)}")
import kaju
plate = kaju.Scene(
    body={"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"},
    sides={"bottom": "rigid"}, loads=[{"cell": [10, 19], "force": [0.0, -2.0]}],
)
assert len(kaju.LoadModel(plate).run().last.cells) == 34
kaju.solve(plate.replace(rule=kaju.ElasticRule()), tolerance=0.1)
kaju.export_page(plate, "/page.html")
`);
console.log("agents, answers with tolerances and pages run");
