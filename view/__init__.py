"""How people see it: plots and animations."""
