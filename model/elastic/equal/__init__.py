"""Elasticity on equal cells: the staggered grid, solved by factors or by multigrid.

In comes a scene, out come displacements of all faces of its cells, with an estimated error.
Read `staggered` (the law), then:

- `problem`, `grid`, `supports`: a scene as arrays of scaled numbers.
- `solver`: which way is taken; `system`: loads and solutions; `direct`: few cells by factors;
  `iterative`: many by conjugate gradients (`krylov`), with one cycle of multigrid as the
  preconditioner, rubber with pressures of its own.
- `hierarchy`: the cycle; `multigrid_levels`: its levels; `row_kernels`: the compiled loops, which
  are imported with `iterative` alone.
- `fields`, `cell_agents`: what the displacements say.
"""
