"""Solids with true outlines: cubes that are whole, cut or empty.

In comes a scene in space with outlines; out goes an `ElasticResult` of cells that count by their
share of the body. Read `solid_agents`: equations and answer first, then the shares of cells.
"""
