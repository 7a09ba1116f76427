"""Projections held against times that others measured."""
