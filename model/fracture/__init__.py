"""What breaks: springs or cells, one at a time, in small strain, under a load that is scaled.

In comes a network or a scene, out goes a `FractureResult`: the breaks, loads and energies.
Read `fracture_model` (the next break), `breaking_bodies` (what bears, and solving again with a
part less), then `fracture_result`.
"""
