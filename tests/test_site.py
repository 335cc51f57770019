"""What the site is made of: lists that are whole, links that lead somewhere, one version."""

import re
from pathlib import Path

import pytest
from scripts import script

import kaju

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
pytestmark = pytest.mark.skipif(not DOCS.is_dir(), reason="the documents are not here")


def test_lists_are_made_when_the_site_is_built(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    commands = script(DOCS / "made_lists.py").with_lists((DOCS / "commands.md").read_text())
    assert "<!-- made" not in commands
    for name in ("## kaju solve", "`--tolerance`", "## kaju sweep", "`--samples`"):
        assert name in commands


def test_every_public_name_is_in_the_reference():
    listed = re.findall(r"^   (\w+)$", (DOCS / "reference.md").read_text(), re.M)
    assert sorted(listed) == sorted(set(kaju.__all__) - {"__version__"})


def test_every_lesson_is_in_the_list_and_in_the_menu():
    text = (DOCS / "teach.md").read_text()
    for path in (DOCS / "lessons").glob("*.md"):
        assert f"(lessons/{path.name})" in text
        assert f"\nlessons/{path.stem}\n" in text


def test_the_version_is_told_once():
    lines = (ROOT / "CITATION.cff").read_text().splitlines()
    assert {"cff-version: 1.2.0", f"version: {kaju.__version__}"} <= set(lines)
