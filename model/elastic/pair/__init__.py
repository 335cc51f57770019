"""Elasticity by agents with two opinions: a displacement that fits, and a stress that balances.

In comes a posed body and a tolerance; out come agents, and bounds of their error.
Read `gap` (the law on one page: agents halve where their opinions differ most, and the sum of all
differences proves the answer), `leaves` (agents, and the corners and edges they share), `border`
(supports and loads), `elements`, `displacement`, `sheets` (what a stress function is along any
border) and `airy` (both opinions), `levels` (their equations, solved by multigrid), `opinions`
(both, in the plane), `space` (bodies in space, where agents have the first opinion only), `history`
and `loop` (one generation, then all), `answer` and `goals` (what is read). The files `cut_mesh` and
so on are agents cut by true outlines.
"""
