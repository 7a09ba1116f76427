"""Comparing runs and kernel trees."""
