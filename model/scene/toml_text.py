"""Tables as TOML that people like to read: numbers of a list on one line, drawings upright."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

_OWN_SECTIONS = ("materials", "rule")  # tables in these get a section, in others a line


def dumps(table: Mapping[str, Any]) -> str:
    """Return a scene's table as TOML text."""
    blocks: list[str] = []
    for name, part in table.items():
        blocks.extend(_blocks(_key(name), part))
    return "\n".join(blocks)


def _blocks(name: str, part: Any) -> Iterator[str]:
    """Yield a section and the sections inside it."""
    if isinstance(part, list):
        for item in part:
            yield f"[[{name}]]\n{_lines(item)}"
        return
    own = {key: value for key, value in part.items() if not _is_section(name, value)}
    if own:
        yield f"[{name}]\n{_lines(own)}"
    for key, value in part.items():
        if key not in own:
            yield from _blocks(f"{name}.{_key(key)}", value)


def _is_section(name: str, value: Any) -> bool:
    if isinstance(value, Mapping):
        return name.split(".")[-1] in _OWN_SECTIONS
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _lines(table: Mapping[str, Any]) -> str:
    return "".join(f"{_key(key)} = {_value(value)}\n" for key, value in table.items())


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{_key(key)} = {_value(part)}' for key, part in value.items())}}}"
    import tomli_w

    written = tomli_w.dumps({"value": value}, multiline_strings=True)
    return written.removeprefix("value = ").removesuffix("\n")
