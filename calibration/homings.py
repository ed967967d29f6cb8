"""What the incremental encoders say of their reference marks, for the witnesses."""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC

from .witness_night import AXES

UNJUDGED = ('the reference marks of the incremental encoder could not be judged: it tells nothing '
            'of them on incremental/homing')


class Homing(NamedTuple):
    """What the incremental encoder of an axis says of itself and its mark."""

    run: int
    axis: str
    homed: bool
    side: str = ''
    missed_marks: int = 0
    mark_error: float = np.nan  # counts
    count: float = np.nan  # rad
    pulse_width: float = np.nan  # of the data sheet, rad


def homings_of(axes, run):
    """`Homing` of each axis.

    Parameters
    ----------
    axes : dict of str to msg_tools.homing.AxisHoming
        By axis, from the last message.
    run : int
        Number of the power-on in the observations.

    Returns
    -------
    list of Homing
    """
    return [Homing(run, axis, told.homed, told.side, told.missed_marks, told.mark_error,
                   told.count, told.pulse_width) for axis, told in axes.items()]


def encoder_diagnostics(message):
    """Rows of the statuses in a DiagnosticArray that speak of marks, as a list of dict.

    For `homings_from_diagnostics`.
    """
    told = [{row.key: row.value for row in status.values} for status in message.status]
    return [values for values in told if f'{AXES[0]} homed' in values]


def homings_from_diagnostics(values, run):
    """`Homing` of both axes from the diagnostics of the encoder's node.

    Logs before `incremental/homing` have nothing else. The rows are for people; nobody may read
    them but for such logs.

    Parameters
    ----------
    values : dict of str to str
        Key and value of the status' rows.
    run : int
        Number of the power-on in the observations.

    Returns
    -------
    list of Homing
        Of the axes that the diagnostics speak of.
    """
    def number(key):
        try:
            return float(values.get(key, 'nan'))
        except ValueError:
            return np.nan
    count = number('resolution [arcsec]') * ARCSEC
    return [
        Homing(run, axis, values[f'{axis} homed'] == 'True',
               values.get(f'{axis} mark met from', ''),
               int(np.nan_to_num(number(f'{axis} missed marks'))),
               number(f'{axis} mark error [counts]'), count,
               number(f'{axis} mark width [arcsec]') * ARCSEC)
        for axis in AXES if f'{axis} homed' in values]
