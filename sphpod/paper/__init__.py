"""What the paper shows and claims, beside what is found here."""
