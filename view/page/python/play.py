"""Play a pupil's code in the page's worker: what it may use, and what is told of a run."""

from _random import Random as Twister
from browser import self as worker

SLICE = 64


class Random(Twister):
    """Python's random numbers, from a seed."""

    def __init__(self, seed=1):
        self.seed(seed)

    def uniform(self, low, high):
        return low + (high - low) * self.random()

    def _below(self, n):
        bits = n.bit_length()
        drawn = self.getrandbits(bits)
        while drawn >= n:
            drawn = self.getrandbits(bits)
        return drawn

    def randint(self, low, high):
        return low + self._below(high - low + 1)

    def randrange(self, low, high=None):
        return self._below(low) if high is None else low + self._below(high - low)

    def choice(self, values):
        return values[self._below(len(values))]

    def shuffle(self, values):
        for i in reversed(range(1, len(values))):
            j = self._below(i + 1)
            values[i], values[j] = values[j], values[i]


class Elsewhere:
    """What kaju has and the page has not: imported it may be, used not."""

    def __init__(self, name):
        self.__dict__["name"] = name

    def __call__(self, *given, **named):
        raise KajuError(f"{self.name}: is not in the page, which brings scene and model; it is there in Python at home")

    def __getattr__(self, what):
        raise KajuError(f"{self.name}.{what}: is not in the page; it is there in Python at home")


LoadModel, Scene, PrescribedRule, plot, export_page = map(Elsewhere, ("LoadModel", "Scene", "PrescribedRule", "plot", "export_page"))


def text(value):
    """Return plain data as JSON."""
    if isinstance(value, dict):
        return "{" + ",".join([f"{text(str(k))}:{text(v)}" for k, v in value.items()]) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ",".join([text(v) for v in value]) + "]"
    if isinstance(value, str):
        return worker.JSON.stringify(value)
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return repr(value) if -inf < value < inf else "null"


def show(*values, sep=" ", end="\n", **rest):
    worker.postMessage(text({"print": sep.join([str(v) for v in values]) + end, "at": worker.lineNow()}))


def play(names, told):
    """Run the classes among names on the scene that the page tells."""
    body = eval(told, {"true": True, "false": False, "null": None})
    classes = classes_of(names)
    if not classes:
        raise KajuError("class: there is no class of agents; write one, as in class Mine(MaterialAgent)")
    numbers = values_of(body, classes)
    states = declared(classes.get(0, MaterialAgent), State)
    worker.postMessage(text({
        "parameters": [{"name": n, "label": p.text or n, "low": p.low, "high": p.high, "value": body["parameters"][n],
            "whole": all([isinstance(v, int) for v in (p.default, p.low, p.high)])} for n, p in numbers.items()],
        "states": [[n, s.text or n] for n, s in states.items()], "names": [c.__name__ for c in classes.values()]}))
    model, pieces = Model(body, classes, Random(body["seed"]), Elsewhere("rng")), []
    model.tick = worker.tick
    for news in generations(model):
        pieces.append(news)
        if len(pieces) == SLICE:
            worker.postMessage(text({"news": pieces}))
            pieces = []
    worker.postMessage(text({"news": pieces, "end": summary(model)}))


worker.play = play
worker.show = show
