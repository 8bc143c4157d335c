"""Studies of run time, accuracy and robustness, one module each."""
