"""Bodies that grow: cells thicken where they carry, and thin where they do not.

In comes a scene, out goes a `GrowthResult`: densities and compliances, step by step.
Read `growth_model` (a step), `growth_rules` (what a cell does with what it feels), then `growing`
(the equations of a body whose cells change a little each time), last `growth_result`.
"""
