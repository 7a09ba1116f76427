"""Path-traced truth and error metrics."""
