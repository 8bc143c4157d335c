"""From snapshots to modes, reduced models, error bounds and certified models."""
