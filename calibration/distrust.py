"""Observations that are not to be used because an instrument lied, and models that are not to be
published because of what is known against them.
"""

import numpy as np

from pointing_model.observing.instrument_health import FROZEN_CAMERA, SAME_ROWS, frozen_rows

#: so large a part of the observations that is not to be trusted speaks against all of them
MOST_DISTRUSTED = 1.0 / 3.0
#: RMS on stars held out, in units of the noise that the fit itself found, beyond which an alarm
#: and the model cannot both be lived with
CONTRADICTED = 10.0


def distrusted(rows):
    """Rows that an instrument has falsified, by what it says itself.

    Parameters
    ----------
    rows : PointingRun
        In the order in which they were taken. Only those of an observer are judged, which have
        the column ``encoder_start``: in a file zeros may stand for what was not measured.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    if not all(name in rows for name in ('encoder_start', 'miss_x', 'miss_y')):
        return np.zeros(len(rows), bool)
    return frozen_rows(rows['miss_x'], rows['miss_y'])


def reasons(rows):
    """What `distrusted` says of the rows, sentences; empty where all can be used."""
    bad = np.flatnonzero(distrusted(rows))
    if len(bad) == 0:
        return []
    return [f'{len(bad)} of {len(rows)} observations left out, rows {bad[0]} to {bad[-1]}: '
            + FROZEN_CAMERA.format(SAME_ROWS)]


def contradicted(alarms, health, report=None):
    """Why a model is not to be published; '' if it may be.

    Parameters
    ----------
    alarms : list of str
        What the witnesses of the night disagree on.
    health : PointingRun
        All observations of the night: see `distrusted`.
    report : dict, optional
        Of the fit, as `CalibrationSession.fit` makes it; None before there is one.

    Returns
    -------
    str
        One sentence.
    """
    share = float(np.mean(distrusted(health))) if len(health) else 0.0
    if share > MOST_DISTRUSTED:
        return f'not published: {reasons(health)[0]}'
    if report is None or not alarms:
        return ''
    held_out = report['steps'][-1]['held_out']['radial']
    noise = float(np.hypot(*report['noise_arcsec']))
    if held_out <= CONTRADICTED * noise:
        return ''
    return (f'not published: it leaves {held_out:.0f} arcsec on stars held out, where the noise is '
            f'{noise:.1f}, and the witnesses say why: {alarms[0]}')
