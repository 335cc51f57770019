"""What the pages show is what the code does."""

import re
from pathlib import Path

import pytest

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
