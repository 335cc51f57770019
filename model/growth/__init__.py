"""Bodies that grow: cells thicken where they carry, and thin where they do not.

In comes a scene, out goes a `GrowthResult`: densities and compliances, step by step.
Read `growth_model` (a step, and a body whose cells change a little each time), `growth_rules` (what
a cell does with what it feels), then `growth_result`.
"""
