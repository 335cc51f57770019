"""kaju in a page: what agents are and what they answer, in plain Python that Brython runs.

Who is beside whom, which loads meet and which end is the page's own work, in `written.js`. It calls
the functions at the end of this file and is called as `_page`.
"""

from _random import Random as Twister
from browser import self as _page

inf = float("inf")
SENSES = ("push", "pull")


class KajuError(Exception):
    pass


class AgentError(KajuError):
    pass


class ParameterError(KajuError):
    pass


def record(*names, **defaults):
    """Return a class of named tuples."""
    names += tuple(defaults)

    def new(cls, *given, **named):
        values = defaults | dict(zip(names, given)) | named
        if len(given) > len(names) or set(values) != set(names):
            raise TypeError(f"{cls.__name__} has {', '.join(names)}; got {', '.join(values)}")
        return tuple.__new__(cls, [values[name] for name in names])

    def text(self):
        return f"{type(self).__name__}({', '.join([f'{n}={v!r}' for n, v in zip(names, self)])})"

    own = {name: property(lambda self, at=at: self[at]) for at, name in enumerate(names)}
    own["_replace"] = lambda self, **named: type(self)(**(dict(zip(names, self)) | named))
    return type("record", (tuple,), own | {"__new__": new, "__repr__": text, "names": names})


class Load(record("direction", "magnitude", copies=1.0, sense="push")):
    total = property(lambda self: self[1] * self[2])

    def turned(self):
        return self._replace(sense="pull" if self[3] == "push" else "push")


class Emission(record("arm", "direction", "share", sense="push")):
    pass


class Shares(record("own", "forward", "backward", "friction", "poisson", widening=0.0)):
    pass


class Material(record("name", "youngs_modulus", "poissons_ratio")):
    pass


class Emissions(tuple):
    """What follows from shares, and need not be looked at."""


class Amounts(dict):
    def __missing__(self, number):
        return 0.0


class Parameter:
    def __init__(self, default, low=None, high=None, text=""):
        self.default, self.low, self.high, self.text = default, low, high, text
        if not isinstance(default, bool) and not (None not in (low, high) and low <= default <= high):
            raise ParameterError(
                f"low, high: a Parameter needs both bounds, as in Parameter({default!r}, 0, 10, "
                f'"what it means"), got {low!r} and {high!r}'
            )

    def __set_name__(self, owner, name):
        self.name = name

    def __get__(self, agent, owner=None):
        return self if agent is None else agent.model.parameters[self.name]

    def __set__(self, agent, value):
        raise ParameterError(f"{self.name}: is a Parameter, one number for all agents, and cannot be set on one of them")


class State:
    def __init__(self, default, meaning=""):
        self.default, self.meaning = default, meaning
        if not isinstance(default, (int, float)):
            raise ParameterError(f"State: its default must be a number, True or False, got {default!r:.60}")

    def __set_name__(self, owner, name):
        self.name = name

    def __get__(self, agent, owner=None):
        return self if agent is None else agent.__dict__.get(self.name, self.default)

    def __set__(self, agent, value):
        agent.__dict__[self.name] = value


class PlacedAgent:
    def __init__(self, model, cell):
        self.model, self.cell, self.index, self.pos = model, cell, cell, cell
        self.spawn_step, self.random, self.rng = model.generation + 1, model.random, model.rng
        self.taken, self.passed, self.kept = Amounts(), Amounts(), 0.0


class MaterialAgent(PlacedAgent):
    def __init__(self, model, cell, material, shares):
        super().__init__(model, cell)
        self.material, self.shares, self.key = material, shares, model.making
        self.pulled, self.squeezed, self.inbox, self.dropped = Amounts(), Amounts(), {}, 0.0

    woken_by = property(lambda self: [self.model.agents[key] for key in _page.wakers(self.key)])

    def step(self):
        loads, self.inbox = self.waiting(), {}
        for load in loads:
            before = self.kept
            self.take(load)
            kept = self.kept - before
            self.squeezed[self.model.axes[load[0]]] += kept if load[3] == "push" else -kept
            self.pass_on(load)
        if not -inf < self.kept < inf:
            raise wrong(self, "take", f"has kept {self.kept} N")

    def waiting(self):
        loads = [tuple.__new__(Load, (d, m, n, s)) for (d, m, s), n in self.inbox.items()]
        return sorted(loads, key=lambda load: load[3] == "pull") if self.model.sense else loads

    def take(self, load):
        direction, magnitude, copies, sense = load
        self.taken[direction] += magnitude * copies
        if sense == "pull":
            self.pulled[direction] += magnitude * copies
        self.kept += self.shares[0] * magnitude * copies

    def emissions(self, load):
        return emissions_of(self)[load[3], load[0]]

    def pass_on(self, load):
        self.send(self.emissions(load), load)

    def send(self, emissions, load):
        _, magnitude, copies, _ = load
        for arm, direction, share, sense in emissions if type(emissions) is Emissions else checked(self, emissions):
            size = share * magnitude
            if not 0.0 <= size < inf:
                raise wrong(self, "pass_on", f"would hand over {size} N")
            if _page.hand(self.key, arm, direction, size, copies, sense == "pull"):
                self.passed[arm] += size * copies
            else:
                self.dropped += size * copies

    def shortening(self, axis):
        return self.squeezed[axis] / (self.model.cross_section * self.material[1])


class BoundaryAgent(PlacedAgent):
    def answer(self, load, arm):
        back = self.give_back(load, arm)
        if back is not None:
            back = checked_load(self, "give_back", back, 0)
            if back.total > load.total * (1.0 + 1e-12):
                raise wrong(self, "give_back", f"gives back {back.total:g} N of {load.total:g} N; what pushes on its own is a load of the scene")
        return back

    def give_back(self, load, arm):
        return self.turn(load, arm)


class FreeBoundaryAgent(BoundaryAgent):
    def turn(self, load, arm):
        return load.turned() if self.model.sense and self.model.heading(load) == arm else load


class RigidBoundaryAgent(BoundaryAgent):
    def turn(self, load, arm):
        return load._replace(direction=self.model.lattice.opposite[load[0]])


class RollerBoundaryAgent(BoundaryAgent):
    def turn(self, load, arm):
        return load._replace(direction=self.model.lattice.mirrored[arm][load[0]])


USUAL = {-1: FreeBoundaryAgent, -2: RigidBoundaryAgent, -3: RollerBoundaryAgent}


class Table:
    def __init__(self, table):
        self.__dict__.update(table)


class Model:
    """What agents know of the run: the lattice, the rule, the generation."""

    def __init__(self, told, classes, parameters):
        self.__dict__.update(told)  # threshold, accumulate, sense, cross_section, kinds, ...
        self.lattice, self.classes, self.parameters = Table(told["lattice"]), USUAL | classes, parameters
        self.materials = [Material(*row) for row in told["materials"]]
        self.shares = [Shares(*row) for row in told["shares"]]
        self.axes, self.every = self.lattice.axis_of, range(self.lattice.directions)
        self.generation, self.agents, self.boundaries, self.sent, self.making = 0, {}, {}, {}, 0
        self.random, self.rng = Random(), Elsewhere("rng")
        self.random.seed(told["seed"])

    def heading(self, load):
        return load[0] if load[3] == "push" else self.lattice.opposite[load[0]]

    def axis_of(self, direction):
        return self.axes[direction]

    def agent_at(self, index):
        return next((a for a in self.agents.values() if a.index == tuple(index)), None)

    def hand_over(self, sender, arm, load):
        if not isinstance(sender, MaterialAgent):
            raise AgentError(f"hand_over: who hands over comes first, as in hand_over(self, arm, load), got {sender!r:.60}")
        load = checked_load(sender, "hand_over", load, arm)
        sender.send([Emission(arm, load[0], 1.0, load[3])], load)


# What agents of one's own answer is looked at, in the sentences of kaju.

NO_EMISSION = ", which is no Emission: (arm, direction, share, sense)"


def wrong(agent, hook, what):
    return AgentError(f"{hook}: {type(agent).__name__} at cell {agent.index} in generation {model.generation} {what}")


def amount(value):
    return isinstance(value, (int, float)) and 0.0 <= value < inf


def fits(arm, direction, sense, *amounts):
    every = model.every
    return arm in every and direction in every and sense in SENSES[: 1 + model.sense] and all([amount(a) for a in amounts])


def limits(arms):
    over = f"an arm of {tuple(model.every)}, " if arms else ""
    senses = " or ".join([repr(sense) for sense in SENSES[: 1 + model.sense]])
    return f"; it has {over}a direction from 0 to {len(model.every) - 1}, an amount that is finite and not negative, and the sense {senses}"


def emissions_of(agent):
    shares = agent.shares
    sent = model.sent.get(shares) if isinstance(shares, Shares) else None
    if sent is None:
        if not isinstance(shares, Shares):
            raise wrong(agent, "shares", f"must have kaju.Shares, has {shares!r:.60}")
        for name, share in zip(Shares.names[:5], shares):
            if not (amount(share) or (name == "poisson" and model.sense and -inf < share < inf)):
                raise wrong(agent, "shares", f"has the share {name!r} = {share!r}, which must be a number from 0 upwards")
        sent = model.sent[shares] = {}
        for sense in SENSES[: 1 + model.sense]:
            for d in model.every:
                rows = _page.emissions(list(shares[:5]), d, sense == "pull")
                sent[sense, d] = Emissions([Emission(arm, way, float(share), SENSES[pull]) for arm, way, share, pull in rows])
    return sent


def checked(agent, sent):
    rows = []
    try:
        sent = iter(sent)
    except TypeError:
        raise wrong(agent, "emissions", f"returned {sent!r:.60}{NO_EMISSION}") from None
    for row in sent:
        try:
            arm, direction, share, sense = row
            right = fits(arm, direction, sense, share)
        except (TypeError, ValueError):
            raise wrong(agent, "emissions", f"returned {row!r:.60}{NO_EMISSION}") from None
        if not right:
            raise wrong(agent, "emissions", f"returned {row!r:.120}{limits(True)}")
        rows.append((int(arm), int(direction), share, sense))
        if len(rows) > 1000:
            raise wrong(agent, "emissions", "returned more than 1000 for a load")
    return rows


def checked_load(agent, hook, load, arm):
    own = isinstance(agent, MaterialAgent)
    try:
        direction, magnitude, copies, sense = load
        right = fits(arm, direction, sense, magnitude, copies)
    except (TypeError, ValueError):
        right = False
    if not right:
        raise wrong(agent, hook, f"hands over {load!r:.100}{f' over arm {arm!r}' if own else ''}{limits(own)}")
    return Load(int(direction), float(magnitude), float(copies), sense)


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


# What the page calls.


def declared(classes, kind):
    return {n: value for cls in classes.values() for n in dir(cls) if isinstance(value := getattr(cls, n, None), kind)}


def begin(names, told):
    """Find the last class of agents, boundaries and the order in a code; say what they declare."""
    global model, order, states
    classes, order, given = {}, None, told["parameters"]
    for value in names.values():
        if isinstance(value, type):
            for kind, usual in (USUAL | {0: MaterialAgent}).items():
                if issubclass(value, usual) and value is not usual:
                    classes[kind] = value
        elif isinstance(value, type(begin)) and value.__code__.co_varnames[:1] == ("waiting",):
            order = value
    if not classes and order is None:
        raise KajuError("class: there is no class of agents; write one, as in class Mine(MaterialAgent)")
    numbers = declared(classes, Parameter)
    states = declared({0: classes.get(0, MaterialAgent)}, State)
    model = Model(told, classes, {n: given.get(n, p.default) for n, p in numbers.items()})
    return {
        "parameters": [
            {"name": n, "label": p.text or n, "low": p.low, "high": p.high, "value": model.parameters[n],
            "whole": all([isinstance(v, int) for v in (p.default, p.low, p.high)])}
            for n, p in numbers.items()
        ],
        "states": [[n, s.meaning or n] for n, s in states.items()],
        "names": [c.__name__ for c in (*classes.values(), *([order] if order else []))],
        "walls": [kind for kind in classes if kind],
        "ordered": order is not None,
    }


def wake(key, kind, cell):
    """An agent for a cell that a load has reached."""
    model.making = key
    if kind < 0:
        agent = model.boundaries[key] = model.classes[kind](model, tuple(cell))
    else:
        cls = model.classes.get(0, MaterialAgent)
        agent = model.agents[key] = cls(model, tuple(cell), model.materials[kind], model.shares[kind])
    if not hasattr(agent, "passed"):
        raise AgentError(f"__init__: {type(agent).__name__} at cell {tuple(cell)} in generation {model.generation} must call super().__init__ with all that it is given")


def put(key, direction, magnitude, copies, sense):
    box, at = model.agents[key].inbox, (direction, float(magnitude), sense)
    box[at] = box.get(at, 0.0) + copies


def choose(keys):
    """Let the order choose who acts; the loads of the others wait."""
    waiting = [model.agents[key] for key in keys]
    chosen = [agent.key for agent in order(waiting)]
    for agent in waiting:
        if agent.key not in chosen:
            agent.inbox = {}
    return chosen


def act(generation, key):
    model.generation = generation
    model.agents[key].step()


def answer(key, direction, magnitude, copies, sense, arm):
    back = model.boundaries[key].answer(Load(direction, float(magnitude), float(copies), sense), arm)
    return None if back is None else list(back)


def doing(key):
    """What an agent has done so far: let end, passed by arm, kept and shortened by axis, states."""
    agent = model.agents[key]
    axes = range(len(model.lattice.along))
    short = [agent.shortening(axis) for axis in axes]
    for value in short:
        if not (isinstance(value, (int, float)) and -inf < value < inf):
            raise wrong(agent, "shortening", f"must answer a finite number, got {value!r:.60}")
    known = [getattr(agent, name) for name in states]
    for name, value in zip(states, known):
        if not (isinstance(value, (int, float)) and -inf < value < inf):
            raise wrong(agent, name, f"must be a number, and is {value!r:.60}")
    passed, kept = [agent.passed[arm] for arm in model.every], [agent.squeezed[axis] for axis in axes]
    return [agent.dropped, *passed, *kept, *short, agent.shares[5], *known]


def totals():
    """What all have kept and let end."""
    agents = model.agents.values()
    return [sum([agent.kept for agent in agents]), sum([agent.dropped for agent in agents])]


def show(*values, sep=" ", end="\n", **rest):
    _page.tell(sep.join([str(v) for v in values]) + end)


LoadModel, Scene, PrescribedRule, plot, export_page = map(Elsewhere, ("LoadModel", "Scene", "PrescribedRule", "plot", "export_page"))
for function in (begin, wake, put, choose, act, answer, doing, totals, show):
    setattr(_page, function.__name__, function)
