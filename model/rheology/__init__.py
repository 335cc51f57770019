"""The three-element rheology in time: elements, networks, bodies."""
