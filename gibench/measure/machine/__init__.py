"""The machine that measures: its roofs and its environment."""
