"""The elastic rule as agents: loads handed on, step by step, until they settle."""
