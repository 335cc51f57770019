"""Strict descriptions: one validator for files and for Python, one voice for its errors.

Every part of a scene is a frozen pydantic model derived from `Described`. Whatever it
refuses is told as a `SceneError` with key path, rule, value and meaning of the key,
whether the part came from a file or from Python.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from re import findall
from typing import TYPE_CHECKING, Annotated, Any, get_args

import numpy as np
from pydantic import (
    AllowInfNan,
    BaseModel,
    ConfigDict,
    Field,
    Strict,
    ValidationError,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from kaju.agents.materials import suggestion
from kaju.errors import ParameterError, SceneError

Number = Annotated[float, Strict(), AllowInfNan(False)]
Coordinate = Annotated[Number, Field(ge=-1e12, le=1e12)]
Length = Annotated[Number, Field(gt=0.0, le=1e12)]
Positive = Annotated[Number, Field(gt=0.0)]
Count = Annotated[int, Strict(), Field(gt=0)]
Index = Annotated[int, Strict(), Field(ge=-(2**62), le=2**62)]
Text = Annotated[str, Strict()]
Flag = Annotated[bool, Strict()]

_PHRASES = {
    "missing": "is needed",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "string_type": "must be a text",
    "bool_type": "must be true or false",
    "finite_number": "must be finite",
    "greater_than": "must be above {gt:g}",
    "greater_than_equal": "must be {ge:g} or more",
    "less_than_equal": "must be {le:g} or less",
    "literal_error": "must be {expected}",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "too_long": "must have at most {max_length} entries",
    "too_short": "must have at least {min_length} entries",
}


if TYPE_CHECKING:  # the metaclass of pydantic's models has no public name
    _Told = BaseModel
else:

    class _Telling(type(BaseModel)):
        """Tells in kaju's words why a description could not be made.

        Parts within parts are validated without coming by here: the outermost tells of them all.
        """

        def __call__(cls, *unnamed: Any, **values: Any) -> Any:
            if unnamed:
                raise ParameterError(
                    f"{cls.__name__}: its parts are given by name ({', '.join(cls.model_fields)}), "
                    f"got {unnamed[0]!r:.80}; kaju.load_scene(path) reads a scene from a file"
                )
            try:
                return super().__call__(**values)
            except ValidationError as error:
                raise translated(cls, error) from None

    class _Told(BaseModel, metaclass=_Telling):
        """A description whose errors are told so."""


class Described(_Told):
    """Base of every part of a scene's description: frozen, strict, with kaju's errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys_plain_values(cls, values: Any) -> Any:
        """Refuse unknown keys; take NumPy's scalars and short arrays for numbers and lists."""
        if not isinstance(values, Mapping):
            return values
        for key in values:
            if key not in cls.model_fields:
                known = f"known are {', '.join(cls.model_fields)}"
                told = f"unknown key{suggestion(str(key), cls.model_fields)}; {known}"
                raise PydanticCustomError("unknown_key", "{told}", {"key": str(key), "told": told})
        return {key: _plain(value) for key, value in values.items()}


def optional(meaning: str) -> Any:
    """Return the default of a key that may be left out; errors tell its meaning."""
    return Field(default=None, description=meaning)


def one_given(described: Described, names: tuple[str, ...], told: str) -> str:
    """Return which one of some keys is given; `told` begins what is said of none or several."""
    given = [name for name in names if getattr(described, name) is not None]
    if len(given) != 1:
        raise ParameterError(f"{told} {', '.join(names)}; got {', '.join(given) or 'none'}")
    return given[0]


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray) and value.ndim < 3 and 0 < value.size <= 64:
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value


def translated(description: type[BaseModel], error: ValidationError) -> SceneError:
    """Return a pydantic error in kaju's words, of the narrowest kaju class that fits."""
    problems = error.errors()
    causes = [problem.get("ctx", {}).get("error") for problem in problems]
    lines = [
        _line(description, problem, cause) for problem, cause in zip(problems, causes, strict=True)
    ]
    kind = type(causes[0]) if len(causes) == 1 and isinstance(causes[0], SceneError) else SceneError
    if len(lines) == 1:
        return kind(lines[0])
    return kind("\n".join([f"{len(lines)} problems:", *(f"  {line}" for line in lines)]))


def _line(description: type[BaseModel], problem: ErrorDetails, cause: object) -> str:
    path = [str(part) for part in problem["loc"]]
    trail = list(_trail(description, problem["loc"]))
    key = ".".join(path)
    if isinstance(cause, ValueError):
        # a ParameterError names the parameter first, which completes the key path
        joint = "." if isinstance(cause, ParameterError) else ": "
        return f"{key}{joint}{cause}" if key else str(cause)
    if problem["type"] == "unknown_key":
        return f"{'.'.join([*path, problem['ctx']['key']])}: {problem['ctx']['told']}"
    context = problem.get("ctx", {})
    phrase = _PHRASES.get(problem["type"])
    rule = phrase.format(**context) if phrase else problem["msg"]
    given = "" if problem["type"] == "missing" else f", got {_short(problem['input'])}"
    if problem["type"] == "literal_error":
        given += suggestion(str(problem["input"]), findall(r"'([^']*)'", context["expected"]))
    return f"{key}: {rule}{given}{_meaning(trail, problem['loc'])}"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _trail(description: type[BaseModel], path: tuple[int | str, ...]) -> Iterator[type[BaseModel]]:
    """Yield the descriptions that a key path passes through."""
    yield description
    for key in path[:-1]:
        field = description.model_fields.get(str(key))
        inner = _description_in(field.annotation) if field else None
        if inner is not None:
            description = inner
            yield description


def _description_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    found = (_description_in(part) for part in get_args(annotation))
    return next((part for part in found if part is not None), None)


def _meaning(trail: list[type[BaseModel]], path: tuple[int | str, ...]) -> str:
    for key in reversed(path):
        field = trail[-1].model_fields.get(str(key))
        if field is not None and field.description:
            return f"; {key} is {field.description}"
    return ""
