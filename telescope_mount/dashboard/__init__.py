"""What `telescope-mount watch` shows: the state of a graph or of a log, and how it is drawn."""
