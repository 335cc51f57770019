"""Mutation testing: change one thing in a rule, the ledger, an operator or a bound; who notices?

`python tests/mutants.py [COUNT] [SEED]` draws COUNT mutants of every file below (6 unless given),
runs the tests of its room against each, and writes tests/data/mutants.json: how many were killed,
and who survived. `again` instead of numbers runs only the survivors of the record, after tests were
added; `named` runs those of NAMED, which once survived.

Each mutant lives in a forked process that compiles the changed source in place of the file, so
nothing on the disk changes. None of these files is compiled by numba, whose cache would not see it.
"""

import ast
import copy
import importlib
import json
import os
import signal
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
from time import monotonic

import numpy as np
import pytest

HERE = Path(__file__).parent
RECORD = HERE / "data" / "mutants.json"
SECONDS = 240
"""After which a mutant that does not end counts as killed."""

ROOMS = {
    "agents/rules.py": "trust/test_survivors.py transfer/test_agents.py "
    "transfer/test_stability.py "
    "transfer/test_hexagon_shares.py scene/test_scene_errors.py transfer/test_load_model.py",
    "agents/shares.py": "transfer/test_agents.py transfer/test_hexagon_shares.py "
    "transfer/test_sense.py transfer/test_own_lattice.py",
    "model/transfer/stage.py": "transfer/test_hexagon_shares.py trust/test_survivors.py "
    "transfer/test_own_agents.py transfer/test_load_model.py",
    "model/transfer/stability.py": "trust/test_survivors.py transfer/test_hexagon_shares.py "
    "transfer/test_stability.py",
    "model/elastic/staggered.py": "elasticity/test_e_twins.py elasticity/test_e_tables.py "
    "elasticity/test_e_solve.py trust/test_survivors.py",
    "model/elastic/moduli.py": "elasticity/test_e_twins.py elasticity/test_e_solve.py "
    "trust/test_survivors.py",
    "model/elastic/balanced.py": "bounds/test_bracket.py",
    "model/elastic/compatible.py": "bounds/test_bracket.py",
    "model/elastic/bracket.py": "bounds/test_bracket.py",
    "model/elastic/volume_field.py": "bounds/test_bracket_work.py",
}
NAMED = {
    "friction on hexagons": (
        "model/scene/lattice.py", "float(c == nearest), 1.0", "1.0, 1.0",
        "transfer/test_hexagon_shares.py",
    ),
    "handed less entered": (
        "model/transfer/stage.py", "handed - entered, 0.0", "0.0",
        "transfer/test_hexagon_shares.py",
    ),
    "a remedy for hexagons": (
        "model/transfer/stability.py", "sum(each.poisson for each in way)", "beside",
        "transfer/test_hexagon_shares.py",
    ),
    "moments made up for": (
        "model/elastic/loads.py", "np.where(turn, 0.5, 1.0) * share",
        "np.where(turn, 0.5, 0.5) * share", "trust/test_survivors.py",
    ),
    "share of the surface": (
        "model/elastic/fields.py", "SURFACE_SHARE = 0.5", "SURFACE_SHARE = 0.3",
        "elasticity/test_e_result.py",
    ),
    "the algebraic part": (
        "model/elastic/spawning/generations.py", "float(np.hypot(error, algebraic))", "error",
        "trust/test_survivors.py",
    ),
    "helpless agents": (
        "model/elastic/spawning/aims.py", "allowed - helpless if helpless < allowed else allowed",
        "allowed", "elasticity/test_e_result.py",
    ),
    "crossed jumps": (
        "model/elastic/spawning/field.py", "np.where(crossed, 0.5 * ratio - 0.5, second)", "second",
        "trust/test_survivors.py",
    ),
    "the meter": (
        "model/elastic/settling/state.py", "sqrt(total / work)", "0.5 * sqrt(total / work)",
        "elasticity/test_e_result.py",
    ),
    "the bound of waves": (
        "model/elastic/settling/stability.py", "max(4.0, 2.0 * volume.max())", "4.0",
        "trust/test_survivors.py",
    ),
    "a blocked face": (
        "model/scene/refinement.py", "f / len(body) for f", "f / len(children) for f",
        "trust/test_survivors.py",
    ),
}  # fmt: skip


OTHER = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.And: ast.Or, ast.Or: ast.And,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
CALLS = {"max": "min", "min": "max", "sin": "cos", "cos": "sin", "any": "all", "all": "any"}


def changed(node):
    """Return what else could stand there, or None."""
    twin = copy.deepcopy(node)
    if isinstance(node, (ast.BinOp, ast.BoolOp)) and type(node.op) in OTHER:
        twin.op = OTHER[type(node.op)]()
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in OTHER:
        twin.ops[0] = OTHER[type(node.ops[0])]()
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not, ast.Invert)):
        return twin.operand
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        twin.value = node.value + 1 if type(node.value) is int else 2.0 * node.value + 0.1
    elif isinstance(node, ast.Call) and getattr(node.func, "attr", None) in CALLS:
        twin.func.attr = CALLS[node.func.attr]
    elif isinstance(node, ast.Call) and getattr(node.func, "id", None) in CALLS:
        twin.func.id = CALLS[node.func.id]
    else:
        return None
    return twin


def places(tree):
    """Yield (parent, field, index, node) of whatever computes something."""
    skipped = (ast.Raise, ast.JoinedStr, ast.AnnAssign, ast.arg)
    for parent in ast.walk(tree):
        for field, value in ast.iter_fields(parent):
            if field in ("annotation", "returns", "decorator_list", "slice", "bases"):
                continue
            for index, node in enumerate(value if isinstance(value, list) else [value]):
                if isinstance(node, ast.AST) and not isinstance(parent, skipped):
                    yield parent, field, index if isinstance(value, list) else None, node


def inside_words(tree):
    """Return the nodes of error messages and annotations, which no rule depends on."""
    words = set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.Raise, ast.JoinedStr)):
            words |= {id(part) for part in ast.walk(node)}
        for part in (getattr(node, "annotation", None), getattr(node, "returns", None)):
            words |= {id(each) for each in ast.walk(part)} if part is not None else set()
    return words


def mutants(text, count, rng):
    """Return drawn mutants of a source: where, what, and the source."""
    tree = ast.parse(text)
    words = inside_words(tree)
    found = [p for p in places(tree) if id(p[3]) not in words and changed(p[3]) is not None]
    drawn = []
    for number in sorted(rng.choice(len(found), min(count, len(found)), replace=False)):
        parent, field, index, node = found[number]
        was = ast.unparse(node)
        twin = ast.copy_location(changed(node), node)

        def put(value, parent=parent, field=field, index=index):
            if index is None:
                setattr(parent, field, value)
            else:
                getattr(parent, field)[index] = value

        put(twin)
        drawn.append((f"line {node.lineno}: {was} -> {ast.unparse(twin)}", ast.unparse(tree)))
        put(node)
    return drawn


def survives(path, source, tests):
    """Run tests against a source that takes the place of a file; tell whether all pass."""
    child = os.fork()
    if child == 0:
        os.setsid()
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        usual = SourceFileLoader.get_code

        def get_code(self, name):
            if Path(self.path).resolve() == path:
                return compile(source, str(path), "exec")
            return usual(self, name)

        SourceFileLoader.get_code = get_code
        options = ["-x", "-q", "-p", "no:cacheprovider", "-m", "not slow", "-W", "ignore"]
        code = 2
        try:
            code = int(pytest.main([*options, *tests]))
        finally:
            os._exit(code)
    began = monotonic()
    while monotonic() - began < SECONDS:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status) == 0
        signal.sigtimedwait([signal.SIGCHLD], 0.2)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def main(arguments):
    """Draw, run, and write the record."""
    for name in ("scipy.sparse.linalg", "numba", "pandas", "hypothesis", "mesa", "pydantic"):
        importlib.import_module(name)  # once, and not in every fork
    root = HERE.parent
    os.chdir(root)
    if arguments[:1] == ["named"]:
        asked = arguments[1:] or list(NAMED)
        for name in asked:
            file, old, new, tests = NAMED[name]
            text = (root / file).read_text()
            if text.count(old) != 1:
                raise SystemExit(f"{name}: {old!r} does not stand once in {file}")
            paths = [str(HERE / test) for test in tests.split()]
            lives = survives((root / file).resolve(), text.replace(old, new), paths)
            print(f"{'SURVIVED' if lives else 'killed':9} {name}", flush=True)
        return
    again = arguments[:1] == ["again"]
    record = json.loads(RECORD.read_text()) if again else {"count": 6, "seed": 13, "files": {}}
    if not again:
        record |= dict(zip(("count", "seed"), map(int, arguments), strict=False))
    rng = np.random.default_rng(record["seed"])
    for file, tests in ROOMS.items():
        paths = [str(HERE / test) for test in tests.split()]
        drawn = mutants((root / file).read_text(), record["count"], rng)
        tried = [told for told, _ in drawn]
        if again:
            tried = record["files"][file]["survived"]
        alive = [
            told
            for told, text in drawn
            if told in tried and survives((root / file).resolve(), text, paths)
        ]
        record["files"][file] = {"mutants": len(drawn), "survived": alive}
        print(file, len(drawn), alive, flush=True)
        total = sum(each["mutants"] for each in record["files"].values())
        killed = total - sum(len(each["survived"]) for each in record["files"].values())
        record |= {"mutants": total, "killed": killed}
        RECORD.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
