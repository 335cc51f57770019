"""What spawning costs and how true it is, beside equal cells and finite elements."""
