"""Mounts and cameras of other systems as topics: INDI, Alpaca."""
