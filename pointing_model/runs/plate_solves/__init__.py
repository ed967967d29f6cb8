"""Places that images were solved to: their frames, the images of a mount, its keywords."""
