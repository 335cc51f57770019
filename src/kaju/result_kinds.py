"""Every kind of result, entered once: where it is, what draws and films it, what a page shows.

Entries are "module:name" below `kaju`, fetched when first asked for: to tell which pictures a
result has imports nothing that draws.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

_FIELDS = {
    name: f"view.maps:plot_{name}" for name in ("displacement", "strain", "stress", "von_mises")
}
_SCENE = {"scene": "view.plots:plot_scene"}
_CURVES = "view.charts:plot_curves"
_CREPT = {"curves": "view.charts:plot_curves_in_time"}
_IN_TIME = {"times": "view.deformed:TIMES", "curves": "view.charts:IN_TIME"}


@dataclass(frozen=True)
class Kind:
    """What there is to a kind of result; each mapping is by name, the usual one first."""

    result: str  # the class
    pictures: Mapping[str, str]  # functions that draw the result with `kaju.plot`
    films: Mapping[str, str] = field(default_factory=dict)  # what `kaju.animate` can make of these
    meshes: Mapping[str, str] = field(default_factory=dict)  # that give it a mesh that moves
    page: str | None = None  # what it replays on a page; None if a page cannot show it


KINDS = {
    "load transfer": Kind(
        "model.transfer.transfer_result:TransferResult",
        pictures={
            "agents": "view.agents:plot_agents",
            "loads": "view.load_plots:plot_loads",
            "deformed": "view.deformed:plot_cells_deformed",
            **_FIELDS,
            "taken": "view.maps:plot_taken",
            "cuts": "view.charts:plot_cuts",
            "stages": "view.charts:plot_stages",
            **_SCENE,
        },
        films={"generations": "view.agents:GENERATIONS", "stages": "view.deformed:STAGES"},
        meshes={"generations": "view.motion:generations", "stages": "view.motion:stages"},
        page="view.motion:generations",
    ),
    "elastic": Kind(
        "model.elastic.elastic_result:ElasticResult",
        pictures={
            "deformed": "view.deformed:plot_deformed",
            **_FIELDS,
            "cuts": "view.charts:plot_cuts",
            "agents": "view.quadtree:plot_agents_of_many_sizes",
            **_SCENE,
        },
        films={
            "loading": "view.deformed:LOADING",
            "generations": "view.quadtree:GENERATIONS",
            "gaps": "view.quadtree:GAPS",
        },
        meshes={"loading": "view.motion:loaded"},
        page="view.motion:elastic_answer",
    ),
    "elastic agents": Kind(
        "model.elastic.relaxation.elastic_run:ElasticRun",
        pictures={
            "agents": "view.face_agents:plot_face_agents",
            "left": "view.face_agents:plot_left",
            "curves": _CURVES,
            "deformed": "view.deformed:plot_deformed",
            **_FIELDS,
            "cuts": "view.charts:plot_cuts",
            **_SCENE,
        },
        films={"waves": "view.face_agents:WAVES"},
        page="view.motion:elastic_agents",
    ),
    "elasticity in pieces": Kind("model.scale.pieces:PiecedResult", _SCENE),  # ParaView draws it
    "spring network": Kind(
        "model.network.network_result:NetworkResult",
        pictures={"deformed": "view.network_plots:plot_network", "response": _CURVES},
        films={"increments": "view.network_plots:INCREMENTS"},
        meshes={"increments": "view.motion:network"},
        page="view.motion:network",
    ),
    "fracture": Kind(
        "model.fracture.fracture_result:FractureResult",
        pictures={
            "crack": "view.fracture_plots:plot_crack",
            "response": _CURVES,
            "avalanches": "view.fracture_plots:plot_avalanches",
        },
        films={"breaks": "view.fracture_plots:BREAKS"},
        page="view.motion:breaks",
    ),
    "growth": Kind(
        "model.growth.growth_result:GrowthResult",
        pictures={"design": "view.fracture_plots:plot_design", "history": _CURVES},
        films={"steps": "view.fracture_plots:STEPS"},
        page="view.motion:growth_steps",
    ),
    "element in time": Kind(
        "model.rheology.creep_result:CreepResult",
        pictures=_CREPT,
        films={"times": "view.charts:IN_TIME"},
        page="view.motion:element",
    ),
    "network in time": Kind(
        "model.rheology.creeping_network:NetworkCreepResult",
        pictures=_CREPT | {"deformed": "view.network_plots:plot_network"},
        films=_IN_TIME | {"times": "view.network_plots:TIMES"},
        meshes={"times": "view.motion:network"},
        page="view.motion:network",
    ),
} | {
    name: Kind(
        result,
        pictures=_CREPT | {"deformed": "view.deformed:plot_body_in_time"} | _SCENE,
        films=_IN_TIME,
        meshes={"times": "view.motion:body_in_time"},
        page="view.motion:body_in_time",
    )
    for name, result in (
        ("load transfer in time", "model.rheology.creeping_elements:TransferCreepResult"),
        ("elasticity in time", "model.rheology.creeping_elastic:ElasticCreepResult"),
    )
}
"""Kinds of results, by the label that stored ones have."""


def fetch(entry: str) -> Any:
    """Return what an entry names."""
    module, _, name = entry.partition(":")
    return getattr(import_module(f"kaju.{module}"), name)


def html_in_notebook(of: Any) -> str:
    """Return what a notebook shows of a scene, a model or a result: a picture, or the page."""
    return str(fetch("view.page.export:html_of")(of))
