"""Where models are stable: theory and measurement."""
