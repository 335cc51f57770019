"""Two-sided bounds of the energy: admissible stresses above, admissible displacements below."""
