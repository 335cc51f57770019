"""Linear elasticity: displacement, stress and energy of a body under its loads, and their error.

In comes a scene; out goes an `ElasticResult`, which says how wrong it may be.
Read `posed_body` (the scene in units of its own), `solve` with the folder `equal` (cells of one
size), `pair` (agents of two minds, which spawn until both agree), `goals` (one figure and its
error), `relaxation` (agents that settle by pushing), then `elastic_result` and `caveats`.
"""
