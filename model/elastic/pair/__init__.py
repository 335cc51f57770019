"""Elasticity of a plane body as agents of two minds.

Every agent holds two opinions of the same load: a displacement that *fits* its neighbours without
a gap, and a stress that *balances*, which hands on exactly what arrives. Where they differ most,
agents halve; what they differ in, summed, proves the answer (`gap`: the law on one page).

- `leaves`: agents as leaves of a quadtree or octree, by Morton code; 2:1.
- `leaf_mesh`: the corners, edges and border that they share.
- `border`: what holds and loads them; free bodies are refused.
- `elements`: both elements of a square, their products, and what its parts take over.
- `displacement`, `airy`: unknowns, supports and loads of the opinion that fits, and of the one
  that balances.
- `levels`: equations of one field by generations as multigrid levels; of any dimension.
- `opinions`: one generation, solved; `loop`: who halves, and when it ends.
- `history`: what is kept of every generation; `family`: who spawned whom.
- `answer`: what is read of the last generation: one number for each quantity.
- `goals`: what a generation proves of a figure, by a second load with two opinions of its own.
- `bricks`, `brick_mesh`, `brick_levels`, `brick_field`, `brick_goals`, `octree`: bodies in space
  have the first opinion alone, and an estimated error.

Elements of another kind join by the same unknowns: two displacements at every vertex and on every
edge (the bulge of a parabola); phi, phi_x, phi_y at every vertex and the bulge of the normal slope
on every edge. A mesh with more vertices and edges than those of the squares gives these numbers
behind them, `levels.Blocks` takes their matrices, and `gap` their shares.
"""
