"""Surveys of parameters: many queries of one scene, answered by one reduced model."""
