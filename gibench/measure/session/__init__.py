"""Techniques set up on a device and run frame by frame."""
