"""What several techniques are made of. A part imports no technique."""
