"""Studies: error against the truth, advice for a budget, the papers' experiments."""
