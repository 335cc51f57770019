"""More than one answer: the verb `solve`, comparison, fitted rules, sweeps.

In come scenes and answers; out go comparisons, coefficients and tables.
Read `solving` (which solver a scene takes), `compare` (two answers), `reference` and
`finite_elements` (answers from elsewhere), `fitting` and `rule_study` (a rule beside elasticity),
then `sweep`.
"""
