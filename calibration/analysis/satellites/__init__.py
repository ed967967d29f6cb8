"""Satellites as the standard: terms, clock and orbits from tracks, and which orbit is wrong."""
