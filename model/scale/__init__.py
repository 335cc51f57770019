"""Bodies on many processes: the uniform elastic operator on PETSc, and its results in pieces."""
