"""Springs between the nodes of a graph."""
