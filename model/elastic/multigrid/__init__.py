"""Solvers for many cells: equal ones in rows, and blocks of cells as their refinements."""
