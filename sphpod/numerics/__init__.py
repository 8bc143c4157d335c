"""Numerics that know of no scene: compiled kernels, expressions, propagators, error norms."""
