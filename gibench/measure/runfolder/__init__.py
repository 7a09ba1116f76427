"""The folder a run leaves: samples, record and results, written and read back."""
