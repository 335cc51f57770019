"""Who carries load: materials, the rules by which agents pass load on, and the agents.

In comes a load that reached a cell; out go the share that is kept and the loads passed on.
Read `shares` (a load, and the numbers by which it is parted), `rules` (which numbers), then
`material_agent`, where the whole life of a load is told, and `boundary_agent`, which gives back.
"""
