"""What a model tells of its tracking: how far each of its terms wanders."""

import numpy as np

from msg_tools.units import ARCSEC

#: key of a tracked model's provenance
KEY = 'tracked'


def walks_of(model):
    """How far each term of a tracked model wanders, rad in the root of an hour.

    Parameters
    ----------
    model : PointingModel or None

    Returns
    -------
    ndarray, shape (k,), or None
        None for a model that was not tracked.

    Raises
    ------
    ValueError
        That part of the model is damaged.
    """
    told = None if model is None else model.provenance.get(KEY)
    if not isinstance(told, dict):
        return None
    try:
        walks = told['walk_arcsec_per_root_hour']
        return np.array([float(walks[name]) for name in model.terms]) * ARCSEC
    except (KeyError, TypeError, ValueError):
        raise ValueError(f'what wanders in the model is damaged: {told!r:.60}') from None
