"""The path-traced truth, and how far a result is from it."""
