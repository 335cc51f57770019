"""Bodies with true outlines in the plane: both bounds, agents cut by them."""
