"""From traces and a machine's figures to a range of times."""
