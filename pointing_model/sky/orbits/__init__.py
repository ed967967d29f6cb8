"""Orbits from files: precise ephemerides, predictions, elements; a file of code for each format."""
