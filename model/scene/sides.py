"""What lies beyond the sides of the array."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, model_validator

from kaju.agents.materials import suggestion
from kaju.errors import SceneError
from kaju.model.scene import cell_types
from kaju.model.scene.validation import Described, Index, Number, Positive, optional

_KINDS = {
    "free": cell_types.AIR,
    "rigid": cell_types.RIGID,
    "roller": cell_types.ROLLER,
    "foundation": cell_types.FOUNDATION,
    "displaced": cell_types.DISPLACED,
}
_WORDS = ("free", "rigid", "roller")
_SAME = dict.fromkeys(("fixed", "clamped", "pinned", "encastre", "ground", "built-in"), "rigid")
_SAME |= dict.fromkeys(("symmetry", "symmetric", "slider", "sliding"), "roller")
"""What others call them."""
_FREELY = "free"
_FORMS = 'a side is "free", "rigid", "roller", {stiffness = N/m³} or {displacement = [m, m]}'


def _sliding(displacement: Any) -> dict[str, Any]:
    """Return a displacement in numbers, and the axes whose number is the word "free"."""
    if not isinstance(displacement, (list, tuple)):
        return {}
    free = [axis for axis, value in enumerate(displacement) if value == _FREELY]
    return {
        "displacement": [0.0 if value == _FREELY else value for value in displacement],
        **({"free_axes": free} if free else {}),
    }


class SideCondition(Described):
    """How one side of the array is held.

    In a scene it is written as a word, "free", "rigid" or "roller", or as a table,
    ``{stiffness = 1e9}`` or ``{displacement = [0.0, -1e-4]}``.
    """

    kind: Literal["free", "rigid", "roller", "foundation", "displaced"] = Field(
        default="free", description="a word for what lies beyond the side"
    )
    stiffness: Positive | None = optional("the pressure per displacement of an elastic bed (N/m³)")
    displacement: tuple[Number, ...] | None = optional(
        "what the side is moved by (m), one number per axis"
    )
    free_axes: tuple[Index, ...] = Field(
        default=(), description="the axes along which a moved side lets the body slide"
    )
    """As a roller does: all of the side's own. A scene writes "free" in place of their numbers,
    ``{displacement = ["free", -1e-4]}``."""

    @model_validator(mode="before")
    @classmethod
    def _from_short_form(cls, value: Any) -> Any:
        if isinstance(value, str):
            if value not in _WORDS:
                meant = f" (did you mean {_SAME[value]!r}?)" if value in _SAME else ""
                meant = meant or suggestion(value, _WORDS)
                raise ValueError(f"there is no {value!r}{meant}; {_FORMS}")
            return {"kind": value}
        if isinstance(value, Mapping) and "kind" not in value:
            if "stiffness" in value:
                return {"kind": "foundation", **value}
            if "displacement" in value:
                return {"kind": "displaced", **value, **_sliding(value["displacement"])}
        if not isinstance(value, (Mapping, SideCondition)):
            raise ValueError(f"must be a word or a table, got {value!r}; {_FORMS}")
        return value

    @model_validator(mode="after")
    def _complete(self) -> SideCondition:
        if (self.kind == "foundation") != (self.stiffness is not None):
            raise ValueError(
                "a stiffness (N/m³) belongs to a foundation, and a foundation needs it"
            )
        if (self.kind == "displaced") != (self.displacement is not None):
            raise ValueError(
                "a displacement (m) belongs to a displaced side, and a displaced side needs it"
            )
        return self

    @property
    def code(self) -> int:
        """The kind of the cells beyond this side, from `kaju.model.scene.cell_types`."""
        return cell_types.ROLLER if self.free_axes else _KINDS[self.kind]

    @property
    def supports(self) -> bool:
        """Whether the side holds a body that touches it."""
        return self.kind != "free"

    def to_value(self) -> Any:
        """Return the short form that scenes are written in."""
        if self.stiffness is not None:
            return {"stiffness": self.stiffness}
        if self.displacement is not None:
            moved: list[float | str] = list(self.displacement)
            for axis in self.free_axes:
                moved[axis] = _FREELY
            return {"displacement": moved}
        return self.kind


FREE = SideCondition()


def unknown_side(name: str, sides: tuple[str, ...], where: str) -> SceneError:
    """Return the error for a side that the array does not have."""
    return SceneError(
        f"{where}: there is no side {name!r}{suggestion(name, sides)}; there is {', '.join(sides)}"
    )
