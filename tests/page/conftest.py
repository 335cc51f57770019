"""Programs that the page's tests need: node for its modules, chromium for the page itself."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

import kaju.view.page

PAGE = Path(kaju.view.page.__file__).parent


@pytest.fixture(scope="session")
def node(tmp_path_factory):
    """Run a script beside the page's modules: node(script, data) -> what it printed, as JSON."""
    program = shutil.which("node")
    if program is None:
        pytest.skip("node is not installed (apt-get install nodejs)")
    folder = tmp_path_factory.mktemp("modules")
    for module in [*PAGE.glob("*.js"), PAGE / "package.json"]:
        shutil.copy(module, folder)

    def run(script, data=None):
        (folder / "data.json").write_text(json.dumps(data))
        (folder / "script.js").write_text(
            'import { readFileSync } from "node:fs";\n'
            'const data = JSON.parse(readFileSync(new URL("data.json", import.meta.url)));\n'
            "const tell = (value) => console.log(JSON.stringify(value));\n" + script
        )
        done = subprocess.run(
            [program, folder / "script.js"], capture_output=True, text=True, timeout=300
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run
