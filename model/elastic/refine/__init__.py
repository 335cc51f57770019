"""Adaptive refinement: solve, estimate, mark, split, prove."""
