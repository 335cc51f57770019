"""What lies beyond the sides of the array."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import model_validator

from kaju.errors import SceneError, suggestion
from kaju.model.scene import cell_types
from kaju.model.scene.validation import Described, Index, Number, Positive, optional

_WORDS = ("free", "rigid", "roller")
_SAME = dict.fromkeys(("fixed", "clamped", "pinned", "encastre", "ground", "built-in"), "rigid")
_SAME |= dict.fromkeys(("symmetry", "symmetric", "slider", "sliding"), "roller")
"""What others call them."""
_FORMS = 'a side is "free", "rigid", "roller", {stiffness = N/m³} or {displacement = [m, m]}'


class SideCondition(Described):
    """How one side of the array is held.

    In a scene it is written as a word, "free", "rigid" or "roller", or as a table,
    ``{stiffness = 1e9}`` or ``{displacement = [0.0, -1e-4]}``.
    """

    word: Literal["free", "rigid", "roller"] = "free"
    stiffness: Positive | None = optional("the pressure per displacement of an elastic bed (N/m³)")
    displacement: tuple[Number, ...] | None = optional(
        "what the side is moved by (m), one number per axis"
    )
    free_axes: tuple[Index, ...] = ()
    """Axes along which a moved side lets the body slide, as a roller does: all of the side's own. A
    scene writes "free" in place of their numbers, ``{displacement = ["free", -1e-4]}``."""

    @model_validator(mode="before")
    @classmethod
    def _from_short_form(cls, value: Any) -> Any:
        if isinstance(value, str):
            if value not in _WORDS:
                meant = f" (did you mean {_SAME[value]!r}?)" if value in _SAME else ""
                meant = meant or suggestion(value, _WORDS)
                raise ValueError(f"there is no {value!r}{meant}; {_FORMS}")
            return {"word": value}
        if isinstance(value, SideCondition):
            return value
        if not isinstance(value, Mapping):
            raise ValueError(f"must be a word or a table, got {value!r}; {_FORMS}")
        moved = value.get("displacement")
        if isinstance(moved, (list, tuple)) and "free" in moved:
            free = [axis for axis, number in enumerate(moved) if number == "free"]
            numbers = [0.0 if number == "free" else number for number in moved]
            return {**value, "displacement": numbers, "free_axes": free}
        return value

    @model_validator(mode="after")
    def _one_form(self) -> SideCondition:
        if len({"word", "stiffness", "displacement"} & self.model_fields_set) > 1:
            raise ValueError(f"takes one form; {_FORMS}")
        return self

    @property
    def kind(self) -> str:
        """What lies beyond: "free", "rigid", "roller", "foundation" or "displaced"."""
        if self.stiffness is not None:
            return "foundation"
        return self.word if self.displacement is None else "displaced"

    @property
    def code(self) -> int:
        """The kind of the cells beyond this side, from `kaju.model.scene.cell_types`."""
        if self.free_axes:
            return cell_types.ROLLER
        return cell_types.AIR if self.kind == "free" else getattr(cell_types, self.kind.upper())

    def to_value(self) -> Any:
        """Return the short form that scenes are written in."""
        if self.stiffness is not None:
            return {"stiffness": self.stiffness}
        if self.displacement is not None:
            moved: list[float | str] = list(self.displacement)
            for axis in self.free_axes:
                moved[axis] = "free"
            return {"displacement": moved}
        return self.kind


FREE = SideCondition()


def check_side(name: str, sides: tuple[str, ...], where: str) -> None:
    """Refuse a side that the array does not have."""
    if name not in sides:
        known = f"{suggestion(name, sides)}; there is {', '.join(sides)}"
        raise SceneError(f"{where}: there is no side {name!r}{known}")
