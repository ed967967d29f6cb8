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

"""A pointing run: catalogue places, encoder readings and other data of each observation."""

from dataclasses import dataclass, field

import numpy as np

from msg_tools.params import Param
from msg_tools.units import ARCSEC, DEG, wrap

from ..mounts import ALTAZ

#: name in memory (SI) -> (name in a CSV file, CSV unit in SI, description). ``az`` and ``el`` are
#: the first and the second axis. The names in files are those of an alt-azimuth mount; for other
#: mounts see `column_name`
COLUMNS = {
    'time': ('time', 1.0, 'UTC, seconds since 1970-01-01'),
    'run': ('run', 1.0, 'number of the night or of the power-on'),
    'star': ('star', 1.0, 'Hipparcos number, or the name in a foreign file'),
    'az': ('az_deg', DEG, 'catalogue azimuth, observed place'),
    'el': ('el_deg', DEG, 'catalogue elevation, observed place'),
    'az_enc': ('az_enc_deg', DEG, 'encoder azimuth with the star centred'),
    'el_enc': ('el_enc_deg', DEG, 'encoder elevation with the star centred'),
    'az_abs': ('az_abs_deg', DEG, 'second (absolute) encoder, azimuth'),
    'el_abs': ('el_abs_deg', DEG, 'second (absolute) encoder, elevation'),
    'az_raw': ('az_raw_deg', DEG, 'reading of the azimuth encoder, no zero taken off'),
    'el_raw': ('el_raw_deg', DEG, 'reading of the elevation encoder, no zero taken off'),
    'sigma_x': ('sigma_az_arcsec', ARCSEC, '1-sigma noise along azimuth, on the sky'),
    'sigma_y': ('sigma_el_arcsec', ARCSEC, '1-sigma noise along elevation'),
    'miss_x': ('miss_x_arcsec', ARCSEC, 'measured miss distance along azimuth, on the sky'),
    'miss_y': ('miss_y_arcsec', ARCSEC, 'measured miss distance along elevation'),
    'az_rate': ('az_rate_arcsec_s', ARCSEC, 'azimuth rate'),
    'el_rate': ('el_rate_arcsec_s', ARCSEC, 'elevation rate'),
    'approach_az': ('approach_az', 1.0, 'sign of the last azimuth motion, -1, 0, 1'),
    'approach_el': ('approach_el', 1.0, 'sign of the last elevation motion, -1, 0, 1'),
    'temperature': ('temperature_c', 1.0, 'air temperature, degrees Celsius'),
    'pressure': ('pressure_hpa', 1.0, 'air pressure, hPa'),
    'magnitude': ('magnitude', 1.0, 'magnitude of the star'),
    'encoder_start': ('encoder_start', 1.0, "when the encoder's power-on began, UTC seconds since "
                      '1970-01-01; it names the power-on'),
    'absolute_start': ('absolute_start', 1.0, "when the absolute encoder's power-on began, UTC "
                       'seconds since 1970-01-01; it names the power-on'),
    'block': ('block', 1.0, 'step of the observing plan that took the row'),
    'exposure': ('exposure_s', 1.0, 'length of the exposure over which the readings were averaged, '
                 's; 0: read in its middle'),
    'camera_late': ('camera_late_s', 1.0, "what was taken off the camera's stamp, s"),
    'lean_north': ('lean_north_arcsec', ARCSEC, 'tilt of the base to the north by an '
                   'inclinometer, from any origin'),
    'lean_west': ('lean_west_arcsec', ARCSEC, 'the same to the west'),
    'check': ('check', 1.0, '1: a fresh star to judge by, kept out of every fit and choice'),
    'for_zero': ('for_zero', 1.0, '1: a star that was exposed for a zero; Polaris needs no mark'),
}

REQUIRED = ('az', 'el', 'az_enc', 'el_enc')


def column_name(name, names=ALTAZ.names):
    """Name of a column in a CSV file: for an equatorial mount ``az_enc`` is ``ha_enc_deg``.

    Parameters
    ----------
    name : str
        A key of `COLUMNS`; other names are returned unchanged.
    names : MountKind
    """
    if name not in COLUMNS:
        return name
    own = dict(zip(('az', 'el'), names.columns))
    return '_'.join(own.get(part, part) for part in COLUMNS[name][0].split('_'))


@dataclass
class PointingRun:
    """Columns of equal length, one row per observation.

    Parameters
    ----------
    columns : dict of str to ndarray, shape (n,)
        In SI, angles in radians, with the names of `COLUMNS`; at least `REQUIRED`. Other names are
        the user's drivers.
    meta : dict
        Origin of the run (``source``), its ``site``, excluded rows (``excluded``, a list of
        ``{'row', 'reason'}``) and remarks for the user (``notes``, a list of str).
        ``time_is_utc`` False: time counts from an arbitrary start. ``raw_reading`` False: the
        encoder angles are not raw readings. ``mount``: a `mounts.Mount`; without it the mount is
        alt-azimuth. ``az, el`` and ``az_enc, el_enc`` are angles of its axes, catalogue places on
        the pier side of the mount. ``graduation`` (``graduation_abs``): lines per turn of the
        encoders, see `effects.declared_graduation`. ``drivers``: names of user columns that are
        causes although their names do not show it.

    Raises
    ------
    ValueError
        A required column is missing, or columns differ in length.
    """

    columns: dict
    meta: dict = field(default_factory=dict)

    def __post_init__(self):
        missing = [name for name in REQUIRED if name not in self.columns]
        if missing:
            raise ValueError(f'pointing run without column {", ".join(missing)}')
        self.columns = {name: np.atleast_1d(np.asarray(v)) for name, v in self.columns.items()}
        lengths = {name: len(v) for name, v in self.columns.items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f'columns of a pointing run differ in length: {lengths}')

    def __len__(self):
        return len(self.columns['az'])

    def __contains__(self, name):
        return name in self.columns

    def __getitem__(self, name):
        """Column `name`, shape (n,)."""
        return self.columns[name]

    def get(self, name, default=np.nan):
        """Column `name`, or `default` in every row if the run does not have it."""
        if name in self.columns:
            return self.columns[name]
        return np.full(len(self), default)

    @property
    def mount(self):
        """The `mounts.Mount` whose axes the angles are of."""
        return self.meta.get('mount', ALTAZ)

    @property
    def lines(self):
        """Line in the file of each row, shape (n,); without a file its index in the run."""
        lines = np.asarray(self.meta.get('lines', ()))
        return lines if len(lines) == len(self) else np.arange(len(self))

    def select(self, rows):
        """The run with only `rows` (a mask or indices); `meta` is shared."""
        return PointingRun({name: v[rows] for name, v in self.columns.items()}, self.meta)

    def part(self, rows, **meta):
        """Like `select`, also selecting ``meta['lines']`` and adding the items `meta`."""
        lines = {'lines': self.lines[rows]} if 'lines' in self.meta else {}
        return PointingRun(self.select(rows).columns, {**self.meta, **lines, **meta})

    def split_sessions(self, hours):
        """The run with the session number of each row in the column ``run``.

        Parameters
        ----------
        hours : float
            A gap in ``time`` longer than this starts a session, as does a change of ``run``.

        Returns
        -------
        PointingRun
            Rows in the same order; sessions are numbered 1, 2, ... in time.

        Raises
        ------
        ValueError
            There is no ``time``, or it is not finite in some row.
        """
        time = np.asarray(self.get('time'), float)
        if not np.isfinite(time).all():
            raise ValueError('sessions need the time of every row (column time)')
        order = np.argsort(time, kind='stable')
        new = np.diff(time[order]) > 3600.0 * hours
        if 'run' in self:
            new |= self['run'][order][1:] != self['run'][order][:-1]
        label = np.empty(len(self), int)
        label[order] = np.concatenate(([1], 1 + np.cumsum(new)))
        return PointingRun({**self.columns, 'run': label}, self.meta)

    def offsets(self, encoder='enc'):
        """Encoder minus catalogue, on the sky.

        Parameters
        ----------
        encoder : {'enc', 'abs'}
            The pair of encoder columns: ``az_enc, el_enc`` or ``az_abs, el_abs``.

        Returns
        -------
        x, y : ndarray, shape (n,)
            delta-A cos E and delta-E, radians (paper 000, eq. 2, projected on the sky). For rows
            through the pole both directions are reversed on the sky.
        """
        az, el = self['az'], self['el']
        dx = wrap(self[f'az_{encoder}'] - az) * np.cos(el)
        dy = self[f'el_{encoder}'] - el
        return dx, dy if self.mount.vertical else wrap(dy)

    @classmethod
    def concatenate(cls, runs):
        """Join runs in the given order, with the columns that all of them have.

        ``meta`` is that of the first run, without graduations on which the runs differ.
        """
        runs = list(runs)
        names = [n for n in runs[0].columns if all(n in r.columns for r in runs)]
        meta = {n: v for n, v in runs[0].meta.items() if not n.startswith('graduation')
                or all(r.meta.get(n) == v for r in runs)}
        return cls({n: np.concatenate([r[n] for r in runs]) for n in names}, meta)


KEPT_POWER_ONS = Param(
    'kept_power_ons', 10, 'power-ons of the encoder whose rows are kept, the last ones, so that '
    'memory and fits stay small over months. The log has all rows. 0: all', 0, 100000,
    fixed=True)


def known_site(meta):
    """Known parts of the site in a run's ``meta``: dict of latitude, longitude, height (rad, m)."""
    site = meta.get('site') or {}
    return site if isinstance(site, dict) else {
        name: getattr(site, name) for name in ('latitude', 'longitude', 'height')
        if hasattr(site, name)}


def first_of_last(runs, count):
    """Index of the first row to keep, so that the last `count` power-ons remain.

    Parameters
    ----------
    runs : array_like, shape (n,)
        Number of the power-on of each row, in order of observation.
    count : int
        Power-ons to keep; 0: all.

    Returns
    -------
    int
        0 if all rows are kept.
    """
    if not count:
        return 0
    runs = np.asarray(runs)
    # last row of each power-on, the newest first
    last = np.sort(len(runs) - 1 - np.unique(runs[::-1], return_index=True)[1])[::-1]
    return int(last[count]) + 1 if len(last) > count else 0


def kept_words(runs, count):
    """Sentence saying that only the last `count` power-ons are used; '' if there are fewer.

    Parameters
    ----------
    runs : array_like
        Number of the power-on of each row.
    count : int
        See `first_of_last`.
    """
    if not count or len(np.unique(runs)) < count:
        return ''
    return (f'of the last {count} power-ons alone (kept_power_ons): rows of earlier ones, if there '
            'are any, are in the log')
