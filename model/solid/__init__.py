"""Solids with true outlines: cells that are whole, cut or empty, and what is proved of them."""
