"""Bodies with true outlines in the plane: curves, and what square agents hold of the body.

In comes a scene with outlines; out goes what is within agents, between two polygons of every curve.
Read `true_shapes` (the curves), `posed_outlines` (loads and supports on them), `leaf_triangles`
(what agents hold), then `hoop_stress`; their two opinions are found in elastic/pair (cut files).
"""
