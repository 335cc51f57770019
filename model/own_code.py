"""What code of your own says, by which `sweep` notices that it has changed.

What runs is read, not its file: an edit counts once it is imported anew, and comments never do.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dis import get_instructions
from functools import cached_property, partial
from hashlib import blake2b
from json import dumps
from sys import modules, stdlib_module_names
from types import CodeType, FunctionType, MethodType, ModuleType, NoneType
from typing import Any

import numpy as np

from kaju.agents.parameter import Declaration

PARTS: dict[type, tuple[str, ...]] = {
    partial: ("func", "args", "keywords"),
    property: ("fget", "fset"),
    cached_property: ("func",),
    MethodType: ("__func__", "__self__"),
}
"""What holds functions, and where."""
PLAIN = (str, int, float, bool, NoneType)


def is_own(module: str | None) -> bool:
    """Tell whether a module is of neither kaju, nor Python, nor an installed package."""
    module = module or ""
    top = module.partition(".")[0]
    theirs = top == "kaju" or top in stdlib_module_names
    return not theirs and "-packages" not in (getattr(modules.get(module), "__file__", "") or "")


def without_addresses(text: str) -> str:
    """Return a text without places in memory, which are others in another process."""
    return re.sub(r" at 0x[0-9a-fA-F]+", "", text)


def own_code(of: Any) -> dict[str, str]:
    """Return digests of the classes, functions and constants of your own that a value names."""
    noted: dict[str, list[Any]] = {}
    seen: dict[int, Any] = {}  # all are kept: no other gets their place in memory

    def new(of: Any) -> bool:
        return id(of) not in seen and seen.setdefault(id(of), of) is of

    def told(of: Any) -> Any:
        """Return in texts what a value is made of; of classes and functions their names."""
        if type(of) in PLAIN:  # a sweep may have very many
            return repr(of)
        if isinstance(of, type | FunctionType):
            if is_own(of.__module__) and new(of):
                parts = kind(of) if isinstance(of, type) else function(of)
                noted.setdefault(of.__qualname__, []).append(parts)
            return f"{of.__module__}.{of.__qualname__}"
        if isinstance(of, CodeType):
            return [of.co_code.hex(), *of.co_names, told(of.co_consts)]
        if isinstance(of, Mapping):
            return [told(row) for row in of.items()]
        if isinstance(of, list | tuple):
            return [told(one) for one in of]
        if isinstance(of, set | frozenset):
            return sorted(dumps(told(one)) for one in of)
        if isinstance(of, np.ndarray):
            small = None if of.dtype.hasobject else blake2b(of.tobytes(), digest_size=8).hexdigest()
            return [small or told(of.tolist()), str(of.dtype), of.shape]
        if isinstance(inner := getattr(of, "__wrapped__", 0), FunctionType):
            return told(inner)
        if type(of) in PARTS:
            return [told(getattr(of, part)) for part in PARTS[type(of)]]
        own = all(is_own(base.__module__) for base in type(of).__mro__[:-1])
        held = getattr(of, "__dict__", 0) if own or isinstance(of, Declaration) else 0
        return [told(type(of)), without_addresses(repr(of)), told(held) if held and new(of) else 0]

    def kind(of: type) -> Any:
        parts = vars(of).items()
        held = {k: one for k, one in parts if k[:2] != "__" or isinstance(one, FunctionType)}
        return told([of.__bases__, held])

    def function(of: FunctionType) -> Any:
        codes, names = [of.__code__], set()
        for code in codes:
            codes += [one for one in code.co_consts if isinstance(one, CodeType)]
            steps = get_instructions(code)
            names |= {*code.co_names} - {s.argval for s in steps if s.opname == "STORE_GLOBAL"}
        homes = [of.__globals__]
        for home in homes:  # names of a module's attributes are among those of the code
            for name in sorted(names & home.keys()):
                one = home[name]
                if isinstance(one, ModuleType):
                    known = not is_own(one.__name__) or any(vars(one) is each for each in homes)
                    homes += [] if known else [vars(one)]
                elif (what := told(one)) and not isinstance(one, type | FunctionType):
                    rows = noted.setdefault(name, [])
                    rows += [what] * (what not in rows)
        closed: list[Any] = []
        with suppress(ValueError):  # one that is empty
            closed += [told(cell.cell_contents) for cell in of.__closure__ or ()]
        return told([of.__code__, of.__defaults__, of.__kwdefaults__, closed])

    told(of)
    texts = {name: dumps(rows).encode() for name, rows in noted.items()}
    return {name: blake2b(text, digest_size=8).hexdigest() for name, text in texts.items()}
