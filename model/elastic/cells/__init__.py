"""Cells of many sizes, explicitly: faces, edges, strain matrix; of a small body or a window."""
