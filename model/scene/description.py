"""The parts of a scene, as files and Python give them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any

from pydantic import Field, PlainValidator, field_validator, model_validator

from kaju.agents.history import History
from kaju.agents.materials import Material
from kaju.agents.rules import PrescribedRule
from kaju.errors import ParameterError

from .body import Body
from .contents import NOT_BODY
from .described import Described, Text
from .history_tables import history_from
from .loads import Load
from .material_tables import material_from
from .rule_tables import Rule, rule_from
from .sides import SideCondition

MaterialEntry = Annotated[Material, PlainValidator(material_from)]
HistoryEntry = Annotated[History, PlainValidator(history_from)]
RuleEntry = Annotated[Rule, PlainValidator(rule_from)]


class Description(Described):
    """Body, legend, materials, sides, loads, rule and history: the keys of a scene's file."""

    body: Body
    legend: dict[Text, Text] = Field(default_factory=dict)
    materials: dict[Text, MaterialEntry] = Field(default_factory=dict)
    sides: dict[Text, SideCondition] = Field(default_factory=dict)
    loads: tuple[Load, ...] = ()
    rule: RuleEntry = PrescribedRule()
    history: HistoryEntry | None = None

    @model_validator(mode="before")
    @classmethod
    def _regions_into_body(cls, values: Any) -> Any:
        if isinstance(values, Mapping) and "regions" in values:
            body = values.get("body")
            if not isinstance(body, Mapping) or "regions" in body:
                raise ParameterError("regions: belong into body; give them once")
            inner = {**body, "regions": values["regions"]}
            return {**{k: v for k, v in values.items() if k != "regions"}, "body": inner}
        return values

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
                raise ParameterError(f"{name}: is not a material's name; it means what is no body")
        return {name: replace(material, name=name) for name, material in materials.items()}
