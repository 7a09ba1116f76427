"""Scenes, oracles and harnesses that tests share."""
