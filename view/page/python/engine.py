"""kaju in a page: agents as objects, in plain Python that Brython runs. Numbers are kaju's to 1e-12.

`run` plays one stage. Its tables (who is beside whom, what boundaries do) come from the page.
"""

inf = float("inf")


class KajuError(Exception):
    """What agents of one's own do wrong, in the sentences of kaju."""


class AgentError(KajuError):
    pass


class ParameterError(KajuError):
    pass


class Record(tuple):
    """A named tuple: `fields` and the `defaults` of the last of them."""

    fields = defaults = ()

    def __new__(cls, *given, **named):
        rest = cls.fields[len(given) :]
        for name in named:
            if name not in rest:
                raise TypeError(f"{cls.__name__}() got an unexpected keyword argument '{name}'")
        values = dict(zip(cls.fields[::-1], cls.defaults[::-1])) | named
        for name in rest:
            if name not in values:
                raise TypeError(f"{cls.__name__}() needs '{name}'")
        return tuple.__new__(cls, (*given, *[values[name] for name in rest]))

    def _replace(self, **named):
        return type(self)(**(dict(zip(self.fields, self)) | named))

    def __repr__(self):
        return f"{type(self).__name__}({', '.join(f'{n}={v!r}' for n, v in zip(self.fields, self))})"


class Load(Record):
    fields, defaults = ("direction", "magnitude", "copies", "sense"), (1.0, "push")
    direction, magnitude = property(lambda self: self[0]), property(lambda self: self[1])
    copies, sense = property(lambda self: self[2]), property(lambda self: self[3])
    total = property(lambda self: self[1] * self[2])

    def turned(self):
        return self._replace(sense=OTHER[self.sense])


class Emission(Record):
    fields, defaults = ("arm", "direction", "share", "sense"), ("push",)
    arm, direction = property(lambda self: self[0]), property(lambda self: self[1])
    share, sense = property(lambda self: self[2]), property(lambda self: self[3])


class Shares(Record):
    fields = ("own", "forward", "backward", "friction", "poisson", "widening")
    defaults = (0.0,)
    own, forward = property(lambda self: self[0]), property(lambda self: self[1])
    backward, friction = property(lambda self: self[2]), property(lambda self: self[3])
    poisson, widening = property(lambda self: self[4]), property(lambda self: self[5])


class Material(Record):
    fields = ("name", "youngs_modulus", "poissons_ratio")
    name, youngs_modulus = property(lambda self: self[0]), property(lambda self: self[1])
    poissons_ratio = property(lambda self: self[2])


OTHER = {"push": "pull", "pull": "push"}


class Amounts(dict):
    def __missing__(self, number):
        return 0.0


class Emissions(tuple):
    """Emissions that follow from shares: right, and split once for loads of one size."""

    def __init__(self, rows):
        self.parted = {}


class Parameter:
    """A number of a class of agents: a slider."""

    def __init__(self, default, low=None, high=None, text=""):
        if not isinstance(default, bool) and not (low is not None and high is not None and low <= default <= high):
            raise ParameterError(f"low, high: a Parameter needs both bounds, as in Parameter({default!r}, 0, 10, \"what it means\"), got {low!r} and {high!r}")
        self.default, self.low, self.high, self.text = default, low, high, text

    def __set_name__(self, owner, name):
        self.name = name

    def __get__(self, agent, owner=None):
        return self if agent is None else agent.model.parameters[self.name]

    def __set__(self, agent, value):
        raise ParameterError(f"{self.name}: is a Parameter, one number for all agents, and cannot be set on one of them")


class State:
    """What each agent knows of itself, shown as colours."""

    def __init__(self, default=0.0, text=""):
        self.default, self.text = default, text

    def __set_name__(self, owner, name):
        self.name = name

    def __get__(self, agent, owner=None):
        return self if agent is None else agent.__dict__.get(self.name, self.default)

    def __set__(self, agent, value):
        agent.__dict__[self.name] = value


def declared(cls, kind):
    found = {}
    for name in dir(cls):
        value = getattr(cls, name, None)
        if isinstance(value, kind):
            found[name] = value
    return found


class PlacedAgent:
    def __init__(self, model, cell):
        self.model, self.cell, self.index, self.pos = model, cell, cell, cell
        self.spawn_step, self.random, self.rng = model.generation + 1, model.random, model.rng
        self.taken, self.passed, self.kept = Amounts(), Amounts(), 0.0
        self.unique_id = model.numbered = model.numbered + 1


class MaterialAgent(PlacedAgent):
    """A cell of material that a load has woken."""

    def __init__(self, model, cell, material, shares):
        super().__init__(model, cell)
        self.material, self.shares, self.key = material, shares, model.key(cell)
        self.woken_by, self.dropped = [], 0.0
        self.pulled, self.squeezed = Amounts(), Amounts()
        self.inbox, self.coming, self.fresh = {}, {}, True
        self.around = model.around(self.key)

    def take(self, load):
        direction, magnitude, copies, sense = load
        total = magnitude * copies
        self.taken[direction] += total
        if sense == "pull":
            self.pulled[direction] += total
        self.kept += self.shares[0] * total

    def emissions(self, load):
        return self.model.emissions_of(self)[load[3], load[0]]

    def pass_on(self, load):
        self.send(self.emissions(load), load)

    def step(self):
        loads, self.inbox = self.waiting(), {}
        for load in loads:
            before = self.kept
            self.take(load)
            kept = self.kept - before
            self.squeezed[self.model.axes[load[0]]] += kept if load[3] == "push" else -kept
            self.pass_on(load)
        if not -inf < self.kept < inf:
            raise self.model.wrong(self, "take", f"has kept {self.kept} N")

    def waiting(self):
        loads = [tuple.__new__(Load, (d, m, n, s)) for (s, d, m), n in self.inbox.items()]
        return sorted(loads, key=lambda load: load[3] == "pull") if self.model.sense else loads

    def send(self, emissions, load):
        _, magnitude, copies, _ = load
        model, passed = self.model, self.passed
        for arm, direction, size, sense, goes in model.split(self, emissions, magnitude):
            if not goes:
                self.dropped += size * copies
                continue
            passed[arm] += size * copies
            key, kind = self.around[arm]
            if kind < 0 or model.accumulate:
                model.meet(self, arm, key, kind, (sense, direction, size), copies)
            else:
                model.agent(key, kind).put((sense, direction, size), copies, self)

    def put(self, load, copies, sender):
        if not self.coming:
            self.model.called.append(self)
        self.coming[load] = self.coming.get(load, 0.0) + copies
        if self.fresh and sender is not None and sender not in self.woken_by:
            self.woken_by.append(sender)

    def shortening(self, axis):
        return self.squeezed[axis] / (self.model.cross_section * self.material[1])


class BoundaryAgent(PlacedAgent):
    """A cell beside the body: it gives loads back."""

    returned = 0.0

    def answer(self, load, arm):
        back = self.give_back(load, arm)
        if back is not None:
            back = self.model.checked_return(self, load, back)
        given = 0.0 if back is None else back.total
        self.taken[load[0]] += load.total
        self.passed[self.model.lattice.opposite[arm]] += given
        self.returned += given
        self.kept += load.total - given
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
MOST_GROWTH, MOST_SENT, MOST_GENERATIONS = 1000.0, 1000, 4000  # as in kaju; the last: a page's


class Table:
    """Numbers of the lattice, by name."""

    def __init__(self, table):
        self.__dict__.update(table)


class Model:
    """One stage of loading; `body` holds the page's tables, `classes` agents by kind of cell."""

    def __init__(self, body, classes, random=None, rng=None):
        self.body, self.random, self.rng, self.numbered = body, random, rng, 0
        self.lattice, self.classes = Table(body["lattice"]), USUAL | classes
        self.threshold, self.accumulate = body["threshold"], body["accumulate"]
        self.sense, self.cross_section = body["sense"], body["cross_section"]
        self.axes, self.kinds = self.lattice.axis_of, body["kinds"]
        self.materials = [Material(*row) for row in body["materials"]]
        self.shares = [Shares(*row) for row in body["shares"]]
        self.every = range(self.lattice.directions)
        self.parameters, self.generation, self.pending = body["parameters"], 0, 0.0
        self.agents, self.boundaries, self.called, self.leaving = {}, {}, [], []
        self.sums, self.sent, self.rows, self.given = {}, {}, {}, {}
        self.applied = sum([load[2] for load in body["loads"]])
        for key, state, size in body["loads"]:
            sense = "pull" if state >= self.lattice.directions else "push"
            self.bring(key, Load(state % self.lattice.directions, size, 1.0, sense))
        self.open()

    def key(self, cell):
        return sum([(c + 1) * s for c, s in zip(cell, self.lattice.stride)])

    def cell_of(self, key):
        table = self.lattice
        return tuple([key // s % n - 1 for s, n in zip(table.stride, table.padded)])

    def around(self, key):
        steps = self.lattice.steps[(key % self.lattice.padded[1] - 1) % 2]
        return [(key + step, self.kinds[key + step]) for step in steps]

    def tick(self):
        """Whoever waits learns that another agent acts."""

    def heading(self, load):
        return load[0] if load[3] == "push" else self.lattice.opposite[load[0]]

    def axis_of(self, direction):
        return self.axes[direction]

    def agent_at(self, index):
        return self.agents.get(self.key(index))

    # One generation.

    def step(self):
        self.generation += 1
        agents = list(self.agents.values())
        for agent in agents:
            agent.fresh = False
        for agent in agents:
            if agent.inbox:
                self.tick()
                self.note(agent)
                agent.step()
        self.judge(True)
        leaving, self.leaving = self.leaving, []
        for boundary, load, sender, arm in leaving:
            back = boundary.answer(load, arm)
            if back is not None:
                self.given[sender.key] = self.given.get(sender.key, 0.0) + back.total
                self.bring(sender.key, back)
        self.open()

    def open(self):
        self.judge(False)
        called, self.called, self.pending = self.called, [], 0.0
        for agent in called:
            agent.inbox, agent.coming = agent.coming, {}
            self.pending += sum([load[2] * n for load, n in agent.inbox.items()])

    def note(self, agent):
        for (sense, direction, size), copies in agent.inbox.items():
            state = direction + (self.lattice.directions if sense == "pull" else 0)
            place = agent.key * self.lattice.states + state
            self.rows[place] = self.rows.get(place, 0.0) + size * copies

    def bring(self, key, load):
        direction, size, copies, sense = load
        if self.accumulate:
            self.meet(None, -1, key, self.kinds[key], (sense, direction, size), copies)
        elif size > self.threshold:
            self.agent(key, self.kinds[key]).put((sense, direction, size), copies, None)

    def meet(self, sender, arm, key, kind, load, copies):
        """Add loads up where they meet, or let one wait at a boundary."""
        sense, direction, size = load
        if not self.accumulate:
            self.leaving.append((self.boundary(key, kind), Load(direction, size, copies, sense), sender, arm))
            return
        place = (key, kind, direction, sense, *((sender, arm) if kind < 0 else (None, -1)))
        total, senders = self.sums.get(place, (0.0, []))
        self.sums[place] = total + size * copies, [*senders, sender]

    def judge(self, at_boundary):
        for place in [place for place in self.sums if (place[1] < 0) == at_boundary]:
            (key, kind, direction, sense, sender, arm), (total, senders) = place, self.sums.pop(place)
            if not total > self.threshold:
                continue
            if at_boundary:
                self.leaving.append((self.boundary(key, kind), Load(direction, total, 1.0, sense), sender, arm))
            else:
                agent = self.agent(key, kind)
                agent.put((sense, direction, total), 1.0, None)
                if agent.fresh:
                    agent.woken_by += [s for s in dict.fromkeys(senders) if s and s not in agent.woken_by]

    def agent(self, key, kind):
        agent = self.agents.get(key)
        if agent is None:
            cls = self.classes.get(0, MaterialAgent)
            agent = cls(self, self.cell_of(key), self.materials[kind], self.shares[kind])
            self.begun(agent, "around")
            self.agents[key] = agent
        return agent

    def boundary(self, key, kind):
        agent = self.boundaries.get(key)
        if agent is None:
            agent = self.classes[kind](self, self.cell_of(key))
            self.begun(agent, "passed")
            self.boundaries[key] = agent
        return agent

    # What agents of one's own answer is looked at.

    def wrong(self, agent, hook, what):
        return AgentError(f"{hook}: {type(agent).__name__} at cell {agent.index} in generation {self.generation} {what}")

    def begun(self, agent, last):
        if not hasattr(agent, last):
            raise AgentError(f"__init__: {type(agent).__name__} must call super().__init__ with all that it is given")

    def emissions_of(self, agent):
        if not isinstance(agent.shares, Shares):
            raise self.wrong(agent, "shares", f"must have kaju.Shares, has {agent.shares!r}")
        sent = self.sent.get(agent.shares)
        if sent is None:
            for name, share in zip(Shares.fields[:5], agent.shares):
                if not (amount(share) or (name == "poisson" and self.sense and -inf < share < inf)):
                    raise self.wrong(agent, "shares", f"has the share {name!r} = {share!r}, which must be a number from 0 upwards")
            sent = self.sent[agent.shares] = {
                (sense, d): Emissions(self.rule(agent.shares, d, sense))
                for sense in ("push", "pull") for d in self.every
            }
        return sent

    def rule(self, shares, direction, sense):
        """Return what a load sends out by the standard rule, for each newton."""
        _, forward, backward, friction, poisson, _ = shares
        opposite = self.lattice.opposite
        ahead = direction if sense == "push" else opposite[direction]
        out = sense if poisson >= 0.0 else OTHER[sense]
        rows = [(ahead, direction, forward, sense), (opposite[ahead], direction, backward, OTHER[sense])]
        for arm, along, across in self.lattice.beside[ahead]:
            rows.append((arm, direction, friction * along, sense))
            rows.append((arm, arm if out == "push" else opposite[arm], abs(poisson) * across, out))
        rows = [row for row in rows if row[2] > 0.0]
        return [Emission(*row[:3], row[3] if self.sense else "push") for row in rows]

    def split(self, agent, emissions, magnitude):
        """Part what leaves for a load: size, and whether it goes on."""
        known = type(emissions) is Emissions
        least, rows = 0.0 if self.accumulate else self.threshold, []
        if known and magnitude in emissions.parted:
            return emissions.parted[magnitude]
        for arm, direction, share, sense in emissions if known else self.checked(agent, emissions):
            size = share * magnitude
            if not 0.0 <= size < inf:
                raise self.wrong(agent, "pass_on", f"would hand over {size} N")
            rows.append((arm, direction, size, sense, size > least))
        if known:
            emissions.parted[magnitude] = rows
        return rows

    def checked(self, agent, sent):
        rows = []
        try:
            sent = iter(sent)
        except TypeError:
            raise self.wrong(agent, "emissions", f"returned {sent!r:.60}{NO_EMISSION}") from None
        for row in sent:
            try:
                arm, direction, share, sense = row
                fits = self.fits(arm, direction, sense, share)
            except (TypeError, ValueError):
                raise self.wrong(agent, "emissions", f"returned {row!r:.60}{NO_EMISSION}") from None
            if not fits:
                raise self.wrong(agent, "emissions", f"returned {row!r:.120}{self.limits(True)}")
            rows.append((int(arm), int(direction), share, sense))
            if len(rows) > MOST_SENT:
                raise self.wrong(agent, "emissions", f"returned more than {MOST_SENT} for a load")
        return rows

    def fits(self, arm, direction, sense, *amounts):
        senses = ("push", "pull") if self.sense else ("push",)
        return arm in self.every and direction in self.every and sense in senses and all([amount(a) for a in amounts])

    def limits(self, arms):
        over = f"an arm of {tuple(self.every)}, " if arms else ""
        senses = "'push' or 'pull'" if self.sense else "'push'"
        return f"; it has {over}a direction from 0 to {len(self.every) - 1}, an amount that is finite and not negative, and the sense {senses}"

    def checked_load(self, agent, hook, load, arm):
        own = isinstance(agent, MaterialAgent)
        try:
            direction, magnitude, copies, sense = load
            fits = self.fits(arm, direction, sense, magnitude, copies)
        except (TypeError, ValueError):
            fits = False
        if not fits:
            raise self.wrong(agent, hook, f"hands over {load!r:.100}{f' over arm {arm!r}' if own else ''}{self.limits(own)}")
        return Load(int(direction), float(magnitude), float(copies), sense)

    def hand_over(self, sender, arm, load):
        if not isinstance(sender, MaterialAgent):
            raise AgentError(f"hand_over: who hands over comes first, as in hand_over(self, arm, load), got {sender!r:.60}")
        load = self.checked_load(sender, "hand_over", load, arm)
        sender.send([Emission(arm, load[0], 1.0, load[3])], load)

    def checked_return(self, boundary, load, back):
        back = self.checked_load(boundary, "give_back", back, 0)
        if back.total > load.total * (1.0 + 1e-12):
            raise self.wrong(boundary, "give_back", f"gives back {back.total:g} N of {load.total:g} N; what pushes on its own is a load of the scene")
        return back


NO_EMISSION = ", which is no Emission: (arm, direction, share, sense)"


def amount(value):
    return isinstance(value, (int, float)) and 0.0 <= value < inf


# A run, generation by generation, as the page's history has it.


def classes_of(names):
    """Return the last class of agents among the names of a code, by the kind of cell it stands for."""
    found = {}
    for cls in [value for value in names.values() if isinstance(value, type)]:
        if issubclass(cls, MaterialAgent) and cls is not MaterialAgent:
            found[0] = cls
        for kind, usual in USUAL.items():
            if issubclass(cls, usual) and cls is not usual:
                found[kind] = cls
    return found


def values_of(body, classes):
    """Return the parameters that classes declare, and their values."""
    all_declared = {}
    for cls in classes.values():
        all_declared |= declared(cls, Parameter)
    given = body["parameters"]
    body["parameters"] = {n: given.get(n, p.default) for n, p in all_declared.items()}
    return all_declared


def generations(model, most=MOST_GENERATIONS):
    """Play a model; yield what each generation has brought."""
    told, seen = {}, 0
    own = model.classes.get(0, MaterialAgent)
    states, every = declared(own, State), own.shortening is not MaterialAgent.shortening
    while model.pending > 0.0 and model.generation < most:
        acting = [agent for agent in model.agents.values() if agent.inbox]
        born = [a for a in acting if a.spawn_step == model.generation + 1]
        model.rows, model.given = {}, {}
        news = {"born": [[a.key, arms_to_wakers(model, a)] for a in born]}
        model.step()
        changes = {name: {} for name in ("passed", "dropped", "kept", "stretch", *states)}
        for agent in list(model.agents.values()) if every or states else acting:
            for place, value in doings(model, agent, states):
                before = told.get(place, 0.0)
                if value != before:
                    name, at = place
                    told[place] = value
                    changes[name][at] = value - before
        news |= {"taken": model.rows, "returned": model.given, **changes, "pending": model.pending}
        yield news
        if not model.pending <= MOST_GROWTH * model.applied:
            return


def doings(model, agent, states):
    """Return what an agent has done so far: (what, place in the page's tables), amount."""
    count, axes, key = model.lattice.directions, model.lattice.along, agent.key
    squeezed = [agent.shortening(axis) for axis in range(len(axes))]
    for short in squeezed:
        if not (isinstance(short, (int, float)) and -inf < short < inf):
            raise model.wrong(agent, "shortening", f"must answer a finite number, got {short!r:.60}")
    found = [(("dropped", key), agent.dropped)]
    found += [(("passed", key * count + arm), load) for arm, load in agent.passed.items()]
    for axis, row in enumerate(axes):
        at, wide = key * len(axes) + axis, agent.shares[5]
        long = sum([short * (wide * (1.0 - part) - part) for short, part in zip(squeezed, row)])
        found += [(("kept", at), agent.squeezed[axis]), (("stretch", at), long * model.lattice.cell_size)]
    return found + [((name, key), float(getattr(agent, name))) for name in states]


def arms_to_wakers(model, agent):
    keys = [waker.key for waker in agent.woken_by]
    return sum([1 << arm for arm, (key, _) in enumerate(agent.around) if key in keys])


def summary(model):
    agents = list(model.agents.values())
    taken = sum([sum(agent.taken.values()) for agent in agents])
    kept = sum([agent.kept for agent in agents])
    dropped = sum([agent.dropped for agent in agents])
    passed = sum([sum(agent.passed.values()) for agent in agents])
    ground = sum([sum(b.taken.values()) for b in model.boundaries.values()])
    absorbed = sum([b.kept for b in model.boundaries.values()])
    return {"agents": len(agents), "generations": model.generation, "taken": taken, "kept": kept, "passed": passed,
        "dropped": dropped, "arrived": ground, "absorbed": absorbed, "pending": model.pending}
