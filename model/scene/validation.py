"""Strict descriptions, for files and for Python alike.

Every part of a scene is a frozen pydantic model derived from `Described`. Whatever it
refuses is a `SceneError` with key path, rule, value and meaning of the key.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import numpy as np
import pydantic
from pydantic import BaseModel, Field, Strict, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from kaju.errors import ParameterError, SceneError, brief, require, suggestion

Number = Annotated[float, Strict(), pydantic.AllowInfNan(False)]
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

_SAME = {
    **{"e": "youngs_modulus", "young": "youngs_modulus", "modulus": "youngs_modulus"},
    **{"nu": "poissons_ratio", "poisson": "poissons_ratio", "rho": "density"},
    **{"diameter": "radius", "r": "radius", "center": "centre"},
    **{"f": "force", "p": "pressure", "dx": "cell_size", "h": "cell_size", "t": "thickness"},
    **{"moment": "couple", "torque": "couple", "circle": "disk", "box": "region"},
    **dict.fromkeys(("support", "supports", "boundary", "boundaries", "constraints"), "sides"),
}
"""What others call a key."""


if TYPE_CHECKING:  # the metaclass of pydantic's models has no public name
    _Model = BaseModel
else:

    class _SceneErrors(type(BaseModel)):
        """Turns pydantic's errors into a `SceneError`, once for a part and all parts within it."""

        def __call__(cls, *unnamed: Any, **values: Any) -> Any:
            if unnamed:
                raise ParameterError(
                    f"{cls.__name__}: its parts are given by name ({', '.join(cls.model_fields)}), "
                    f"got {brief(unnamed[0])}; kaju.load_scene(path) reads a scene from a file"
                )
            try:
                return super().__call__(**values)
            except ValidationError as error:
                raise _scene_error(cls, error) from None

    class _Model(BaseModel, metaclass=_SceneErrors):
        """A pydantic model whose errors are scene errors."""


class Described(_Model):
    """Base of every part of a scene's description: frozen, strict, with kaju's errors."""

    model_config = pydantic.ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

    @pydantic.model_validator(mode="before")
    @classmethod
    def _known_keys_plain_values(cls, values: Any) -> Any:
        """Refuse unknown keys; take NumPy's scalars and short arrays for numbers and lists."""
        if not isinstance(values, Mapping):
            return values
        for key in values:
            if key not in cls.model_fields:
                meant = _SAME.get(str(key).lower())
                half = ", half of it" if key == "diameter" else ""
                meant = f" (did you mean {meant!r}{half}?)" if meant in cls.model_fields else ""
                meant = meant or suggestion(str(key), cls.model_fields)
                text = f"unknown key{meant or '; known are ' + ', '.join(cls.model_fields)}"
                raise PydanticCustomError("unknown_key", "{text}", {"key": str(key), "text": text})
        return {key: plain(value) for key, value in values.items()}


def optional(meaning: str) -> Any:
    """Return the default of a key that may be left out; errors tell its meaning."""
    return Field(default=None, description=meaning)


def built_by(table: Any, made: type, forms: str) -> pydantic.PlainValidator:
    """Return the validator of a value that is made, or is the `table` that builds it."""

    def build(value: Any) -> Any:
        if isinstance(value, made):
            return value
        if not isinstance(value, Mapping):
            raise ValueError(f"must be {forms}, got {value!r}")
        return table.model_validate(value).build()

    return pydantic.PlainValidator(build)


def one_given(described: Described, names: tuple[str, ...], rule: str) -> str:
    """Return the only one of some keys that is given; `rule` begins the error if it is not one."""
    given = [name for name in names if getattr(described, name) is not None]
    require(len(given) == 1, f"{rule} {', '.join(names)}; got {', '.join(given) or 'none'}")
    return given[0]


def check_axes(numbers: Sequence[float], dimension: int, where: str, what: str = "numbers") -> None:
    """Refuse numbers that are not one for each axis."""
    if len(numbers) != dimension:
        raise SceneError(
            f"{where}: {list(numbers)} should have {dimension} {what}, one for each axis of the "
            "cells"
        )


def plain(value: Any, most: float = 64) -> Any:
    """Return a value in Python's own numbers, lists and tables, all of them new.

    Arrays of more than `most` numbers stay arrays.
    """
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray) and 0 < value.size <= most:
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, (list, tuple)):
        return [plain(item, most) for item in value]
    if isinstance(value, Mapping):
        return {key: plain(part, most) for key, part in value.items()}
    return value


def key_path(path: str) -> str:
    """Return a key path with dots only: ``loads[0].force[1]`` is ``loads.0.force.1``."""
    return re.sub(r"\[(\d+)\]", r".\1", path)


def _scene_error(description: type[BaseModel], error: ValidationError) -> SceneError:
    """Return a pydantic error in kaju's words, of the narrowest kaju class that fits."""
    problems = error.errors()
    lines = [_line(description, problem) for problem in problems]
    if len(lines) > 1:
        return SceneError("\n".join([f"{len(lines)} problems:", *(f"  {each}" for each in lines)]))
    cause = problems[0].get("ctx", {}).get("error")
    return (type(cause) if isinstance(cause, SceneError) else SceneError)(lines[0])


def _line(description: type[BaseModel], problem: ErrorDetails) -> str:
    path = [str(part) for part in problem["loc"]]
    key, context = ".".join(path), problem.get("ctx", {})
    cause = context.get("error")
    if isinstance(cause, ValueError):
        # a ParameterError names the parameter first, which completes the key path
        joint = "." if isinstance(cause, ParameterError) else ": "
        return f"{key}{joint}{cause}" if key else str(cause)
    if problem["type"] == "unknown_key":
        return f"{'.'.join([*path, context['key']])}: {context['text']}"
    phrase = _PHRASES.get(problem["type"])
    rule = phrase.format(**context) if phrase else problem["msg"]
    given = "" if problem["type"] == "missing" else f", got {brief(problem['input'])}"
    if path[-1:] in (["loads"], ["regions"]) and isinstance(problem["input"], Mapping):
        given += f"; write [[{key}]], with two brackets, for each"
    if problem["type"] == "literal_error":
        given += suggestion(str(problem["input"]), re.findall(r"'([^']*)'", context["expected"]))
    return f"{key}: {rule}{given}{_meaning(description, problem['loc'])}"


def _meaning(description: type[BaseModel], path: tuple[int | str, ...]) -> str:
    """Return the meaning of the last key of a path that its description explains."""
    meaning = ""
    for key in path:
        if (field := description.model_fields.get(str(key))) is None:
            continue
        meaning = f"; {key} is {field.description}" if field.description else ""
        description = _description_in(field.annotation) or description
    return meaning


def _description_in(annotation: Any) -> type[BaseModel] | None:
    """Return the description in a type such as ``tuple[Region, ...] | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    found = (_description_in(part) for part in get_args(annotation))
    return next((part for part in found if part is not None), None)


# TOML texts: what is wrong with one, and where a key stands, so that errors can name its line.

SLIPS = {
    r"=\s*([+-]?\d+,\d+)\s*[,}\n#]": "numbers have a point, no comma",
    r"([+-]?\d+,0\d[\d.]*)": "numbers have no comma between thousands",
    r"(\b\d[\d.e+-]*\s*([mck]?m|[kM]?N|[kMG]?Pa|kg|%)(?!\w))": "numbers have no units",
    r"=\s*((?!true|false|inf|nan)[^\W\d]\w*)\s*[,}\n#]": "texts are in quotes",
}
"""What is looked for in a line that is no TOML, and what is said of it."""
_UNCLOSED = "a list lacks its ] at the end, or a comma between two entries"
_BROKEN = {
    _UNCLOSED: ("Unclosed array",),
    "a table lacks its } at the end, or a comma between two entries": ("Unclosed inline table",),
    "a text lacks the quotes at its end": ("Illegal character '\\n'", "Unterminated string"),
    "write \\ in a path as /": ("Unescaped '\\'", "Invalid hex value"),
    "a line is KEY = VALUE, [TABLE], [[TABLE]] or # COMMENT": ("Expected '='", "Invalid statement"),
    "a table's name ends in as many brackets as it begins with": ("Expected ']",),
    "it is given twice; only [[TABLE]], such as [[loads]], may be": (
        *("Cannot overwrite", "Cannot declare", "Duplicate inline"),
    ),
    "after a value there may only be a comment, # ...": ("Expected newline",),
    "a value is a number, a text in quotes, true, false, [LIST] or {TABLE}": ("Invalid value",),
}
"""What to do, and how the reader's messages begin."""


def read_toml(text: str) -> dict[str, Any]:
    """Return the table in a TOML text; an error quotes the line, and says what it lacks."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
    except RecursionError:
        raise SceneError("is not a scene: its lists are nested too deeply") from None
    except ValueError:  # of Python, for whole numbers of thousands of digits
        raise SceneError("is not a scene: a number has too many digits; write 1e9, say") from None
    lines = text.splitlines()
    place = re.search(r"line (\d+), column (\d+)", message)
    number, before = (int(place[1]), int(place[2]) - 1) if place else (len(lines), len(lines[-1]))
    told = next((told for told, begin in _BROKEN.items() if message.startswith(begin)), message)
    if message.startswith(("Unclosed", "Invalid value")):
        # What is missed where a line begins is missing at the end of the last one.
        while number > 1 and not lines[number - 1][:before].partition("#")[0].strip():
            number, before = number - 1, len(lines[number - 2])
            told = _UNCLOSED if message.startswith("Invalid value") else told
    line = lines[number - 1].strip()
    entry = f"{line.partition('#')[0]}\n"
    told = next((said for slip, said in SLIPS.items() if re.search(slip, entry)), told)
    raise SceneError(f"line {number} is not valid TOML: {told}; got {line:.80}")


def with_lines(text: str, message: str, changed: Container[str] = ()) -> str:
    """Return an error's lines, each with the text's line of its key path, unless that changed."""
    places = {path: line for path, line in _places(text) if path not in changed}
    lines, sources = [], text.splitlines()
    for line in message.splitlines():
        found = re.match(r"\s*([\w -]+(?:\.[\w -]+)*): ", line)
        path = found[1] if found else ""
        while path and path not in places:
            path = path.rpartition(".")[0]
        if path and re.search(r"\d,\d+,\s+-?\d+,\d", sources[places[path] - 1]):
            line += "; numbers have a point, no comma: 0.2"
        lines.append(re.sub(r"(?=\S)", f"line {places[path]}: ", line, count=1) if path else line)
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
        if header := re.match(r"\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?$", line):
            head = _unquoted(header[2])
            if header[1] == "[[":
                if head not in items:
                    yield head, number
                items[head] = items.get(head, -1) + 1
                head = f"{head}.{items[head]}"
            yield head, number
            continue
        if entry := re.match(r"\s*([\w.\"' -]+?)\s*=", line):
            key = _unquoted(entry[1])
            yield (f"{head}.{key}" if head else key), number


def _unquoted(key: str) -> str:
    return ".".join(part.strip().strip("\"'") for part in key.split("."))
