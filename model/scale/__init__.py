"""Bodies on many processes: the equations of equal cells on PETSc, and results in pieces.

In comes a scene on every process; out goes an answer of which each process holds its part.
Read `partition` (who has which cells), `solve_petsc` (the equations), then `pieces` (the answer).
"""
