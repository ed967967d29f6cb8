"""The sky, the incremental and the absolute encoder compared: which of them moved."""
