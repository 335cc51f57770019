"""What all answers have in common, and how they are stored and read again.

In comes what a model or solver found; out come figures, tables, files and checks.
Read `result` (what every answer offers), `stored` (fields say what is kept), `archive` (any file,
and back), then `cuts` (the force through a body) and `mesh` (files for ParaView).
"""
