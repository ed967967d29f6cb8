"""A model that follows the mount through the night; see docs/tracking.md."""
