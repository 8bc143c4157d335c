"""Proper orthogonal decomposition of smoothed particle hydrodynamics of a mass-spring-damper line."""

__version__ = "0.1.0"
