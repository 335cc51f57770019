"""Nothing in a file or scene is run as code, and nothing goes over the network unasked."""

import ast
import os
import subprocess
import sys

import pytest
from parsed_sources import HOME, parsed

CODE = {"eval", "exec", "compile", "__import__"}
FROM_ELSEWHERE = {
    "pickle", "marshal", "shelve", "cloudpickle", "dill", "joblib", "socket", "ssl", "ftplib",
    "urllib", "urllib3", "requests", "httpx", "aiohttp", "http", "smtplib", "telnetlib",
}  # fmt: skip
KNOWN = {
    # Jobs between the processes of one user's own sweep.
    ("model/study/sweep.py", "joblib"),
}


def modules_of(node):
    if isinstance(node, ast.Import):
        return {alias.name.partition(".")[0] for alias in node.names}
    if isinstance(node, ast.ImportFrom) and not node.level:
        return {(node.module or "").partition(".")[0]}
    return set()


def test_no_code_is_made_and_nothing_is_fetched():
    found = set()
    for path, tree in parsed().items():
        for node in ast.walk(tree):
            found |= {(path.as_posix(), name) for name in modules_of(node) & FROM_ELSEWHERE}
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                in_page = path.as_posix() == "view/page/python/play.py"  # its reader's own code
                assert in_page or node.func.id not in CODE, f"{path}:{node.lineno}"
            if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
                assert isinstance(node.value, ast.Constant), path
                assert node.value.value is False, path
    assert found == KNOWN


OFFLINE = """
import sys
def refuse(event, _):
    if event.startswith(("socket.", "urllib.", "http.", "ftplib.", "smtplib.")):
        raise SystemExit(f"the network was asked: {event}")
sys.addaudithook(refuse)
import kaju, kaju.cli
sys.argv = ["kaju", "demo", "--no-pictures", "--out", "demo"]
try:
    kaju.cli.main()
except SystemExit as end:
    assert not end.code, end.code
scene = kaju.load_scene(sys.argv[-1] + "/../plate.toml")
found = kaju.solve(scene, tolerance=0.1)
kaju.plot(found).savefig("plot.png")
kaju.export_page(kaju.load_result("demo"), "page.html")
print("done")
"""


@pytest.mark.slow
def test_no_network_is_needed(tmp_path):
    (tmp_path / "plate.toml").write_text((HOME / "plate.toml").read_text())
    run = subprocess.run(
        [sys.executable, "-c", OFFLINE],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={**os.environ, "MPLBACKEND": "agg"},
    )
    assert run.stdout.endswith("done\n"), run.stderr[-800:]
