"""Every kernel against its float64 oracle, on any device (`gibench conform`)."""
