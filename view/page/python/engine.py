"""What kaju's agents and engine need in a page, in plain Python that Brython runs.

Their own sources, without annotations and docstrings, stand between the two parts of this file: see
`heart` in `__init__.py`. The page calls the functions at the end.
"""

from math import inf, isfinite  # noqa: F401

from _random import Random as Twister
from browser import self as _page


class Record(tuple):
    """Named tuples: `fields`, and `defaults` of the last of them."""

    fields, defaults = (), ()

    def __init_subclass__(cls):
        for at, name in enumerate(cls.fields):
            setattr(cls, name, property(lambda self, at=at: self[at]))

    def __new__(cls, *given, **named):
        fields = cls.fields
        if len(given) == len(fields) and not named:
            return tuple.__new__(cls, given)
        usual = dict(zip(fields[len(fields) - len(cls.defaults) :], cls.defaults))
        values = usual | dict(zip(fields, given)) | named
        if len(given) > len(fields) or set(values) != set(fields):
            raise TypeError(f"{cls.__name__} has {', '.join(fields)}; got {', '.join(values)}")
        return tuple.__new__(cls, [values[name] for name in fields])

    def _replace(self, **named):
        return type(self)(**(dict(zip(self.fields, self)) | named))

    def __repr__(self):
        told = [f"{name}={value!r}" for name, value in zip(self.fields, self)]
        return f"{type(self).__name__}({', '.join(told)})"


class Material(Record):
    fields = ("name", "youngs_modulus", "poissons_ratio")


class Random(Twister):
    """Python's random numbers, from a seed."""

    def uniform(self, low, high):
        return low + (high - low) * self.random()

    def randrange(self, low, high=None):
        low, n = (0, low) if high is None else (low, high - low)
        if n < 1:
            raise ValueError("there is nothing to draw from")
        drawn = self.getrandbits(n.bit_length())
        while drawn >= n:
            drawn = self.getrandbits(n.bit_length())
        return low + drawn

    def randint(self, low, high):
        return self.randrange(low, high + 1)

    def choice(self, values):
        return values[self.randrange(len(values))]

    def shuffle(self, values):
        for i in reversed(range(1, len(values))):
            j = self.randrange(i + 1)
            values[i], values[j] = values[j], values[i]


class Elsewhere:
    """What kaju has and the page has not: it may be imported, not used."""

    def __init__(self, name):
        self.__dict__["name"] = name

    def __call__(self, *given, **named):
        raise KajuError(f"{self.name}: is not in the page, which brings scene and model; it is there in Python at home")

    def __getattr__(self, what):
        raise KajuError(f"{self.name}.{what}: is not in the page; it is there in Python at home")


class FixedAgent:
    """What Mesa gives an agent."""

    def __init__(self, model):
        self.model, self.random, self.rng = model, model.random, model.rng


class Cell:
    def __init__(self, coordinate):
        self.coordinate = coordinate


class Table:
    """Things by name."""

    def __init__(self, things):
        self.__dict__.update(things)


def add(a, b):
    return a + b


def index(number):
    if not isinstance(number, int):
        raise TypeError(f"{number!r} is no whole number")
    return int(number)


def islice(values, most):
    """The first values, as a list."""
    found = []
    for value in values:
        if len(found) == most:
            break
        found.append(value)
    return found


Real, Integral = int | float, int
np, float_info = Table({"bool_": bool}), Table({"max": 1.7976931348623157e308})

# ---- kaju

LoadModel, Scene, PrescribedRule, plot, export_page = map(
    Elsewhere, ("LoadModel", "Scene", "PrescribedRule", "plot", "export_page")
)


class Model:
    """What agents know of the run."""

    def __init__(self, told, parameters):
        self.__dict__.update(told)  # threshold, accumulate, sense, cross_section, ...
        table = self.lattice = Table(told["lattice"])
        table.mirrored = {(n, d): way for n, row in enumerate(table.mirrored) for d, way in enumerate(row)}
        table.way = lambda d, form: Neighbourhood(
            ((d, 1.0),), ((table.opposite[d], 1.0),), [Lateral(*row) for row in table.beside[d]]
        )
        self.parameters, self.random, self.rng = parameters, Random(), Elsewhere("rng")
        self.random.seed(told["seed"])
        self.transfer = Transfer()
        self.transfer.lattice, self.transfer._opposite = table, table.opposite
        self.transfer.rule = Table({"sense": self.sense})
        self.transfer.materials = [Material(*row) for row in told["materials"]]
        self.transfer.shares = [Shares(*row) for row in told["shares"]]

    generation = property(lambda self: self.engine.generation)

    def heading(self, load):
        return self.transfer.heading(load.direction, load.sense)

    def axis_of(self, direction):
        return self.lattice.axis_of[direction]

    def agent_at(self, index):
        return self.engine.agents.get(tuple(index))

    def hand_over(self, sender, arm, load):
        self.engine.hand_over(sender, arm, load)


class PageEngine(AgentEngine):
    """kaju's engine, with tables that the page made."""

    def __init__(self, model, classes):
        table, known = model.lattice, declared([classes.get(0, MaterialAgent)], State)
        self.__dict__.update(
            model=model, lattice=table, transfer=model.transfer, opposite=table.opposite, axis_of=table.axis_of,
            accumulate=model.accumulate, threshold=model.threshold, two_senses=model.sense,
            senses=("push", "pull") if model.sense else ("push",), generation=0, dropped=0.0, returned=0.0,
            taken=0.0, passed=0.0, pending=0.0, states=known, known={name: {} for name in known},
            changes={name: [] for name in known}, own_classes=True, own_boundaries=len(classes) > (0 in classes),
            material_agent=classes.get(0, MaterialAgent), boundary_agents=USUAL | classes, seen={}, boxes={}, called=[],
            acts=[], waiting=[], _sent={}, agents={}, boundaries={}, space=Table({"cell": lambda at, inside: Cell(at)}),
            steps=[{arm: tuple(step) for arm, step in enumerate(form)} for form in table.steps], back=[],
        )
        model.engine = self
        self.guard = OwnAgents(model, [tuple(range(table.directions))] * table.forms, table.directions, self.senses)
        self.usual = [[(s, self._emissions(s, form)) for form in range(table.forms)] for s in self.transfer.shares]
        self.applied = sum([load[2] for load in model.loads])
        for cell, state, size in model.loads:
            place = tuple(cell)
            if place not in self.boxes:
                self.boxes[place] = LoadBox(self.called, place, self._look_round(place)[0])
            sense = "pull" if state >= table.directions else "push"
            self._bring(self.boxes[place], Load(state % table.directions, float(size), 1.0, sense))
        self._open_boxes()

    def _look_round(self, place):
        key = sum([(at + 1) * stride for at, stride in zip(place, self.lattice.stride)])
        self.seen[place] = self.model.kinds[key], key, place[1] % self.lattice.forms
        return self.seen[place]

    def _give_back(self, box):
        given = super()._give_back(box)
        self.back.append([self.seen[box.home.place][1], given])
        return given

    def _settle(self):
        """Let the page read what was done."""


USUAL = {-1: FreeBoundaryAgent, -2: RigidBoundaryAgent, -3: RollerBoundaryAgent}


def begin(names, told):
    """Take the last class of agents, boundaries and the order in a code; say what they declare."""
    global engine, order
    classes, order = {}, None
    for value in names.values():
        if isinstance(value, type):
            for kind, usual in (USUAL | {0: MaterialAgent}).items():
                if issubclass(value, usual) and value is not usual:
                    classes[kind] = value
        elif isinstance(value, type(begin)) and value.__code__.co_varnames[:1] == ("waiting",):
            order = value
    if not classes and order is None:
        raise KajuError("class: there is no class of agents; write one, as in class Mine(MaterialAgent)")
    numbers = declared(classes.values(), Parameter)
    engine = PageEngine(Model(told, {n: told["parameters"].get(n, p.default) for n, p in numbers.items()}), classes)
    return [
        [[n, p.text or n, p.low, p.high, engine.model.parameters[n], p.whole] for n, p in numbers.items()],
        [[n, s.meaning or n] for n, s in engine.states.items()],
        [c.__name__ for c in (*classes.values(), *([order] if order else []))],
    ]


def generation():
    """Let a generation act; tell what was taken, given back, done and known, and who awoke."""
    engine.begin()
    engine.act(order)
    engine.end()
    every, axes = range(engine.lattice.directions), range(len(engine.lattice.along))
    taken, done, states = [], [], []
    for _, agent, inbox in engine.acts:
        for (d, size, sense), copies in inbox.items():
            taken.append([agent.key, d + len(every) * (sense == "pull"), size * copies])
        done.append([
            agent.key, agent.spawn_step == engine.generation and engine._arms_to_wakers(agent), agent.dropped,
            *[agent.passed[arm] for arm in every], *[agent.squeezed[axis] for axis in axes],
            *[engine.guard.shortening(agent, axis) for axis in axes], agent.shares.widening,
        ])
    agents = list(engine.agents.values())
    for n, changes in enumerate(engine.changes.values()):
        states += [[n, agents[number].key, value] for _, number, value in changes]
        changes.clear()
    back = list(engine.back)
    engine.acts.clear()
    engine.back.clear()
    return [taken, back, done, states, engine.pending]


def totals():
    """What all have done so far."""
    agents, walls = engine.agents.values(), engine.boundaries.values()
    arrived = sum([sum(wall.taken.values()) for wall in walls])
    return [sum([agent.kept for agent in agents]), engine.dropped + sum([agent.dropped for agent in agents]), arrived, engine.returned, sum([wall.kept for wall in walls])]


def show(*values, sep=" ", end="\n", **rest):
    _page.tell(sep.join([str(value) for value in values]) + end)


for function in (begin, generation, totals, show):
    setattr(_page, function.__name__, function)
