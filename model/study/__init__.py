"""Asking more than one answer: the verb `solve`, comparison, fitted rules, sweeps."""
