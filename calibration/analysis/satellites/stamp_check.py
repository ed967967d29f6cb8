# Copyright 2026 telescope_mount developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Tracks far from the predicted orbits: wrong time scale, site, satellite or column."""

import numpy as np

from msg_tools.units import ARCSEC, DEG, even_sample
from pointing_model.pointing_terms import stacked_design
from pointing_model.sky.orbits.time_scales import leap_seconds

from ..finding import Finding
from .track_columns import power_ons

#: radial RMS below which stamps are right, rad; largest ratio of the RMS with corrected stamps
_RIGHT, _BETTER = 30.0 * ARCSEC, 0.3
#: radial RMS, and elevation zero, rad, beyond which it is no track of that satellite
_ELSEWHERE, _NO_ZERO = 1.0 * DEG, 10.0 * DEG
#: largest error along the orbit of a satellite with unknown time, s
_MOST_BIAS = 10.0
#: largest number of rows used; standard errors of the time along an orbit that are no wrong stamp
_MOST, _SIGMAS = 300, 3.0
#: offsets of time zones, s; largest radial RMS with one, rad: another satellite leaves more
_ZONES = tuple(3600.0 * np.array([*range(1, 15), 3.5, 5.5, 9.5]))
_OF_ZONE = 500.0 * ARCSEC
#: iterations of reweighting
_ROUNDS = 30


def wrong_track(measured, bias_free=()):
    """Whether stamps fit far better in another time scale, or shifted by hours or some seconds,
    or whether rows are far from the orbits with any stamps.

    Parameters
    ----------
    measured : object
        With ``tracks(shift, rows)`` -> `SatelliteTracks`, ``names`` and ``columns['time']``.
    bias_free : collection of str
        Satellites with unknown time along the orbit: they cannot show errors of seconds.

    Returns
    -------
    Finding or None
        Its size is the delay of the stamps relative to UTC, s, or the distance of the rows, deg.
    """
    rows = even_sample(np.flatnonzero(measured.names != ''), _MOST)
    tracks = measured.tracks(0.0, rows)
    now = _left(tracks)
    if now < _RIGHT:
        return None
    # expected time error of the orbits, s
    own = np.where(np.isin(tracks.run['star'], list(bias_free)), _MOST_BIAS,
                   tracks.orbit_sigma / tracks.speed)
    least = _SIGMAS * float(np.median(own))
    elsewhere = _ELSEWHERE + _SIGMAS * float(np.median(own * np.hypot(*tracks.ahead)))
    tai = float(leap_seconds(float(np.median(measured.columns['time'][rows]))))
    best = now, 0.0
    for late in (1.0, 2.0, 3.0, tai - 19.0, tai, *_ZONES):
        for shift in (late, -late) if late > least else ():
            try:
                left = _left(measured.tracks(-shift, rows))
            except ValueError:  # no orbit there
                continue
            if late not in _ZONES or left < _OF_ZONE:
                best = min(best, (left, shift))
    if best[0] > min(_BETTER * now, elsewhere):
        return Finding('not the satellite', now / DEG, unit='deg') if now > elsewhere else None
    scale = {tai - 19.0: 'GPS', tai: 'TAI'}.get(best[1], '')
    return Finding('stamps off', best[1], unit='s', causes=(scale,), before=now / ARCSEC,
                   after=best[0] / ARCSEC)


def _left(tracks):
    """Robust radial RMS (root of the median square) after fitting zeros and collimation, rad."""
    middle = abs(float(np.median(tracks.run.offsets()[1])))
    if tracks.run.mount.vertical and middle > _NO_ZERO:
        return middle
    return float(np.sqrt(np.median(np.sum(robustly_off(tracks)**2, axis=0))))


def robustly_off(tracks):
    """Residuals of a least absolute deviations fit of zeros and collimation, shape (2, n), rad.

    Parameters
    ----------
    tracks : SatelliteTracks
    """
    run, n = tracks.run, len(tracks)
    b = np.concatenate(run.offsets())
    columns = stacked_design(run.mount.names.physical[:3], run['az'], run['el'], run.mount)
    zeros = stacked_design(run.mount.names.index, run['az'], run['el'], run.mount)
    columns = np.concatenate([columns, *(zeros * np.tile(run['run'] == one, 2)
                                         for one in power_ons(run)[:-1])])
    both = np.ones(2 * n)
    for _ in range(_ROUNDS):  # least sum of distances
        p = np.linalg.lstsq((columns * both).T, b * both, rcond=1e-8)[0]
        off = (b - p @ columns).reshape(2, n)
        root = np.maximum(np.hypot(*off), ARCSEC) ** -0.5
        both = np.tile(root / root.max(), 2)
    return off
