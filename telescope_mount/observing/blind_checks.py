"""Fresh stars pointed at blind, summed up: the document on `observer/checks`."""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import rms

CHECKS_FORMAT = 'telescope_mount/blind_checks'
CHECKS_VERSION = 1


def blind_summary(miss, lost=0, model=None):
    """RMS of the miss distances of fresh stars pointed at blind, which is the pointing error.

    Parameters
    ----------
    miss : array_like, shape (n, 2)
        Star - boresight towards +A and +E, rad, of first exposures: model and zero in force,
        nothing centred.
    lost : int
        Stars that were not in the field, and so are in no figure.
    model : PointingModel, optional
        That was in force.

    Returns
    -------
    dict
        ``stars``, ``lost``, ``rms_arcsec`` (radial), ``rms_x_arcsec``, ``rms_y_arcsec``,
        ``mean_x_arcsec``, ``mean_y_arcsec``, ``max_arcsec``, None where there is no star;
        ``terms`` and ``effects`` of the model.
    """
    miss = np.asarray(miss, dtype=float).reshape(-1, 2) / ARCSEC
    names = ('rms_arcsec', 'rms_x_arcsec', 'rms_y_arcsec', 'mean_x_arcsec', 'mean_y_arcsec',
             'max_arcsec')
    values = [None] * len(names)
    if len(miss):
        x, y = miss.T
        values = [rms(x, y), rms(x), rms(y), x.mean(), y.mean(), np.hypot(x, y).max()]
    return {'stars': len(miss), 'lost': int(lost),
            **{n: None if v is None else float(v) for n, v in zip(names, values)},
            'terms': list(model.terms) if model else [],
            'effects': [e.effect.name for e in model.effects] if model else []}
