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

"""Drivers for the x axis of residual plots, with their labels and units."""

from dataclasses import dataclass
from datetime import datetime, timedelta, timezone

import numpy as np

from msg_tools.units import ARCSEC, DEG, covered
from pointing_model.effects.base import SIDES

_TURN = 2.0 * np.pi
_NOWHERE = 20.0 * DEG  # smallest gap in the range of an axis at which it may be cut
_LABELS = {
    'temperature': ('air temperature [°C]', 1.0), 'pressure': ('air pressure [hPa]', 1.0),
    'magnitude': ('magnitude of the star [mag]', 1.0),
    'run_hours': ('hours since the start of the run [h]', 1.0),
    'order': ('place in the run [0 first, 1 last]', 1.0), 'run': ('number of the run', 1.0),
    'row': ('number of the row', 1.0), 'pier_side': ('side of the pier', 1.0),
    'lst': ('local sidereal time [h]', np.pi / 12.0), 'azimuth': ('azimuth [°]', DEG),
    'elevation': ('elevation [°]', DEG)}
#: the same for drivers of one axis: {0} name of its angle, {1} name of the axis
_OF_AXES = {
    ('approach_az', 'approach_el'): ('last motion of the {1}', 1.0),
    ('travel_az', 'travel_el'): ('{0} travelled to the star [°]', DEG),
    ('miss_x', 'miss_y'): ('miss distance, {0} [arcsec]', ARCSEC),
    ('az_rate', 'el_rate'): ('{0} rate [arcsec/s]', ARCSEC),
    ('pm_x', 'pm_y'): ('proper motion along {0} [arcsec/yr]', 1.0)}


@dataclass
class Driver:
    """A quantity that residuals may depend on, for a figure.

    Attributes
    ----------
    name : str
    label : str
        With its unit.
    values : ndarray, shape (n,)
        In that unit; NaN: unknown.
    levels : dict, optional
        value -> text if there are only a few values.
    plain : bool
        False: used for one effect only.
    """

    name: str
    label: str
    values: np.ndarray
    levels: dict | None = None
    plain: bool = True


def _labels(names):
    """Label and unit of each driver for a mount with these `Names`."""
    return {**_LABELS, **{
        name: (label.format(word, shaft), unit) for keys, (label, unit) in _OF_AXES.items()
        for name, word, shaft in zip(keys, names.axes, names.shafts)}}


def _levels(name, names):
    """Words for the values of a driver with few values; None for other drivers."""
    if name not in SIDES:
        return None
    return {**dict(zip((-1, 1), names.sides[name != 'approach_az'])), 0: 'unknown'}


def driver_of(context, name):
    """A driver with its label and unit, or None if it is unknown or constant.

    Parameters
    ----------
    context : pointing_model.context.Context
    name : str

    Returns
    -------
    Driver or None
    """
    values = context.get('pm_x' if name == 'star' else name)
    if values is None:
        return None
    values = np.asarray(values, float)
    known = values[np.isfinite(values)]
    if known.size == 0 or known.max() - known.min() <= 1e-12 * max(abs(known.max()), 1e-300):
        return None
    if name == 'time':
        return Driver(name, *_hours(context, values))
    labels, levels = _labels(context.mount.names), _levels(name, context.mount.names)
    if levels is not None:
        levels = {k: v for k, v in levels.items() if (known == k).any()}
        return Driver(name, labels[name][0], values, levels)
    label, unit = labels.get('pm_x' if name == 'star' else name, (name, 1.0))
    if name in context.mount.names.keys and name not in labels:
        label, unit = f'{name.replace("_", " ")} [°]', DEG
    if name == 'azimuth':
        values = np.mod(values, 2.0 * np.pi)
    elif name in context.mount.names.keys and not context.mount.vertical:
        values = _in_one_piece(values)
    return Driver(name, label, values / unit)


def _in_one_piece(angles):
    """Unwrap axis angles, cut in the unused gap: through the pole they continue beyond 180°."""
    known = np.isfinite(angles)
    start, span = covered(angles[known])
    if span > _TURN - _NOWHERE:
        return angles
    out = start + np.mod(angles - start, _TURN)
    # shift by whole turns so that the median is within half a turn of zero
    return out - _TURN * np.round(np.median(out[known]) / _TURN)


def _hours(context, values):
    start = float(np.nanmin(values))
    hours = (values - start) / 3600.0
    if not getattr(context, 'time_is_utc', True):
        return 'hours since the first row [h]', hours
    if hours[np.isfinite(hours)].max() > 96.0:
        return f'days since {utc_text(start)} [d]', hours / 24.0
    return f'hours since {utc_text(start)} [h]', hours


def utc_text(seconds):
    moment = datetime(1970, 1, 1, tzinfo=timezone.utc) + timedelta(seconds=seconds)
    return moment.strftime('%Y-%m-%d %H:%M UTC')
