"""What can go wrong, by name.

Every error of kaju is a `KajuError` and also the builtin exception that a reader would
expect, so both ``except KajuError`` and ``except ValueError`` work. The message names the
key, the rule it breaks, the value that was given, the place, and what to do about it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from functools import wraps
from inspect import signature
from typing import Any, TypeVar

Called = TypeVar("Called", bound=Callable[..., Any])


class KajuError(Exception):
    """Base class of everything that kaju raises on purpose.

    Examples
    --------
    >>> import kaju
    >>> try:
    ...     kaju.material("stele")
    ... except kaju.KajuError as error:
    ...     print(str(error).partition(";")[0])
    ...
    material: the library has no 'stele' (did you mean 'steel'?)
    """


class ParameterError(KajuError, ValueError):
    """An argument is outside its rule (a negative size, a share above 1, a NaN)."""


class AgentError(ParameterError):
    """An agent or boundary of your own has returned something impossible."""


class SceneError(KajuError, ValueError):
    """A scene breaks a rule: an unknown key, a load outside the body, an empty body."""


class SceneFileError(SceneError, OSError):
    """A scene, image or array file cannot be read or written."""


class SupportError(SceneError):
    """A body, or a part of it, is held by nothing and would float away."""


class StabilityError(KajuError, ArithmeticError):
    """The rule would let loads grow without end."""


class ConvergenceError(KajuError, RuntimeError):
    """An iteration ended before it reached its tolerance.

    `residuals`: the relative one before every iteration; `best`: the result as far as it came, or
    None.
    """

    def __init__(self, message: str, residuals: tuple[float, ...] = (), best: object = None):
        super().__init__(message)
        self.residuals = residuals
        self.best = best


class OutOfMemoryError(KajuError, MemoryError):
    """A computation needs more memory than there is."""


class ResultError(KajuError, ValueError):
    """A result cannot answer what is asked of it."""


class ResultFileError(ResultError, OSError):
    """A result file cannot be read or written."""


class SingularPlaceError(ParameterError):
    """A stress is asked for where it has no limit."""


class MissingExtraError(KajuError, ImportError):
    """An optional package is needed; the message says how to install it."""


@contextmanager
def needing(words: str) -> Iterator[None]:
    """Say, if an import fails, what needs the package, and how it is installed."""
    try:
        yield
    except ImportError as error:
        raise MissingExtraError(words) from error


class WorkerError(KajuError, RuntimeError):
    """Processes that were to compute have died, or cannot start."""


class TangentError(KajuError, ArithmeticError):
    """Some nodes of a spring network give way: no unique small answer to a small load.

    `nodes`: names of those that move most when the network gives way, largest first; `result`: what
    was computed up to the last state that still held, or None.
    """

    def __init__(self, message: str, nodes: tuple[object, ...] = (), result: object = None):
        super().__init__(message)
        self.nodes = nodes
        self.result = result


class MechanismError(TangentError):
    """Nodes can move without any spring changing its length: springs or supports are missing."""


class BucklingError(TangentError):
    """The pressed springs let nodes slip sideways: the network buckles or turns inside out."""


def check_type(name: str, value: object, form: Any) -> None:
    """Refuse an argument that is not of a type, texts that are no Unicode among them."""
    from pydantic import TypeAdapter, ValidationError

    try:
        TypeAdapter(form).validate_python(value, strict=True)
        if isinstance(value, str):
            value.encode()
    except ValidationError as error:
        rule = error.errors()[0]["msg"].replace("Input should", "should")
        raise ParameterError(f"{name}: {rule}, got {brief(value)}") from None
    except UnicodeEncodeError as error:
        raise ParameterError(f"{name}: {brief(value)} is no text ({error.reason})") from None


def require(holds: bool, rule: str) -> None:
    """Raise a `ParameterError` that says which rule an argument breaks, unless it holds."""
    if not holds:
        raise ParameterError(rule)


def takes(function: Callable[..., object], *arguments: object) -> bool:
    """Tell whether a function can be called so; of compiled ones it is not known, and is yes."""
    try:
        signature(function).bind(*arguments)
    except (TypeError, ValueError) as error:
        return isinstance(error, ValueError)
    return True


def brief(value: object) -> str:
    """Return how a value is written, cut to what a message bears."""
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:79]}…"


def suggestion(name: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """Return " (did you mean 'steel'?)" if a known name is spelt much like `name`, else ""."""
    known, low = list(known), name.lower()
    cut_short = [one for one in known if len(low) > 2 and one.startswith(low)]  # tol, res
    near = get_close_matches(low, known, n=1, cutoff=cutoff) or cut_short
    return f" (did you mean {near[0]!r}?)" if near else ""


def no_such(what: str, name: object, known: Collection[str]) -> str:
    """Return "there is no side 'tpo' (did you mean 'top'?); there is left, right …"."""
    near = suggestion(str(name), known)
    return f"there is no {what}{near}; there is {', '.join(known) or 'none'}"


def unknown(name: str, whose: str, known: Iterable[str], meant: str = "") -> ParameterError:
    """Return the error of an argument that something does not take; it says which is meant."""
    near, known = suggestion(meant or name, known), ", ".join(known) or "none"
    return ParameterError(f"{name}: {whose} has no such argument{near}; there is {known}")


def by_name(function: Called) -> Called:
    """Let a function refuse keywords that it does not take by saying which is meant."""
    known = [name for name in signature(function).parameters if name != "self"]
    whose = function.__qualname__.removesuffix(".__init__")

    @wraps(function)
    def called(*args: Any, **kwargs: Any) -> Any:
        for name in kwargs:
            if name not in known:
                raise unknown(name, whose, known)
        return function(*args, **kwargs)

    return called  # type: ignore[return-value]
