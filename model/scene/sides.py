"""What lies beyond the sides of the array."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, model_validator

from kaju.agents.materials import suggestion

from . import kinds
from .described import Described, Number, Positive

_KINDS = {
    "free": kinds.AIR,
    "rigid": kinds.RIGID,
    "roller": kinds.ROLLER,
    "foundation": kinds.FOUNDATION,
    "displaced": kinds.DISPLACED,
}
_WORDS = ("free", "rigid", "roller")
_FORMS = 'a side is "free", "rigid", "roller", {stiffness = N/m³} or {displacement = [m, m]}'


class SideCondition(Described):
    """How one side of the array is held.

    In a scene it is written as a word, "free", "rigid" or "roller", or as a table,
    ``{stiffness = 1e9}`` or ``{displacement = [0.0, -1e-4]}``.

    Parameters
    ----------
    kind : {"free", "rigid", "roller", "foundation", "displaced"}
        What lies beyond.
    stiffness : float, optional
        Pressure per displacement of a foundation (N/m³).
    displacement : tuple of float, optional
        Displacement (m) that a displaced side imposes.
    """

    kind: Literal["free", "rigid", "roller", "foundation", "displaced"] = Field(
        default="free", description="a word for what lies beyond the side"
    )
    stiffness: Positive | None = Field(
        default=None, description="the pressure per displacement of an elastic bed (N/m³)"
    )
    displacement: tuple[Number, ...] | None = Field(
        default=None, description="what the side is moved by (m), one number per axis"
    )

    @model_validator(mode="before")
    @classmethod
    def _from_short_form(cls, value: Any) -> Any:
        if isinstance(value, str):
            if value not in _WORDS:
                raise ValueError(f"there is no {value!r}{suggestion(value, _WORDS)}; {_FORMS}")
            return {"kind": value}
        if isinstance(value, Mapping) and "kind" not in value:
            if "stiffness" in value:
                return {"kind": "foundation", **value}
            if "displacement" in value:
                return {"kind": "displaced", **value}
        if not isinstance(value, (Mapping, SideCondition)):
            raise ValueError(f"must be a word or a table, got {value!r}; {_FORMS}")
        return value

    @model_validator(mode="after")
    def _complete(self) -> SideCondition:
        if (self.kind == "foundation") != (self.stiffness is not None):
            raise ValueError("a foundation, and nothing else, has a stiffness (N/m³)")
        if (self.kind == "displaced") != (self.displacement is not None):
            raise ValueError("a displaced side, and nothing else, has a displacement (m)")
        return self

    @property
    def code(self) -> int:
        """The kind of the cells beyond this side, from `kaju.model.scene.kinds`."""
        return _KINDS[self.kind]

    @property
    def supports(self) -> bool:
        """Whether the side holds a body that touches it."""
        return self.kind != "free"

    def to_value(self) -> Any:
        """Return the short form that scenes are written in."""
        if self.stiffness is not None:
            return {"stiffness": self.stiffness}
        if self.displacement is not None:
            return {"displacement": list(self.displacement)}
        return self.kind


FREE = SideCondition()
