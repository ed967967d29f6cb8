"""A model that follows the mount through the night; see docs/tracking.md."""

#: modes of the calibration: a model when it is asked to fit; a model after each star too
BATCH, TRACK = 'batch', 'track'
