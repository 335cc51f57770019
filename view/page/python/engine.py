"""What kaju's agents and engine need in a page, in plain Python that Brython runs.

Their sources stand between its two parts, see heart.py. The page calls the functions at the end.
"""

from math import ceil, inf, log  # noqa: F401

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

    def __call__(self):
        raise KajuError("self.random(): is not in the page; write self.random.random()")

    def uniform(self, low, high):
        return low + (high - low) * self.random()

    def randint(self, low, high):
        n, drawn = high - low + 1, inf
        if n < 1:
            raise ValueError("there is nothing to draw from")
        while drawn >= n:
            drawn = self.getrandbits(n.bit_length())
        return low + drawn

    def choice(self, values):
        return values[self.randint(0, len(values) - 1)]

    def shuffle(self, values):
        for last in range(len(values) - 1, 0, -1):
            other = self.randint(0, last)
            values[last], values[other] = values[other], values[last]

    def sample(self, values, count):
        few = 21 if count <= 5 else 21 + 4 ** ceil(log(3 * count) / log(4))
        if not 0 <= count <= len(values):
            raise ValueError("a sample is larger than what it is drawn from, or below 0")
        left, chosen = list(values), []
        if len(left) <= few:  # what was drawn makes room for the last one, as in Python
            for last in range(len(left) - 1, len(left) - 1 - count, -1):
                place = self.randint(0, last)
                chosen.append(left[place])
                left[place] = left[last]
            return chosen
        while len(chosen) < count:
            place = self.randint(0, len(left) - 1)
            if place not in chosen:
                chosen.append(place)
        return [left[place] for place in chosen]

class Elsewhere:
    """What kaju has and the page has not: it may be imported, not used."""

    def __init__(self, name, cure="run this class in Python outside of it"):
        self.__dict__.update(name=name, cure=cure)

    def __call__(self, *given, **named):
        raise KajuError(f"{self.name}: is not in the page; {self.cure}")

    def __getattr__(self, what):
        Elsewhere(self.name if what[0] == "_" else f"{self.name}.{what}", self.cure)()

class Beside(list):
    """The cells beside a cell, arm by arm, and who is awake in them."""

    agents = property(lambda self: iter([agent for cell in self for agent in cell.agents]))

class Cell:
    """A cell of the body's array, or one beside it."""

    get_neighborhood = Elsewhere("cell.get_neighborhood", "ask self.model.agent_at(place) of each place")
    near = None

    def __init__(self, space, place, inside):
        self.space, self.coordinate, self.inside = space, place, inside

    @property
    def agents(self):
        engine, at = self.space.engine, self.coordinate
        awake = engine.agents if self.inside else engine.boundaries
        return [awake[at]] if at in awake else []

    @property
    def neighborhood(self):
        if self.near is None:
            table, at, cell = self.space.lattice, self.coordinate, self.space.cell
            steps = self.space.engine.steps[at[1] % table.forms].values()
            near = [tuple(map(add, at, step)) for step in steps]
            held = [n for n in near if all([0 <= i < end for i, end in zip(n, table.shape)])]
            self.near = Beside([cell(place, True) for place in held])
        return self.near

def space_of(lattice, random):
    cells = {}
    cell = lambda at, inside: cells.get((at, inside)) or cells.setdefault((at, inside), Cell(space, at, inside))
    space = Table({"lattice": lattice, "cell": cell})
    return space

class FixedAgent:
    """What Mesa gives an agent."""

    def __init__(self, model):
        self.model, self.random, self.rng = model, model.random, model.rng

def by_pair(rows):
    return {(n, m): value for n, row in enumerate(rows) for m, value in enumerate(row)}

class Table:
    def __init__(self, things):
        self.__dict__.update(things)

def islice(values, most):
    return [value for value, _ in zip(values, range(most))]

def alike(a, b):
    """How many letters two names share, as difflib counts: the longest common run, then beside it."""
    ends = [(i, j) for i in range(len(a)) for j in range(len(b)) if a[i] == b[j]]
    runs = [(n, -i, -j) for i, j in ends for n in range(1, len(a) - i + 1) if a[i : i + n] == b[j : j + n]]
    n, i, j = max(runs) if runs else (0, 0, 0)
    return n and n + alike(a[:-i], b[:-j]) + alike(a[n - i :], b[n - j :])

def get_close_matches(name, known, n, cutoff):
    ratio = lambda one: 2.0 * alike(name, one) / (len(name) + len(one))
    return [one for one in sorted(known, key=ratio, reverse=True) if ratio(one) >= cutoff][:n]

add = int.__add__
Real, Integral, SENSES = int | float, int, ("push", "pull")
np = Table({"bool_": bool, "generic": Elsewhere, "array": list})
float_info = Table({"max": 1.7976931348623157e308})

# ---- kaju

class Model(LoadModel):
    """What agents know of the run."""

    _fixed = ()

    def __init__(self, told, parameters):
        self.__dict__.update(told)  # threshold, sense, cross_section, kinds, loads, ...
        table = self.lattice = Table(told["lattice"])
        table.mirrored, table.steps = by_pair(table.mirrored), by_pair(table.steps)
        table.arms = [tuple(arms) for arms in table.arms]
        ways = [((d, 1.0),) for d in range(table.directions)]
        beside = [[Lateral(*row) for row in rows] for rows in table.beside]
        half = lambda at: 0.5 + 0.5 * (at[1] % table.forms)  # each other row of hexagons is shifted
        along = lambda at: [at[0] + half(at), (at[1] + 2.0 / 3.0) * (3.0**0.5 / 2.0)]
        middle = along if table.forms > 1 else lambda at: [each + 0.5 for each in at]
        table.centres = lambda cells: [[table.cell_size * x for x in middle(at)] for at in cells]
        table.way = lambda d, form: Neighbourhood(ways[d], ways[table.opposite[d]], beside[d])
        shares, materials = told["shares"], told["materials"]
        self.transfer = Transfer()
        self.transfer.__dict__.update(
            scene=self, lattice=table, rule=self, _opposite=table.opposite,
            shares=[Shares(*row) for row in shares], materials=[Material(*row) for row in materials],
        )
        self.parameters, self.random, self.rng = parameters, Random(), Elsewhere("rng")
        self.random.seed(told["seed"])
        self._fixed = ["threshold", "accumulate", *parameters]

    generation = property(lambda self: self.engine.generation)
    _objects = lambda self: self.engine

class PageEngine(AgentEngine):
    """kaju's engine on the page's tables."""

    def __init__(self, model, agent, walls):
        super().__init__(model, model.transfer, agent, walls)
        model.engine, self.space.engine, self.back, self.told = self, self, [], 0
        self._clear()
        for cell, state, size in model.loads:
            place, sense = tuple(cell), SENSES[state // self.lattice.directions]
            box = self.boxes.setdefault(place, LoadBox(self.called, place))
            self._bring(box, Load(state % len(self.opposite), float(size), 1.0, sense))
        self._open_boxes()

    def _look_round(self, place):
        key = sum([(at + 1) * stride for at, stride in zip(place, self.lattice.stride)])
        self.seen[place] = self.model.kinds[key], key, place[1] % self.lattice.forms
        return self.seen[place]

    def _give_back(self, box):
        given = super()._give_back(box)
        self.back.append([self.seen[box.home[0].place][1], given])
        return given

def begin(names, told):
    """Take the last class of agents, boundaries and the order in a code; say what they declare."""
    global engine, _order  # which `from kaju import *` lets alone
    classes, order, spare = {}, None, []
    for value in names.values():
        if isinstance(value, type):
            for name, usual in (BOUNDARIES | {"": MaterialAgent}).items():
                if issubclass(value, usual) and value is not usual:
                    classes[name] = value
                    spare.append(value)
        elif isinstance(value, type(begin)) and (value.__code__.co_varnames or [""])[0] == "waiting":
            order = value
    _order = order = names["order"] if callable(names.get("order")) else order
    if not classes and order is None:
        raise KajuError("class: there is no class of agents; write class Mine(MaterialAgent)")
    numbers = declared(classes.values(), Parameter)
    values = {name: told["parameters"].get(name, p.default) for name, p in numbers.items()}
    named = [one.__name__ for one in (*classes.values(), order) if one]
    spare = [one.__name__ for one in spare if not any([issubclass(own, one) for own in classes.values()])]
    engine = PageEngine(Model(told, values), classes.pop("", MaterialAgent), classes)
    return [
        [[n, p.text or n, p.low or 0, p.high or 0, engine.model.parameters[n], p.whole] for n, p in numbers.items()],
        [[n, s.meaning or n, isinstance(s.default, bool)] for n, s in engine.states.items()], named, spare,
    ]

def generation():
    """Let a generation act; tell what was taken, given back, done and known, and who awoke."""
    engine.begin()
    new, engine.told = list(engine.agents.values())[engine.told :], len(engine.agents)
    born = [[agent._key, engine._arms_to_wakers(agent)] for agent in new]
    states = [[n, a._key, getattr(a, name)] for a in new for n, name in enumerate(engine.states)]
    engine.act(_order)
    engine.end()
    every, axes = range(engine.lattice.directions), range(len(engine.lattice.along))
    taken, done = [], []
    for _, agent, loads in engine.acts:
        taken += [[agent._key, state, load] for state, load in loads.items()]
        done.append([
            agent._key, agent.dropped, *[agent.passed[arm] for arm in every],
            *[agent.squeezed[axis] for axis in axes], *[engine.guard.shortening(agent, axis) for axis in axes], agent.shares.widening,
        ])
    agents = list(engine.agents.values())
    for n, changes in enumerate(engine.changes.values()):
        states += [[n, agents[number]._key, value] for _, number, value in changes]
        changes.clear()
    back, engine.back, engine.acts = engine.back, [], []
    ended = engine.dropped + sum([agent.dropped for agent in agents])
    return [born, taken, back, done, states, engine.pending, engine.absorbed, ended]

def totals():
    """What all have done so far, and what came to each kind of boundary."""
    agents, walls = engine.agents.values(), engine.boundaries.values()
    for agent in {tuple(vars(agent)): agent for agent in agents}.values():  # one of each set of names
        engine.guard.check_books(agent)
    kept, dropped = sum([a.kept for a in agents]), engine.dropped + sum([a.dropped for a in agents])
    arrived = [sum([sum(w.taken.values()) for w in walls if isinstance(w, of)]) for of in BOUNDARIES.values()]
    absorbed = sum([w.kept for w in walls])
    emitted = sum([sum(a.passed.values()) + a.dropped for a in agents])
    entered = sum([load[2] for load in engine.model.loads]) + emitted
    taken = sum([sum(a.taken.values()) for a in agents])
    lost = abs(entered - taken - dropped - engine.pending - absorbed) / (entered or 1.0)
    own = [one for one in engine.boundary_agents.values() if one not in BOUNDARIES.values()]
    idle = [one.__name__ for one in own if not any([isinstance(wall, one) for wall in walls])]
    return [kept, dropped, arrived, engine.returned, absorbed, taken, lost, idle]

def show(*values, sep=" ", end="\n", **rest):
    _page.tell(sep.join([str(value) for value in values]) + end)

for name in ("LoadModel", "Scene", "PrescribedRule", "plot", "export_page"):
    globals()[name] = Elsewhere(name)
for function in (begin, generation, totals, show):
    setattr(_page, function.__name__, function)
