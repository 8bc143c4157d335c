"""Proper orthogonal decomposition of smoothed particle hydrodynamics of a mass-spring chain."""

__version__ = "0.1.0"
