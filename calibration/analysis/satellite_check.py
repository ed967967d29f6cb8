"""The check on a GPS satellite: errors of the tracked satellite, as paper 000, section 3, has them.

Measured minus orbit, before and after the zero calibration: mean and standard deviation on each
axis, beside the paper's, and its figures 1 and 2. What may have left the paper's numbers is the
subject of `benchmarks/satellite_search.py`.
"""

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.zero import NO_ZERO

#: The four numbers of each curve in paper 000 (azimuth, elevation), in the keys of gps.json.
PAPER = {
    'before': {'az_mean_arcsec': 13.99, 'az_std_arcsec': 11.33,
               'el_mean_arcsec': 11.50, 'el_std_arcsec': 4.81},
    'after': {'az_mean_arcsec': 5.94, 'az_std_arcsec': 2.04,
              'el_mean_arcsec': -3.49, 'el_std_arcsec': 2.63},
}


def tracking_errors(model, run, zero=NO_ZERO):
    """Tracked minus computed place of a satellite, as the paper's curves.

    Parameters
    ----------
    model : PointingModel
        In force when it was tracked.
    run : PointingRun
        Exposures of the satellite; the encoder's angles are those with it centred.
    zero : RunZero or Zeros
        Of the encoders.

    Returns
    -------
    dict of str to list
        ``time`` (UTC s), ``el_deg``, ``az_arcsec`` (the coordinate angle, not times cos E),
        ``el_arcsec``; rows with a NaN are left out.
    """
    x, y = model.residuals(run, zero=zero)
    good = np.isfinite(x) & np.isfinite(y)
    columns = {'time': run['time'], 'el_deg': run['el'] / DEG,
               'az_arcsec': x / np.cos(run['el']) / ARCSEC, 'el_arcsec': y / ARCSEC}
    return {name: values[good].tolist() for name, values in columns.items()}


def tracking_statistics(errors):
    """Mean and standard deviation of tracking errors.

    Parameters
    ----------
    errors : dict
        From `tracking_errors`.

    Returns
    -------
    dict
        ``az_mean_arcsec``, ``az_std_arcsec`` (coordinate, as the paper is read here),
        ``az_sky_...`` (times cos(elevation)), ``el_...`` and ``n``.

    Raises
    ------
    ValueError
        Fewer than two exposures.
    """
    az, el = np.array(errors['az_arcsec']), np.array(errors['el_arcsec'])
    if len(az) < 2:
        raise ValueError(f'{len(az)} exposures of the satellite: two at least are needed for a '
                         'mean and a scatter')
    sky = az * np.cos(np.array(errors['el_deg']) * DEG)
    out = {'n': len(az)}
    for name, values in (('az', az), ('az_sky', sky), ('el', el)):
        out[f'{name}_mean_arcsec'] = float(np.mean(values))
        out[f'{name}_std_arcsec'] = float(np.std(values, ddof=1))
    return out


def gps_statistics(tracks):
    """Content of gps.json: our numbers before and after the zero calibration, and the paper's.

    Parameters
    ----------
    tracks : dict
        ``before`` and ``after`` from `tracking_errors`.

    Returns
    -------
    dict
        ``before``, ``after``: see `tracking_statistics`; ``paper``: `PAPER`.
    """
    return {**{part: tracking_statistics(tracks[part]) for part in ('before', 'after')},
            'paper': PAPER}
