"""The command line, and the one description of the node graph."""
