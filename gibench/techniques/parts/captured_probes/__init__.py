"""Probes that keep a captured G-buffer of the scene around them, and are lit from it.

What irradiance probes and precomputed light field probes (McGuire et al. 2017) share.
"""
