"""Other tools on the scene ten_harmonics, beside this one: ``make peers``, README.md."""
