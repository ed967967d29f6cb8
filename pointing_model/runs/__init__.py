"""Runs: their rows, formats of files, plate solves, models of other programs."""
