"""Photograph the page of the worked plate (needs Debian's chromium).

Run from the repository's root: ``python docs/draw_page.py``. Writes docs/pictures/page.png.
"""

import shutil
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from kaju import export_page, load_scene

ROOT = Path(__file__).parents[1]
BROWSER = ("--no-sandbox", "--disable-gpu")
PLACE = (0.365, 0.26)
"""Of the agent that is clicked, as shares of the window."""


def main() -> None:
    """Play the plate to its end, click an agent, and take the picture."""
    chromium = shutil.which("chromium")
    if chromium is None:
        sys.exit("chromium is not installed (apt-get install chromium)")
    scene = load_scene(ROOT / "examples" / "plate.toml")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as player:
        page_file = export_page(scene, Path(folder) / "plate.html", title="A steel plate")
        browser = player.chromium.launch(executable_path=chromium, args=list(BROWSER))
        tab = browser.new_page(viewport={"width": 1280, "height": 720})
        tab.goto(page_file.as_uri())
        tab.wait_for_timeout(1000)
        tab.keyboard.press("End")
        tab.mouse.click(1280 * PLACE[0], 720 * PLACE[1])
        tab.wait_for_timeout(1000)
        target = ROOT / "docs" / "pictures" / "page.png"
        tab.screenshot(path=target)
        browser.close()
    print(target)


if __name__ == "__main__":
    main()
