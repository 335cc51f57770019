"""A model with sliders in Mesa's own page: ``solara run app.py`` (needs kaju[mesa])."""

from mesa.visualization import SolaraViz, SpaceRenderer, make_plot_component

from kaju import LoadModel, Scene

SCENE = Scene(
    body={"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"},
    sides={"bottom": "rigid"},
    loads=[{"cell": [10, 19], "force": [0.0, -2.0]}],
)
THRESHOLD = {"type": "SliderFloat", "label": "γ (N)", "min": 1e-3, "max": 0.1, "step": 1e-3}
PARAMETERS = {"threshold": THRESHOLD | {"value": 0.01}}


class Plate(LoadModel):
    """The worked plate: Mesa's page hands over numbers only."""

    def __init__(self, **numbers):
        super().__init__(SCENE, engine="agents", **numbers)


def portray(agent):
    """Draw material agents dark, those of boundaries light."""
    return {"color": "black" if hasattr(agent, "material") else "lightgrey", "marker": "s"}


model = Plate(threshold=0.01)
renderer = SpaceRenderer(model, backend="matplotlib")
renderer.draw_agents(portray)
page = SolaraViz(
    model,
    renderer,
    components=[make_plot_component("load_waiting")],
    model_params=PARAMETERS,
    name="Load transfer",
)
