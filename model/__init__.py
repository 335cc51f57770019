"""Where and when: scenes, the Mesa models that step them, the solvers and their results."""
