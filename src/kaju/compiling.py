"""Compiled loops: how numba makes them, where it keeps them, and a message when it does.

Numba compiles a loop when it is first called and keeps it on disk, beside the source or in the
user's cache; after installation the first answer therefore takes some seconds longer. Only modules
that hold loops import this one, and these are imported where an answer needs them: small answers
never import numba.
"""

from __future__ import annotations

import atexit
import logging
import shutil
import tempfile
from functools import partial
from typing import Any

from kaju.errors import needing

with needing(
    "kaju's compiled loops need numba: pip install numba. Python in a browser does not have it: "
    "there growth and bodies of more than 10,000 cells cannot be computed"
):
    import numba
    from numba import types
    from numba.core import event
    from numba.extending import intrinsic

log = logging.getLogger("kaju")

# Without checks of divisors, and without an entry for C: less to be compiled.
njit: Any = partial(numba.njit, error_model="numpy", no_cfunc_wrapper=True)
"""Decorates loops, with numba's options."""

part: Any = njit(fastmath=True, no_cpython_wrapper=True)
"""Decorates loops that only other loops call: an entry for Python takes long to be compiled."""

inlined: Any = njit(inline="always", fastmath=True)
"""Decorates loops called in one place by one other: they are compiled as part of that alone."""


def _along(_typing, array, start):  # type: ignore[no-untyped-def]
    """Point to an array's memory from one entry on, axis after axis.

    A slice without its checks and without reference counts, which take most of the time
    that loops over many rows need to be compiled. Only for arrays that outlive it.
    """
    pointer = types.CPointer(array.dtype)  # type: ignore[no-untyped-call]

    def build(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        whole = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.gep(whole.data, [arguments[1]])

    return pointer(array, types.intp), build


along: Any = intrinsic(_along)


def keep_loops_somewhere() -> None:
    """Keep compiled loops in a folder of this session's own where no other can be written."""
    try:  # which numba refuses where neither the installation nor the home can be written
        numba.njit(cache=True)(keep_loops_somewhere)
    except RuntimeError:
        folder = tempfile.mkdtemp(prefix="kaju-loops-")
        numba.config.CACHE_DIR = folder  # type: ignore[attr-defined]
        atexit.register(shutil.rmtree, folder, ignore_errors=True)


class _Announcement(event.Listener):
    """Logs once that loops are compiled."""

    logged = False

    def on_start(self, compiling: event.Event) -> None:
        """Log a message for the first of kaju's own loops."""
        name = compiling.data["dispatcher"].py_func.__module__
        if not self.logged and name.startswith("kaju."):
            self.logged = True
            log.warning("kaju compiles its loops for this machine: once, some ten seconds")

    def on_end(self, compiling: event.Event) -> None:
        """Log nothing."""


keep_loops_somewhere()
event.register("numba:compile", _Announcement())  # type: ignore[no-untyped-call]
