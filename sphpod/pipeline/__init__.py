"""What jobs of the workflow read, write, log and depend on."""
