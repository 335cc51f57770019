"""The parts of a scene, as files and Python give them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from pydantic import Field, PlainValidator, field_validator, model_validator

from kaju.agents.elastic_rule import ElasticRule
from kaju.agents.materials import Material, suggestion
from kaju.agents.rules import Coefficients, PrescribedRule
from kaju.errors import ParameterError, SceneError
from kaju.model.rheology.load_history import History
from kaju.model.scene.validation import (
    Count,
    Described,
    Flag,
    Number,
    Text,
    built_by,
    one_given,
    optional,
)

from .body import Body
from .cell_types import NOT_BODY
from .loads import LoadTable
from .shared_materials import MaterialEntry, shared_materials
from .sides import SideCondition


class HistoryStep(Described):
    """A step of a history, in one of four words.

    ``{ramp = 1.0, duration = 0.2}``, ``{hold = 5.0}``, ``{release = 0.1}`` (0: at once), or
    ``{cycles = 3, period = 0.6}``.
    """

    ramp: Number | None = optional("the factor to go to")
    hold: Number | None = optional("how long the factor is kept (s)")
    release: Number | None = optional("the time to go back to 0 in (s)")
    cycles: Annotated[Count, Field(le=10_000)] | None = optional("how often it rises and falls")
    duration: Number | None = optional("how long a ramp takes (s)")
    period: Number | None = optional("how long a cycle takes (s)")
    high: Number = Field(default=1.0, description="the factor at the top of a cycle")
    low: Number = Field(default=0.0, description="the factor at the bottom of a cycle")

    @model_validator(mode="after")
    def _one_word(self) -> HistoryStep:
        one_given(self, ("ramp", "hold", "release", "cycles"), "ramp: a step is one of")
        if (self.cycles is not None) != (self.period is not None):
            raise ParameterError("period: belongs to cycles, and cycles need it")
        if self.duration is not None and self.ramp is None:
            raise ParameterError(
                "duration: belongs to a ramp; hold and release are durations themselves"
            )
        return self

    def after(self, history: History) -> History:
        """Return a history that goes on with this step."""
        if self.ramp is not None:
            return history.ramp(self.ramp, self.duration or 0.0)
        if self.hold is not None:
            return history.hold(self.hold)
        if self.cycles is not None and self.period is not None:
            return history.cycles(self.cycles, self.period, self.high, self.low)
        return history.release(self.release or 0.0)


class HistoryTable(Described):
    """``[history]``: ``times`` and ``factors`` of its corners, or ``steps``."""

    times: tuple[Number, ...] | None = optional("the times of the corners (s), the first 0")
    factors: tuple[Number, ...] | None = optional("the factor at each corner")
    steps: tuple[HistoryStep, ...] | None = optional(
        "a list such as [{ramp = 1.0, duration = 0.2}, {hold = 5.0}]"
    )

    def build(self) -> History:
        """Return the history, which refuses what is out of its range."""
        corners = self.times is not None
        if corners != (self.factors is not None) or corners == (self.steps is not None):
            raise ParameterError("times: give either times and factors, or steps")
        if self.times is not None and self.factors is not None:
            return History(self.times, self.factors)
        history = History()
        for step in self.steps or ():
            history = step.after(history)
        return history


Rule = PrescribedRule | ElasticRule


class CoefficientsTable(Described):
    """``[rule.materials.NAME]``: coefficients of one material."""

    alpha: tuple[Number, ...] | None = optional("the shares kept, passed ahead and passed beside")
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
    threshold: Number | None = optional(
        "γ, up to which loads rest (N); left out: from the tolerance"
    )
    order: Text = Field(default=ElasticRule.order, description="who acts when")
    share: Number | None = optional(
        "the share by which all yield in a wave; left out: a stable one"
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


def _rule_from(value: Any) -> Any:
    """Return the rule that a table describes; a rule is returned as it is."""
    if isinstance(value, Rule):
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


def check_rule(rule: Rule, materials: list[str]) -> None:
    """Refuse coefficients of materials that the scene does not have: they would do nothing."""
    for name in rule.materials if isinstance(rule, PrescribedRule) else ():
        if name not in materials:
            raise SceneError(
                f"rule.materials.{name}: the scene has no such material"
                f"{suggestion(name, materials)}; it has {', '.join(dict.fromkeys(materials))}"
            )


_HISTORY = built_by(HistoryTable, History, "a table of times and factors, or of steps")


class Description(Described):
    """Body, legend, materials, sides, loads, rule and history: the keys of a scene's file."""

    body: Body
    legend: dict[Text, Text] = Field(default_factory=dict)
    materials: dict[Text, MaterialEntry] = Field(default_factory=dict)
    sides: dict[Text, SideCondition] = Field(default_factory=dict)
    loads: tuple[LoadTable, ...] = ()
    # With "continue" agents live on from one step of the loads to the next, which brings what is
    # added; otherwise every step begins with a body in which nobody is awake.
    loading: Literal["afresh", "continue"] = "afresh"
    rule: Annotated[Rule, PlainValidator(_rule_from)] = PrescribedRule()
    history: Annotated[History, _HISTORY] | None = None

    @model_validator(mode="before")
    @classmethod
    def _regions_into_body(cls, values: Any) -> Any:
        if isinstance(values, Mapping) and "regions" in values:
            body = values.get("body")
            if not isinstance(body, Mapping) or "regions" in body:
                raise ParameterError("regions: are given twice; leave them out here, or in body")
            inner = {**body, "regions": values["regions"]}
            return {**{k: v for k, v in values.items() if k != "regions"}, "body": inner}
        return values

    @field_validator("materials", mode="before")
    @classmethod
    def _in_a_file(cls, materials: Any) -> Any:
        return shared_materials(materials) if isinstance(materials, (str, Path)) else materials

    @field_validator("legend", mode="before")
    @classmethod
    def _codes_as_keys(cls, legend: Any) -> Any:
        if isinstance(legend, Mapping):
            return {str(k) if isinstance(k, int) else k: name for k, name in legend.items()}
        return legend

    @field_validator("materials", mode="after")
    @classmethod
    def _named_by_their_keys(cls, materials: dict[str, Material]) -> dict[str, Material]:
        for name in NOT_BODY:
            if name in materials:
                raise ParameterError(
                    f"{name}: cannot name a material, because scenes use the word for cells that "
                    "are not body"
                )
        return {name: replace(material, name=name) for name, material in materials.items()}
