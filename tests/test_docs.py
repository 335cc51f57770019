"""What the pages show is what the code does."""

import ast
import re
from pathlib import Path

import pytest
from parsed_sources import parsed

from kaju import Scene

ROOT = Path(__file__).parents[1]
PAGES = (
    sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")]) if (ROOT / "docs").is_dir() else []
)
SCENES = [
    pytest.param(text, id=f"{page.stem}-{number}")
    for page in PAGES
    for number, text in enumerate(re.findall(r"```toml\n(.*?)```", page.read_text(), re.DOTALL))
]


@pytest.mark.parametrize("text", SCENES)
def test_every_scene_that_is_shown_loads(text):
    scene = Scene.from_toml(text)
    assert scene.outlined or len(scene.applied().force) > 0


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_link_and_picture_is_there(page):
    links = re.findall(r"\]\(([^)#]+)\)", page.read_text())
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert not missing


def test_every_message_that_is_explained_is_one_of_the_package():
    said = {
        node.value
        for tree in parsed().values()
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    rows = re.findall(r"^\| (`.*?`) \|", (ROOT / "docs" / "when-it-says-no.md").read_text(), re.M)
    told = [text for row in rows for text in re.findall("`(.*?)`", row)]
    assert len(told) > 15
    for text in told:
        for piece in re.split(r"'\w+'|\d+", text):
            assert any(piece.strip() in message for message in said), text
