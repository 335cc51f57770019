"""Files that were damaged on their way, and what becomes of whoever reads them.

`python tests/support/damage.py FOLDER SEED FLIPS FORGED` makes a file of every stored kind,
damages copies of them and reads each: FLIPS have bits turned over, are cut short or hold noise,
FORGED are well-formed with something changed. It ends in a line of JSON: how many were refused by
name, how many read, and every other end; "different" is what was read without a word although it
is not what was saved (a forger may say what he likes, so his do not count). A crash ends the
process; the last line printed names the file.
"""

import hashlib
import json
import resource
import signal
import sys
import warnings
import zlib
from pathlib import Path

import numpy as np
from plates import plate as pressed
from spawning_bodies import drawn
from stored_files import joined, parts_of

import kaju
from kaju import ElasticModel, LoadModel, Material, Reference, ThreeElement
from kaju.errors import KajuError
from kaju.model.network import solve as solve_network
from kaju.model.network import triangular
from kaju.model.results.stored import write
from kaju.model.study.sweep import load_sweep

SECONDS = 20
HISTORY = kaju.History.step()


def plate(**changes):
    return pressed([8, 8], [4, 7], [0.3, -2.0], steps=2, **changes)


def slow(*laws):
    """A body of layers that creep, each by its own law."""
    materials = [Material(f"of layer {k}", 2e5, 0.3, rheology=law) for k, law in enumerate(laws)]
    rows = ["abc"[k % len(laws)] * 5 for k in range(4)]
    load = {"cell": [2, 3], "force": [0.0, -2.0]}
    return drawn(rows, materials, [load], rule={"kind": "elastic"})


def contents_of(told):
    """Return a digest of all that was read, to be compared with what was saved."""
    arrays, about = told if isinstance(told, tuple) else ({}, told)
    digest = hashlib.sha256(json.dumps(about, sort_keys=True, default=str).encode())
    for name in sorted(arrays):
        digest.update(f"{name} {arrays[name].dtype} {arrays[name].shape}".encode())
        digest.update(np.ascontiguousarray(arrays[name]).data)
    return digest.hexdigest()


def looked_at(result):
    """Ask a result for what its users ask first; return its contents."""
    json.dumps(result.summary())
    result.to_dataframe()
    scene = getattr(result, "scene", None)
    if scene is not None:
        points = np.full((1, scene.lattice.dimension), 0.011)
        result.displacement_at(points)
        if hasattr(result, "stress_at"):
            result.stress_at(points)
    for more in ("von_mises", "strain"):
        if callable(asked := getattr(result, more, None)):
            asked()
    result.checks()
    arrays = {}
    return contents_of((arrays, write(type(result), result, "", arrays, {})))


def samples(folder):
    """Write one file of every kind; return, by kind, the file to damage and how it is read."""

    def read(path):
        return looked_at(kaju.load_result(path))

    def read_reference(path):
        known = Reference.load(path)
        return contents_of(({"at": known.points, "moved": known.displacement}, known.source))

    soft, firm = ThreeElement(K_f=2e6, D_f=3e6, D_d=4e7), ThreeElement(K_f=1e6, D_f=1e6, D_d=9e7)
    net = triangular(3)
    net = kaju.SpringNetwork.build(
        net.positions, net.springs, held=net.positions[:, 1] < 1e-9,
        forces=np.where(net.positions[:, 1:] > 1.5, [[0.0, -0.01]], 0.0),
    )  # fmt: skip

    def crept(subject, **how):
        return kaju.creep(subject, HISTORY, 1.0, times=[0.5, 1.0], **how)

    answers = {
        "transfer": LoadModel(plate()).run(),
        "cells": kaju.solve(plate()),
        "tree": kaju.solve(plate(), tolerance=0.3),
        "pushes": ElasticModel(plate(rule={"kind": "elastic", "threshold": 1e-3})).run(),
        "network": solve_network(net),
        "element in time": crept(soft),
        "network in time": crept(net, rheology=soft),
        "transfer in time": crept(slow(soft, firm).with_overrides({"rule.kind": "prescribed"})),
        "layers in time": crept(slow(soft, firm)),
        "reference": Reference([[0.0, 0.0], [1.0, 1.0]], [[0.0, 1.0], [2.0, 3.0]], source="known"),
    }
    made = {
        kind: (answer.save(folder / f"{kind}.npz"), read if kind != "reference" else read_reference)
        for kind, answer in answers.items()
    }
    forces = {"loads.0.force": [[0.0, -1.0], [0.0, -2.0]]}
    kaju.sweep(plate(), forces, out=folder / "sweep", workers=1)
    made["sweep"] = (
        folder / "sweep" / "sweep.sqlite",
        lambda path: contents_of(load_sweep(path.parent).to_json()),
    )
    return made


WORDS = [None, True, -1, 0, 10**30, float("nan"), "a", [], {}, [[]], 1e308]


def of_bytes(data, rng):
    """Turn bits over, cut the end off, or put noise in the middle."""
    data = bytearray(data)
    way = rng.integers(3)
    if way == 0:
        for place in rng.integers(len(data), size=rng.integers(1, 4)):
            data[place] ^= 1 << int(rng.integers(8))
    elif way == 1:
        del data[int(rng.integers(len(data))) :]
    else:
        start = int(rng.integers(len(data)))
        noise = rng.bytes(int(rng.integers(1, 64)))
        data[start : start + len(noise)] = noise
    return bytes(data)


def of_array(values, others, rng):
    """Misshape an array, change its kind, or put a number in that has no place there."""
    way = rng.integers(9)
    flat = values.ravel()
    if way == 0:
        return values[..., None]
    if way == 1:
        return flat if values.ndim != 1 else values.reshape(1, -1)
    if way == 2:
        return flat[: max(len(flat) - 1, 0)] if values.ndim < 2 else values[:-1]
    if way == 3:
        return values.astype(rng.choice(["f4", "i4", "u1", "c16", "U5", "i8", "f8", "?", ">f8"]))
    if way == 4:
        return others[int(rng.integers(len(others)))]
    if way == 5:
        return np.concatenate([values, values]) if values.ndim else np.array([values, values])
    if way == 6:
        return values[:0] if values.ndim else np.array([])
    if len(flat) == 0:
        return np.ones(3)
    changed = flat.copy()
    if values.dtype.kind == "f":
        worst = [np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, -1.0]
    elif values.dtype.kind in "iu":
        limits = np.iinfo(values.dtype)
        worst = [limits.min, limits.max, -1 if limits.min else 0, 7, 100]
    else:
        worst = [True, False]
    changed[int(rng.integers(len(changed)))] = worst[int(rng.integers(len(worst)))]
    return changed.reshape(values.shape)


def of_words(value, rng):
    """Change one plain value somewhere inside."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = list(value)[int(rng.integers(len(value)))]
        if rng.random() < 0.1:
            return {name: part for name, part in value.items() if name != key}
        return {**value, key: of_words(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.9:
        place = int(rng.integers(len(value)))
        return [*value[:place], of_words(value[place], rng), *value[place + 1 :]]
    if isinstance(value, str) and len(value) > 40:
        return of_bytes(value.encode(), rng).decode(errors="replace")
    return WORDS[int(rng.integers(len(WORDS)))]


def of_archive(data, rng):
    """Write an archive again, sound as such, with something wrong in it."""
    arrays, about = parts_of(data)
    names = sorted(arrays)
    way = rng.integers(8)
    if way == 0 and about:
        about["format"] = [99, "2", -1, None, 0][int(rng.integers(5))]
    elif way == 1 and names:
        del arrays[names[int(rng.integers(len(names)))]]
    elif way == 2:
        arrays["bomb"] = np.zeros(50_000_000 // 8)
    elif way in (3, 4) or not names:
        about = of_words(about, rng)
    else:
        name = names[int(rng.integers(len(names)))]
        arrays[name] = of_array(arrays[name], list(arrays.values()), rng)
    return joined(arrays, about) if isinstance(about, dict) else b""


def damaged(path, data, rng, way):
    archive = path.suffix == ".npz" and way != "flips"
    return of_archive(data, rng) if archive else of_bytes(data, rng)


def late(*_):
    raise TimeoutError(f"took more than {SECONDS} s")


def main(folder, seed, counts):
    warnings.simplefilter("ignore")
    made = samples(folder)
    saved = {}
    for kind, (path, read) in made.items():
        try:
            saved[kind] = read(path)
        except Exception as error:
            raise SystemExit(f"{kind}: whole, and {error!r}") from error
    base = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    signal.signal(signal.SIGALRM, late)
    ends = {"refused": 0, "read": 0, "raw": [], "different": []}
    whole = {kind: path.read_bytes() for kind, (path, _) in made.items()}
    ways = [way for way, count in counts.items() for _ in range(count)]
    for number, way in enumerate(ways):
        kind = list(made)[number % len(made)]
        path, read = made[kind]
        data = damaged(path, whole[kind], np.random.default_rng([seed, number]), way)
        path.write_bytes(data)
        print(number, way, kind, zlib.crc32(data), flush=True)
        signal.alarm(SECONDS)
        try:
            found = read(path)
            ends["read"] += 1
            # SQLite keeps no checksums: a digit may turn into another.
            if found != saved[kind] and way != "forged" and kind != "sweep":
                ends["different"].append(f"{number} {way} {kind}")
        except KajuError:
            ends["refused"] += 1
        except Exception as error:
            ends["raw"].append(f"{number} {way} {kind}: {type(error).__name__}: {error!s:.80}")
        finally:
            signal.alarm(0)
            path.write_bytes(whole[kind])
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps({**ends, "MB": (most - base) / 1024}))


if __name__ == "__main__":
    flips, forged = map(int, sys.argv[3:5])
    main(Path(sys.argv[1]), int(sys.argv[2]), {"flips": flips, "forged": forged})
