"""Elasticity on equal cells: the staggered grid, solved by factors or by multigrid.

In comes a scene, out come displacements of all faces of its cells, with an estimated error.

- `problem`, `grid`, `supports`, `cell_loads`: a scene as arrays of scaled numbers.
- `staggered`: the law, in the fewest lines and as a matrix.
- `solver`: few cells by factors, many by conjugate gradients with one cycle of multigrid as the
  preconditioner (`hierarchy`, `stencils`, `row_kernels`; `krylov`), rubber by the `mixed_form`.
- `fields`, `cell_agents`, `equal_arrays`, `reactions`: what the displacements say.
"""
