"""Load transfer from cell to cell, generation by generation.

In comes a scene; out goes a `TransferResult`: who took which load, and a ledger of every newton.
Read `transfer` (the shares of each kind of cell), `load_model` (the model in Mesa), `agent_engine`
(one object an agent), `array_engine` (one row an agent), then `stability` and `deformation`.
"""
