"""Statistics of samples. No input or output here."""
