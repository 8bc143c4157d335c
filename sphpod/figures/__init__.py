"""Figures, a function for each kind."""
