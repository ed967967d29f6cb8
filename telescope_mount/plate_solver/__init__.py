"""A plate solver over a folder of images."""
