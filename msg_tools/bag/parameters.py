"""What a log tells of the parameters of the nodes that were there. Needs no ROS."""

import json

from .recorder import RECORD


def parameters_of(metadata, suffix):
    """Parameters of the node whose full name ends with `suffix`, from a log's metadata.

    Parameters
    ----------
    metadata : dict of str to dict
        As `BagReader.metadata`.
    suffix : str
        As ``/calibration``.

    Returns
    -------
    dict or None
    """
    for name, record in metadata.items():
        if name.startswith(RECORD) and name.endswith(suffix):
            try:
                return {key: json.loads(text) for key, text in record.items()}
            except (ValueError, RecursionError):
                return None
    return None
