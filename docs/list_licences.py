"""Write docs/licences.md: what kaju asks for, and under which licence that is.

`python docs/list_licences.py`, with all extras installed; what is missing keeps its line.
"""

import re
import tomllib
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

HERE = Path(__file__).parent
HEAD = """# Licences

kaju is under the MIT licence, and brings no code of others. What it asks for (in brackets: for
which extra) is installed from elsewhere, under these licences, as each package states its own
(`python docs/list_licences.py` writes this list).

| licence | packages |
|---|---|
"""
WORDS = {
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD",
    "GNU General Public License v3 (GPLv3)": "GPL-3.0",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
}


def licence_of(name: str) -> str:
    """Return the licence that an installed package states."""
    told = metadata(name)
    expression = (told.get_all("License-Expression") or [""])[0]
    if expression:
        return str(expression)
    classes = [text for text in told.get_all("Classifier") or [] if text.startswith("License ::")]
    found = [text.rpartition(" :: ")[2] for text in classes]
    found = [WORDS.get(text, text) for text in found if text != "OSI Approved"]
    short = str((told.get_all("License") or ["unstated"])[0]).strip().splitlines()[0]
    return ", ".join(found) or short[:60]


def asked_for() -> dict[str, str]:
    """Return by package what it is needed for."""
    project = tomllib.loads((HERE.parent / "pyproject.toml").read_text())["project"]
    groups = {"everything": project["dependencies"], **project["optional-dependencies"]}
    needs: dict[str, list[str]] = {}
    for group, texts in groups.items():
        for text in texts:
            name = re.split(r"[^\w.-]", text)[0]
            needs.setdefault(name, []).append(group)
    needs.pop("kaju", None)
    return {name: ", ".join(groups) for name, groups in sorted(needs.items())}


def main() -> None:
    """Write the list."""
    page = HERE / "licences.md"
    before = {
        name: licence
        for licence, packages in re.findall(r"^\| ([^|]+) \| (`.*) \|$", page.read_text(), re.M)
        for name in re.findall(r"`([^`]+)`", packages)
    }
    rows: dict[str, list[str]] = {}
    for name, groups in asked_for().items():
        try:
            licence = licence_of(name)
        except PackageNotFoundError:
            licence = before.get(name, "unknown")
        needed = "" if groups == "everything" else f" ({groups})"
        rows.setdefault(licence, []).append(f"`{name}`{needed}")
    lines = [f"| {licence} | {', '.join(names)} |\n" for licence, names in sorted(rows.items())]
    page.write_text(HEAD + "".join(lines))


if __name__ == "__main__":
    main()
