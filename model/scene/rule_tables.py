"""The rules as scenes write them: ``[rule] kind = "prescribed"`` and its keys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field

from kaju.agents.materials import suggestion
from kaju.agents.rules import Coefficients, PrescribedRule
from kaju.errors import ParameterError

from .described import Described, Flag, Number, Text

Rule = PrescribedRule


class CoefficientsTable(Described):
    """``[rule.materials.NAME]``: coefficients of one material."""

    alpha: tuple[Number, Number, Number] | None = Field(
        default=None, description="the shares kept, passed ahead and passed beside"
    )
    beta: Number = Field(default=0.5, description="the free part of the Poisson expansion")

    def build(self) -> Coefficients:
        """Return the coefficients."""
        return Coefficients(self.alpha, self.beta)


class PrescribedTable(CoefficientsTable):
    """``[rule]`` with the coefficients that the user chooses."""

    kind: Literal["prescribed"] = "prescribed"
    threshold: Number = Field(default=0.01, description="γ, below which loads end (N)")
    accumulate: Flag = False
    materials: dict[Text, CoefficientsTable] = Field(default_factory=dict)

    def build(self) -> PrescribedRule:
        """Return the rule."""
        own = {name: table.build() for name, table in self.materials.items()}
        return PrescribedRule(self.alpha, self.beta, self.threshold, self.accumulate, own)


TABLES = {"prescribed": PrescribedTable}
"""How each kind of rule is written. A new kind of rule is entered here."""


def rule_from(value: Any) -> Any:
    """Return the rule that a table describes; a rule is returned as it is."""
    if not isinstance(value, Mapping):
        return value
    kind = value.get("kind", "prescribed")
    if kind not in TABLES:
        raise ParameterError(
            f"kind: there is no rule {kind!r}{suggestion(str(kind), TABLES)}; "
            f"there is {', '.join(TABLES)}"
        )
    return TABLES[kind].model_validate(value).build()
