"""Check a built site: python docs/check_site.py site. Every link, frame and anchor leads somewhere.

Nothing may be asked from outside either: pages are read without a network too.
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LEFT_OUT = {"webpack-macros.html"}


class Links(HTMLParser):
    """What a page names: its anchors, its links, and what it loads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect."""
        given = dict(attrs)
        self.anchors |= {given[name] or "" for name in ("id", "name") if name in given}
        if tag == "a" and given.get("href"):
            self.links.append(given["href"] or "")
        loads = given.get("src") or (given.get("href") if tag == "link" else None)
        if loads and not loads.startswith("data:"):
            self.loaded.append(loads)


def faults_of(site: Path) -> list[str]:
    """Return what is wrong with a built site, a line each."""
    pages = {p: Links(p.read_text()) for p in site.rglob("*.html") if p.name not in LEFT_OUT}
    found = []
    for path, page in pages.items():
        here = path.relative_to(site)
        found += [f"{here}: loads {name} from outside" for name in page.loaded if "//" in name]
        for link in [*page.links, *(name for name in page.loaded if "//" not in name)]:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            if not target.exists():
                found.append(f"{here}: {link} leads nowhere")
            elif (
                parts.fragment
                and target in pages
                and "pages" not in (path.parent.name, target.parent.name)
            ):  # there it says how to open
                known = unquote(parts.fragment) in pages[target].anchors
                found += [] if known else [f"{here}: {link} names no anchor"]
    return found


if __name__ == "__main__":
    faults = faults_of(Path(sys.argv[1]).resolve())
    print(*faults, sep="\n")
    sys.exit(1 if faults else 0)
