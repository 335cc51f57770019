"""What is asked, and who answers: scenes, models that step, solvers, and their results.

In comes a description (`scene`), out go results (`results`); each room between them is one
question: load transfer, elasticity, networks, creep, growth, fracture, or several of these.
Read `stepper` (what steps), then `stepped_model` (what steps in Mesa), then a room.
"""
