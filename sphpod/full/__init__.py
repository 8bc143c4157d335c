"""Full-order models in density and in strain."""
