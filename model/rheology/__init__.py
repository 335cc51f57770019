"""The three-element rheology in time: elements, networks, bodies.

In come a subject and a `History` of its load; out go displacements and energies over time.
Read `element` (the law), `load_history` (the load), `integrate` (steps in time),
then `creeping`, the verb, and the three subjects: `creeping_elements`, `creeping_network` and
`creeping_elastic`.
"""
