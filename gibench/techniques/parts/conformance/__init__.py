"""What `gibench conform` holds kernels against: oracles, random inputs, and what a case is."""
