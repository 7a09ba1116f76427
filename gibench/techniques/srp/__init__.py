"""Sparse Radiance Probes (Silvennoinen and Lehtinen 2017)."""
