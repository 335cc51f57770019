"""Quantities of interest: one displacement, stress or reaction, and its error.

In comes what a tolerance is about; out go the places it is taken at, and the second load (the dual)
whose answer tells its error.
Read `quantities` (what can be asked), then `duals` (where, the second loads, and how it is read).
"""
