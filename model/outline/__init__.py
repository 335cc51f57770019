"""Bodies with true outlines in the plane: agents that are cut by curves.

In comes a scene with outlines; out goes its answer, with both bounds and the stress along curves.
Read `true_shapes` (the curves), `outline_problem` (loads and supports on them), `outlined_scene`
(the way to an answer), then `outline_result` and `hoop_stress`.
"""
