"""The rules as scenes write them: ``[rule] kind = "prescribed"`` and its keys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, cast

from pydantic import Field, model_validator

from kaju.agents.materials import suggestion
from kaju.agents.rules import Coefficients, ElasticRule, PrescribedRule
from kaju.errors import ParameterError, SceneError

from .described import Described, Flag, Number, Text

Rule = PrescribedRule | ElasticRule


class CoefficientsTable(Described):
    """``[rule.materials.NAME]``: coefficients of one material."""

    alpha: tuple[Number, ...] | None = Field(
        default=None, description="the shares kept, passed ahead and passed beside"
    )
    beta: Number = Field(
        default=Coefficients.beta, description="the free part of the Poisson expansion"
    )

    @model_validator(mode="after")
    def _in_range(self) -> CoefficientsTable:
        self.coefficients()
        return self

    def coefficients(self) -> Coefficients:
        """Return the coefficients, which refuse what is out of their range."""
        return Coefficients(cast("tuple[float, float, float] | None", self.alpha), self.beta)


class PrescribedTable(CoefficientsTable):
    """``[rule]`` with the coefficients that the user chooses."""

    kind: Literal["prescribed"] = "prescribed"
    threshold: Number = Field(
        default=PrescribedRule.threshold, description="γ, below which loads end (N)"
    )
    accumulate: Flag = PrescribedRule.accumulate
    materials: dict[Text, CoefficientsTable] = Field(default_factory=dict)
    sense: Flag = Field(default=PrescribedRule.sense, description="whether loads push or pull")

    def build(self) -> PrescribedRule:
        """Return the rule."""
        own = {name: table.coefficients() for name, table in self.materials.items()}
        return PrescribedRule(**self.model_dump(exclude={"kind", "materials"}), materials=own)


class ElasticTable(Described):
    """``[rule]`` with the shares that follow from the materials."""

    kind: Literal["elastic"] = "elastic"
    threshold: Number | None = Field(
        default=None, description="γ, up to which loads rest (N); left out: from the tolerance"
    )
    order: Text = Field(default=ElasticRule.order, description="who acts when")
    share: Number | None = Field(
        default=None, description="the share by which all yield in a wave; left out: a stable one"
    )
    tolerance: Number = Field(
        default=ElasticRule.tolerance, description="the error in energy aimed at, as a share"
    )

    def build(self) -> ElasticRule:
        """Return the rule, which refuses what is out of its range."""
        return ElasticRule(**self.model_dump(exclude={"kind"}))


TABLES: dict[str, type[PrescribedTable | ElasticTable]] = {
    "prescribed": PrescribedTable,
    "elastic": ElasticTable,
}
"""How each kind of rule is written. A new kind of rule is entered here."""


def rule_from(value: Any) -> Any:
    """Return the rule that a table describes; a rule is returned as it is."""
    if isinstance(value, (PrescribedRule, ElasticRule)):
        return value
    if not isinstance(value, Mapping):
        raise ValueError(f"must be a table or a rule, got {value!r}")
    kind = value.get("kind", "prescribed")
    if not isinstance(kind, str) or kind not in TABLES:
        raise ParameterError(
            f"kind: there is no rule {kind!r}{suggestion(str(kind), TABLES)}; "
            f"there is {', '.join(TABLES)}"
        )
    return TABLES[kind].model_validate(value).build()


def check_rule(rule: Rule, known: list[str]) -> None:
    """Refuse coefficients of materials that the scene does not have: they would do nothing."""
    for name in rule.materials if isinstance(rule, PrescribedRule) else ():
        if name not in known:
            raise SceneError(
                f"rule.materials.{name}: the scene has no such material{suggestion(name, known)}; "
                f"it has {', '.join(dict.fromkeys(known))}"
            )
