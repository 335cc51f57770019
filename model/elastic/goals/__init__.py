"""Quantities of interest: what a tolerance can be asked of, and its error by dual solutions."""
