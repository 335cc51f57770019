"""Compiled loops: where they are kept, and a word when they are made.

Numba compiles a loop when it is first called and keeps it on disk, beside the source or in the
user's cache; after installation the first answer therefore takes some seconds longer.
"""

from __future__ import annotations

import atexit
import logging
import os
import shutil
import tempfile
from collections.abc import Callable
from functools import cache, cached_property, partial, update_wrapper
from pathlib import Path
from threading import RLock
from typing import Any

__all__ = ["along", "inlined", "njit", "part"]

log = logging.getLogger("kaju")
_one_at_a_time = RLock()
"""Threads that import numba at once would wait for each other without end."""


class Loop:
    """A function that numba compiles when it is first called, and is imported for that alone."""

    def __init__(self, function: Callable[..., Any], make: Callable[..., Any]) -> None:
        update_wrapper(self, function)
        self.py_func, self._make = function, make

    @cached_property
    def compiled(self) -> Any:
        """What numba made of it; it sees other loops as what numba made of these."""
        with _one_at_a_time:
            _prepare()
            seen = self.py_func.__globals__
            for name in self.py_func.__code__.co_names:
                if isinstance(seen.get(name), Loop):
                    seen[name] = seen[name].compiled
            return self._make(self.py_func)

    def __call__(self, *arguments: Any) -> Any:
        return self.compiled(*arguments)


def njit(**how: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator like numba's of this name, with its options."""
    return partial(Loop, make=partial(_compile, how))


_PLAIN: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
"""Without checks of divisors, and without a door for C: less to be compiled."""


def _compile(how: dict[str, Any], function: Callable[..., Any]) -> Any:
    import numba

    return numba.njit(**_PLAIN, **how)(function)


part: Any = njit(fastmath=True, no_cpython_wrapper=True)
"""Decorates loops that only other loops call: the doors for Python take long to be compiled."""

inlined: Any = njit(inline="always", fastmath=True)
"""Decorates loops that one other calls, in one place: they are compiled as part of that alone."""


def _along(_typing, array, start):  # type: ignore[no-untyped-def]
    """Point to an array's memory from one entry on, axis after axis.

    A slice without its checks and without a count of who holds it, which take most of the time
    that loops over many rows need to be compiled. Only for arrays that outlive it.
    """
    from numba import types

    pointer = types.CPointer(array.dtype)  # type: ignore[no-untyped-call]

    def build(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        whole = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.gep(whole.data, [arguments[1]])

    return pointer(array, types.intp), build


def _intrinsic(function: Callable[..., Any]) -> Any:
    from numba.extending import intrinsic

    return intrinsic(function)


along: Any = Loop(_along, _intrinsic)


def writable(folder: Path) -> bool:
    """Tell whether files can be written into a folder (made if need be)."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def keep_loops_somewhere() -> None:
    """Keep compiled loops in a folder of this session's own where no other can be written.

    Numba refuses to keep them where neither the installation nor the home can be written.
    """
    from numba import config as _config

    config: Any = _config
    home = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    beside = Path(__file__).parent / "__pycache__"
    if config.CACHE_DIR or writable(beside) or writable(Path(home) / "numba"):
        return
    config.CACHE_DIR = tempfile.mkdtemp(prefix="kaju-loops-")
    atexit.register(shutil.rmtree, config.CACHE_DIR, ignore_errors=True)


@cache
def _prepare() -> None:
    """Say where compiled loops are kept, and have a word said when they are made."""
    from numba.core import event

    class Teller(event.Listener):
        """Say once that loops are compiled."""

        def __init__(self) -> None:
            self.told = False

        def on_start(self, compiling: event.Event) -> None:
            name = compiling.data["dispatcher"].py_func.__module__
            if not self.told and name.startswith("kaju."):
                self.told = True
                log.warning("kaju compiles its loops for this machine: once, some ten seconds")

        def on_end(self, compiling: event.Event) -> None:
            """Nothing is to be said."""

    keep_loops_somewhere()
    event.register("numba:compile", Teller())  # type: ignore[no-untyped-call]
