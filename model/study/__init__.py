"""Asking more than one answer: the verb `solve`, comparison, fitted rules, sweeps.

In come scenes and answers; out go comparisons, coefficients and tables.
Read `solving` (which solver a scene takes), `compare` (what is asked of an answer), `reference`
and `finite_elements` (what may be believed), `fitting` and `rule_study`, then `sweep_runs` and
`sweep`.
"""
