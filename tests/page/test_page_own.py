"""A page never shows somebody else's agents as the standard rule."""

import numpy as np
import pytest
from page_scenes import Leaky, header_of
from plates import plate as pressed

import kaju
from kaju import FreeBoundaryAgent, LoadModel, MaterialAgent, RigidBoundaryAgent
from kaju.view.page.export import packed_page


def plate(**given):
    usual = {"sides": {"bottom": "rigid", "right": "roller"}, "thickness": 0.002}
    usual["rule"] = {"kind": "prescribed", "threshold": 5e-3}
    return pressed([10, 6], [5, 5], **usual | given)


class Greedy(MaterialAgent):
    def take(self, load):
        super().take(load)
        self.kept += 0.1 * load.total


class Narrow(MaterialAgent):
    def emissions(self, load):
        return super().emissions(load)[:1]


class Soft(MaterialAgent):
    def shortening(self, axis):
        return 2.0 * super().shortening(axis)


class Absorbing(FreeBoundaryAgent):
    def give_back(self, load, arm):
        return None


class Sand(RigidBoundaryAgent):
    def turn(self, load, arm):
        return load


class Ice(kaju.RollerBoundaryAgent):
    def give_back(self, load, arm):
        return None


class Twice(MaterialAgent):
    """The first of this name."""

    def pass_on(self, load):
        super().pass_on(load)


First = Twice


class Twice(MaterialAgent):
    """The second."""

    def pass_on(self, load):
        pass


def first_only(waiting):
    return waiting[:1]


AGENTS = (Greedy, Leaky, Narrow, Soft)
BOUNDARIES = {Absorbing: "free", Sand: "rigid", Ice: "roller"}
OWN = {kind.__name__: {"material_agent": kind} for kind in AGENTS}
OWN |= {own.__name__: {"boundary_agents": {kind: own}} for own, kind in BOUNDARIES.items()}
OWN["first_only"] = {"order": first_only}


def check_own(page, name, head):
    """Of whom a page says that its agents are, with their source."""
    assert page.text(".mode") == f"a recorded run · agents of your own: {name}"
    page.tab.get_by_role("tab", name="Source").click()
    assert head in page.text("pre")


@pytest.mark.parametrize("name", OWN)
def test_what_is_overridden_is_recorded_and_named(name):
    model = LoadModel(plate(), **OWN[name])
    header = header_of(packed_page(model))
    assert header["kind"] == "recorded"
    assert header["own"]["names"] == [name]
    assert f" {name}" in header["own"]["source"]
    assert ("boundary_agents" in OWN[name]) == (name in header["walls"].values())
    assert (name in ("Absorbing", "Ice")) == ("absorbed" in header)
    agents = len(model.run().last.cells)
    again, ended = header_of(packed_page(model)), model.datacollector.model_vars["load_dropped"]
    assert header.get("dropped") == again.get("dropped") == (ended if any(ended) else None)
    assert header.get("absorbed") == again.get("absorbed")
    assert header["verdict"] == f"{model.outcome}, {agents} agents" or model.certificate.known
    # A result knows the names of classes; what they did tells orders from the rule's own.
    told = header_of(packed_page(model.run()))
    assert told["kind"] == "recorded"
    assert told.get("own", {"names": ["first_only"]})["names"] == [name]


def test_of_two_classes_of_one_name_the_source_is_that_of_the_one_that_ran():
    bare = type("Twice", (MaterialAgent,), {"__module__": __name__})  # either may be meant
    for own, told in ((First, "first of this"), (Twice, "The second"), (bare, "# the source of")):
        source = header_of(packed_page(LoadModel(plate(), material_agent=own)))["own"]["source"]
        assert told in source
        assert source.count("class ") == (own is not bare)


def test_a_run_that_was_cut_short_is_recorded():
    """The page's own run would go on."""
    short = LoadModel(plate(), max_generations=3).run()
    assert header_of(packed_page(short))["kind"] == "recorded"


@pytest.mark.parametrize("name", ["Soft", "Ice", "first_only"])
def test_a_page_moves_cells_as_python_does(name, shown):
    model = LoadModel(plate(), **OWN[name])
    page = shown(model, exact=True)
    check_own(page, name, f" {name}(")
    result = model.again(model.scene).run()
    page.js("page.seek(Infinity)")
    keys = result.scene.lattice.key(result.last.cells).tolist()
    moved = page.js(f"page.deformed().displacement.map((u) => {keys}.map((k) => u[k]))")
    size = np.abs(result.displacement).max()
    np.testing.assert_allclose(np.transpose(moved), result.displacement, atol=1e-12 * size)


class Marked(MaterialAgent):
    low = kaju.State(False, "stands low")

    def __init__(self, *start):
        super().__init__(*start)
        self.low = self.index[1] < 3


COLOURS = """(() => {
  const { view, canvas: { width: w, height: h } } = page;
  const ink = new Uint32Array(page.canvas.getContext("2d").getImageData(0, 0, w, h).data.buffer);
  return [[5, 1], [5, 4], [0, 0]].map((cell) => {
    const [x, y] = view.point(view.centre(cell)).map((at) => Math.round(at * view.r));
    return ink[y * w + x]; }); })()"""


def test_a_state_that_is_true_or_false_has_two_colours_and_neither_is_that_of_sleep(shown):
    scene, own = plate(sides={"bottom": "rigid"}), {"material_agent": Marked}
    page = shown(LoadModel(scene, boundary_agents={"roller": Ice}, **own), language="de")
    page.js("(page.look.colour = 'state low', page.look.arrows = false, page.draw())")
    assert page.js("[page.scale().whether, page.kindOf(page.scale())]") == [True, ""]
    assert len(set(page.js(COLOURS))) == 3
    told = "In Ruhe nach 9 Generationen, 39 Agenten; keine Last erreichte einen Rand mit Rollen"
    assert page.text(".verdict").startswith(told)
