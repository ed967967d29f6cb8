"""The sky, and the model of the mount's pointing errors."""
