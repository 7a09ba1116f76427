"""Measuring: configurations, the frame loop, the run folder, statistics."""
