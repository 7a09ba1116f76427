"""What is computed ahead of frames: surfels, their hierarchy, caches and links."""
