"""Straight-line code for a scenario's step, traced from the simulation's own methods."""
