"""Where in a TOML text a key stands, so that an error can name its line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

_HEADER = re.compile(r"\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?$")
_ENTRY = re.compile(r"\s*([\w.\"' -]+?)\s*=")
_MESSAGE = re.compile(r"^(\s*)([\w -]+(?:\.[\w -]+)*): ")


def with_lines(text: str, message: str, changed: Iterable[str] = ()) -> str:
    """Return an error's lines, each with the text's line of its key path, unless that changed."""
    places = dict(_places(text))
    for path in changed:
        places.pop(path, None)
    lines = []
    for line in message.splitlines():
        found = _MESSAGE.match(line)
        path = found[2] if found else ""
        while path and path not in places:
            path = path.rpartition(".")[0]
        indent = found[1] if found else ""
        lines.append(f"{indent}line {places[path]}: {line[len(indent) :]}" if path else line)
    return "\n".join(lines)


def _places(text: str) -> Iterator[tuple[str, int]]:
    """Yield every key path with the number of its line; list items are counted from 0."""
    head, items, open_quotes = "", dict[str, int](), ""
    for number, line in enumerate(text.splitlines(), start=1):
        if open_quotes:
            open_quotes = "" if open_quotes in line else open_quotes
            continue
        for quotes in ('"""', "'''"):
            if line.count(quotes) % 2:
                open_quotes = quotes
        header = _HEADER.match(line)
        if header:
            head = _unquoted(header[2])
            if header[1] == "[[":
                items[head] = items.get(head, -1) + 1
                head = f"{head}.{items[head]}"
            yield head, number
            continue
        entry = _ENTRY.match(line)
        if entry:
            key = _unquoted(entry[1])
            yield (f"{head}.{key}" if head else key), number


def _unquoted(key: str) -> str:
    return ".".join(part.strip().strip("\"'") for part in key.split("."))
