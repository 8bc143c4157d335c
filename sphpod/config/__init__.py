"""Configurations: read, checked and completed."""
