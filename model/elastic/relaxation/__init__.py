"""The elastic rule as agents: residual loads handed on, step by step, until they are at rest."""
