"""Cut a release: check the tree, date the changelog and the citation, commit and tag.

python tools/release.py 0.2.0           # pushing is up to you
python tools/release.py --notes 0.2.0   # print the changelog's section of a version
python tools/release.py --lessons 0.2.0 # pack the lessons' pages into kaju-lessons-0.2.0.zip
"""

from __future__ import annotations

import argparse
import datetime
import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
VERSIONED = {
    "src/kaju/__init__.py": r'(__version__ = ")[^"]+(")',
    "CITATION.cff": r"(?m)^(version: )\S+()",
}
"""Where the version stands, between two groups."""


def git(*arguments: str) -> str:
    """Return what git says."""
    done = subprocess.run(["git", *arguments], cwd=ROOT, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def notes_of(version: str) -> str:
    """Return the changelog's section of a version."""
    text = (ROOT / "CHANGELOG.md").read_text()
    found = re.search(rf"^## {re.escape(version)}\b.*?\n(.*?)(?=^## |\Z)", text, re.M | re.S)
    if not found:
        sys.exit(f"CHANGELOG.md: there is no section {version}")
    return found[1].strip()


def pack_lessons(version: str) -> None:
    """Make the lessons' pages, and pack them into one file that a teacher unpacks and opens."""
    with TemporaryDirectory() as folder:
        subprocess.run([sys.executable, ROOT / "docs" / "make_pages.py", folder], check=True)
        print("packed into", shutil.make_archive(f"kaju-lessons-{version}", "zip", folder))


def cut(version: str) -> None:
    """Write the version everywhere, commit, and tag."""
    if not re.fullmatch(r"\d+\.\d+\.\d+", version):
        sys.exit(f"{version}: a version is three numbers, such as 0.2.0")
    if git("status", "--porcelain"):
        sys.exit("the tree has changes that are not committed")
    if f"v{version}" in git("tag").split():
        sys.exit(f"v{version}: is a tag already")
    today = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    changelog = ROOT / "CHANGELOG.md"
    text = changelog.read_text()
    if "## Unreleased\n" not in text:
        sys.exit("CHANGELOG.md: nothing stands under Unreleased")
    text = text.replace("## Unreleased\n", f"## Unreleased\n\n## {version} ({today})\n", 1)
    changelog.write_text(text)
    for name, pattern in VERSIONED.items():
        path = ROOT / name
        changed, count = re.subn(pattern, rf"\g<1>{version}\g<2>", path.read_text(), count=1)
        if count != 1:
            sys.exit(f"{name}: says no version")
        if name == "CITATION.cff":
            changed = re.sub(r"date-released: \S+", f"date-released: {today}", changed)
        path.write_text(changed)
    git("add", "CHANGELOG.md", *VERSIONED)
    git("commit", "-m", f"Release {version}")
    git("tag", "-a", f"v{version}", "-m", f"kaju {version}")
    print(f"committed and tagged v{version}; to publish: git push --follow-tags")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("version")
    parser.add_argument("--notes", action="store_true", help="print its changelog, change nothing")
    parser.add_argument("--lessons", action="store_true", help="pack the lessons, change nothing")
    asked = parser.parse_args()
    if asked.notes:
        print(notes_of(asked.version))
    elif asked.lessons:
        pack_lessons(asked.version)
    else:
        cut(asked.version)
