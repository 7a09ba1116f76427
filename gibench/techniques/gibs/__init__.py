"""GIBS: global illumination based on surfels (Brinck et al. 2021; paper 004, chapters 3 and 4)."""
