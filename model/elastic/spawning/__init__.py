"""Agents of many sizes: fine ones spawn where load is left unbalanced."""
