"""Solutions that full-order models are compared with."""
