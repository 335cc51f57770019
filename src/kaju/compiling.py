"""Compiled loops: where they are kept, and a message when they are made.

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

from kaju.errors import needing

log = logging.getLogger("kaju")
_import_lock = RLock()  # threads that import numba at once would wait for each other without end


class Loop:
    """A function that numba compiles when it is first called, and is imported for that alone."""

    def __init__(self, function: Callable[..., Any], make: Callable[..., Any]) -> None:
        update_wrapper(self, function)
        self.py_func, self._make = function, make

    @cached_property
    def compiled(self) -> Any:
        """The function compiled; other loops that it calls are compiled first."""
        with _import_lock:
            _prepare()
            seen = self.py_func.__globals__
            for name in self.py_func.__code__.co_names:
                if isinstance(seen.get(name), Loop):
                    seen[name] = seen[name].compiled
            return self._make(self.py_func)

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        return self.compiled(*arguments)


def njit(**how: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator like numba's of this name, with its options."""

    def compile_function(function: Callable[..., Any]) -> Any:
        import numba

        # Without checks of divisors, and without an entry for C: less to be compiled.
        plain: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
        return numba.njit(**plain, **how)(function)

    return partial(Loop, make=compile_function)


part: Any = njit(fastmath=True, no_cpython_wrapper=True)
"""Decorates loops that only other loops call: an entry for Python takes long to be compiled."""

inlined: Any = njit(inline="always", fastmath=True)
"""Decorates loops called in one place by one other: they are compiled as part of that alone."""


def _along(_typing, array, start):  # type: ignore[no-untyped-def]
    """Point to an array's memory from one entry on, axis after axis.

    A slice without its checks and without reference counts, which take most of the time
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
    """Choose where compiled loops are kept, and have a message logged when they are made."""
    with needing(
        "compiled loops need numba, which a browser's Python has not: growth and bodies of "
        "more than 50,000 cells are for a Python outside; elsewhere pip install numba"
    ):
        from numba.core import event

    class Announcement(event.Listener):
        """Logs once that loops are compiled."""

        logged = False

        def on_start(self, compiling: event.Event) -> None:
            name = compiling.data["dispatcher"].py_func.__module__
            if not self.logged and name.startswith("kaju."):
                self.logged = True
                log.warning("kaju compiles its loops for this machine: once, some ten seconds")

        def on_end(self, compiling: event.Event) -> None:
            """Log nothing."""

    keep_loops_somewhere()
    event.register("numba:compile", Announcement())  # type: ignore[no-untyped-call]
