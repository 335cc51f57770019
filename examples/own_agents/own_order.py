"""An order of work: who acts when. The lowest alone in each step, instead of all."""

from kaju import LoadModel, Scene


def all_at_once(waiting):
    """Let everybody act for whom loads wait."""
    return waiting


def lowest_first(waiting):
    """Let only the agent act that stands lowest, of several the leftmost."""
    return [min(waiting, key=lambda agent: (agent.index[1], agent.index[0]))]


def run(order):
    """Return the result of a steel plate under 2 N."""
    plate = Scene(
        body={"size": [0.1, 0.1], "cells": [10, 10], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [5, 9], "force": [0.0, -2.0]}],
    )
    return LoadModel(plate, order=order, threshold=0.02).run()


if __name__ == "__main__":
    for order in (all_at_once, lowest_first):
        stage = run(order).last
        print(f"{order.__name__:12}: {stage.generations:3} steps, {stage.ledger.taken:.4f} N taken")
