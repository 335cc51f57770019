"""How quickly the tangent of a spring network is assembled.

Compares the assembler with a loop over the edges of the networkx graph that adds each
spring's block into a sparse matrix, the plainest program that does the same. Prints the
median times, their ratio, and the largest difference of the two matrices.

    python benchmarks/network_assembly.py [nodes in a row ...]
"""

import statistics
import sys
import time

import networkx as nx
import numpy as np
from scipy.sparse import csc_array, lil_array

from kaju.model.network import Assembler, SpringNetwork, triangular


def looped(graph: nx.Graph, number: dict, size: int) -> csc_array:
    tangent = lil_array((size, size))
    for a, b, edge in graph.edges(data=True):
        ends = np.subtract(graph.nodes[a]["pos"], graph.nodes[b]["pos"])
        length = np.linalg.norm(ends)
        along = np.outer(ends, ends) / length**2
        share = edge["rest_length"] / length
        block = edge["stiffness"] * ((1.0 - share) * np.eye(2) + share * along)
        i, j = number[a], number[b]
        for p in range(2):
            for q in range(2):
                tangent[2 * i + p, 2 * i + q] += block[p, q]
                tangent[2 * j + p, 2 * j + q] += block[p, q]
                tangent[2 * i + p, 2 * j + q] -= block[p, q]
                tangent[2 * j + p, 2 * i + q] -= block[p, q]
    return tangent.tocsc()


def looped_triplets(graph: nx.Graph, number: dict, size: int) -> csc_array:
    """Do the same, but collect triplets, which spares the sparse matrix's own cost."""
    rows, columns, values = [], [], []
    for a, b, edge in graph.edges(data=True):
        (ax, ay), (bx, by) = graph.nodes[a]["pos"], graph.nodes[b]["pos"]
        dx, dy = ax - bx, ay - by
        square = dx * dx + dy * dy
        share = edge["rest_length"] / square**0.5
        k = edge["stiffness"]
        block = (
            k * (1.0 - share + share * dx * dx / square),
            k * share * dx * dy / square,
            k * share * dx * dy / square,
            k * (1.0 - share + share * dy * dy / square),
        )
        i, j = 2 * number[a], 2 * number[b]
        for r, c, sign in ((i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)):
            rows += (r, r, r + 1, r + 1)
            columns += (c, c + 1, c, c + 1)
            values += [sign * value for value in block]
    return csc_array((values, (rows, columns)), shape=(size, size))


def median_time(function, repeats: int) -> tuple[float, object]:
    times, answer = [], None
    for _ in range(repeats):
        start = time.perf_counter()
        answer = function()
        times.append(time.perf_counter() - start)
    return statistics.median(times), answer


def compare(width: int) -> None:
    network: SpringNetwork = triangular(width)
    graph = network.to_graph()
    number = {name: index for index, name in enumerate(network.names)}
    size = 2 * len(network.positions)
    assembler = Assembler(network)
    still = np.zeros_like(network.positions)

    def assembled() -> csc_array:
        geometry = assembler.geometry(still)
        tension = network.stiffness * (geometry.elongation + network.prestretch)
        return assembler.tangent(geometry, tension, network.stiffness)

    quick, tangent = median_time(assembled, 9)
    print(f"{len(network.positions)} nodes, {len(network.springs)} springs")
    print(f"  assembler: {1e3 * quick:8.2f} ms")
    for loop in (looped_triplets, looped):
        slow, full = median_time(lambda loop=loop: loop(graph, number, size), 3)
        difference = abs(full[assembler.free][:, assembler.free] - tangent).max()
        print(
            f"  {loop.__name__:16} {1e3 * slow:8.1f} ms, {slow / quick:6.1f} times as long, "
            f"largest difference {difference:.1e} N/m"
        )


if __name__ == "__main__":
    for nodes_in_a_row in [int(argument) for argument in sys.argv[1:]] or [30, 100]:
        compare(nodes_in_a_row)
