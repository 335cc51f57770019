"""Random and adversarial scenes put to every rule, order and solver, to see what happens."""
