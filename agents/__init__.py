"""Who carries load: materials, the rules by which agents pass load on, and the agents."""
