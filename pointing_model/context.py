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

"""Drivers of effects besides the direction: time, temperature, approach, reading, ..."""

import re
from functools import cached_property

import numpy as np

from msg_tools.units import ARCSEC, wrap

from .mounts import ALTAZ, OF_MOUNT, is_beyond
from .pointing_terms import Trig
from .runs.columns.column_names import is_cause
from .runs.run import COLUMNS, known_site
from .sky.places import are_star_rates, star_rates

#: columns of a run that are not user-defined drivers
_KNOWN = set(COLUMNS) - {'pressure'} | {
    'az_raw', 'el_raw', 'pier_side', 'counterweight', 'lst', 'lst_h', 'ra', 'dec', 'row',
    'run_hours'}
#: runs that begin farther apart than this are different nights, s
_NIGHT = 12.0 * 3600.0
#: derived drivers that depend on neighbouring rows
_INHERITED = ('order', 'travel_az', 'travel_el', 'before_az', 'before_el', 'slew_az', 'slew_el')
#: drivers of an axis in words
_IN_WORDS = {'approach': 'direction of approach in', 'travel': 'way travelled in',
             'before': 'approach before that in', 'unwrapped': 'turns of the',
             'reading': 'encoder reading of', 'rate': 'rate of'}
_UNIT = re.compile('_(?:deg|rad|arcsec|c|hpa|s|h|m|mm|percent)$')
#: why a driver without a column is unknown, and which column would provide it
UNKNOWN = {
    **dict.fromkeys(('pm_x', 'pm_y'), 'the proper motion of the stars is not known (a column star '
                    'with Hipparcos numbers gives it)'),
    **dict.fromkeys(('miss_x', 'miss_y'), 'the miss distance is not known (columns miss_x_arcsec, '
                    'miss_y_arcsec)'),
    **dict.fromkeys(('az_rate', 'el_rate'), 'how fast the axes moved is not known (a column time, '
                    'or the rates)'),
    'pier_side': 'the side of the pier is not known',
    'lst': 'the sidereal time is not known (a column time, and the longitude of the site)'}
_TURN = 2.0 * np.pi
_J2000 = 946728000.0  # UTC seconds of 2000-01-01T12:00


def _labels(run):
    """Number of the run of each row, 0, 1, ..."""
    return np.unique(run, return_inverse=True)[1]


def _per_run(reduce, values, label):
    out = np.full(label.max(initial=0) + 1, np.nan)
    reduce.at(out, label, values)
    return out


class Context:
    """Directions and their known drivers.

    Parameters
    ----------
    az, el : float or ndarray, shape (n,)
        Catalogue place, radians.
    columns : dict of str to ndarray or float, optional
        Drivers by the names of `run.COLUMNS` (SI), and user-defined ones. NaN is unknown.
    latitude, longitude : float, optional
        Of the site, radians; north and east positive.
    mount : Mount, optional
        Its axes define the angles.

    Notes
    -----
    `get` also derives: ``lst`` (rad, from ``lst_h`` in hours, or from time and longitude),
    ``reading_az``/``reading_el`` (raw encoder angle: ``az_raw``, else ``az_enc`` without the
    star's miss distance), ``unwrapped_az``/``unwrapped_el`` (angle in the turn that the encoder
    reads), ``order`` (position of the row in its run, 0 to 1), ``travel_az``/``travel_el`` (move
    from the previous row, rad), ``slew_az``/``slew_el`` (the same with its sign),
    ``before_az``/``before_el`` (approach of the previous row), ``az_rate``/``el_rate`` (sidereal,
    if the site's latitude is known), ``pm_x``/``pm_y`` (proper motion on the sky of the Hipparcos
    star, arcsec a year),
    ``pier_side`` (-1 through the pole, else 1; for mounts that go there), ``counterweight`` (German
    mounts: component of the counterweight's pull across the first axis, 1 to -1), and the angles
    of the axes by their names (``hour_angle``, ``declination``) besides azimuth and elevation.
    The previous row is the previous one in time if all times are known. `from_run` adds
    ``run_hours`` (hours since the first row of the same run), which single rows do not determine.
    """

    def __init__(self, az, el, columns=None, latitude=None, longitude=None, mount=ALTAZ):
        self.az, self.el = (np.atleast_1d(np.asarray(v, float)) for v in (az, el))
        self.mount = mount
        #: at the axis angles; `term` evaluates terms where they act
        self.trig = Trig(self.az, self.el, mount.with_errors(OF_MOUNT))
        self.columns = dict(columns or {})
        self.latitude, self.longitude = latitude, longitude
        #: False if time has an arbitrary start, or if the angles are not raw readings
        self.time_is_utc, self.raw_reading = True, True
        #: lines per turn by axis and kind, if declared; user columns that are declared drivers
        self.graduation, self.drivers = {}, ()
        #: declared worm wheels: periods per turn by axis
        self.worms = {}
        #: corners of the skyline of the site, in the form of `guard.skyline.parse_horizon`
        self.skyline = ()
        #: context of all rows, if this is a subset of them
        self.whole = None
        #: times and values of drivers logged between and before the rows
        self.logs = {}
        self._derived = dict(zip(mount.names.keys, (self.az, self.el)))

    @classmethod
    def from_run(cls, run, encoder='enc'):
        """The context of a run's rows.

        Parameters
        ----------
        run : PointingRun
            ``meta['site']`` (an object or dict with latitude and longitude) is used if present.
        encoder : {'enc', 'abs'}
            The encoder that is diagnosed: its angles become ``az_enc``, ``el_enc``.
        """
        columns = dict(run.columns)
        if encoder != 'enc':
            columns['az_enc'], columns['el_enc'] = run[f'az_{encoder}'], run[f'el_{encoder}']
        az, el = columns.pop('az'), columns.pop('el')
        site = known_site(run.meta)
        place = {name: site.get(name) for name in ('latitude', 'longitude')}
        if place['latitude'] is None and run.mount.celestial:
            place['latitude'] = run.mount.latitude
        context = cls(az, el, columns, **place, mount=run.mount)
        context.time_is_utc = run.meta.get('time_is_utc', True)
        context.raw_reading = run.meta.get('raw_reading', True)
        from .effects import declared_graduation, declared_worms
        given = run.meta.get('graduation' if encoder == 'enc' else f'graduation_{encoder}')
        if given:
            context.graduation = declared_graduation(given)
        if run.meta.get('worms'):
            context.worms = declared_worms(run.meta['worms'])
        context.drivers = tuple(run.meta.get('drivers') or ())
        context.skyline = tuple(run.meta.get('skyline') or ())
        if run.meta.get('temperature_log'):
            context.logs['temperature'] = np.asarray(run.meta['temperature_log'], float)
        if (hours := context._run_hours()) is not None:
            context.columns.setdefault('run_hours', hours)
        context._drop_noisy_rates()
        return context

    def __len__(self):
        return len(self.az)

    def at(self, az, el, **columns):
        """The same drivers at other directions; `columns` replaces some of them."""
        kept = dict(self.columns)
        if 'time' in columns or 'run' in columns:
            kept.pop('run_hours', None)
        return self._like(Context(az, el, {**kept, **columns}, self.latitude, self.longitude,
                                  self.mount))

    def select(self, rows):
        """Subset of the rows (mask, indices or slice); drivers from the previous row are kept.

        Returns
        -------
        Context
        """
        for name in _INHERITED:
            self.get(name)
        columns = {n: v[rows] if np.ndim(v) else v for n, v in self.columns.items()}
        out = self._like(Context(self.az[rows], self.el[rows], columns, self.latitude,
                                 self.longitude, self.mount))
        out._derived = {n: None if v is None else v[rows] for n, v in self._derived.items()}
        return out

    def _like(self, other):
        """Copy to `other` what is known of the whole run."""
        for name in ('time_is_utc', 'raw_reading', 'graduation', 'worms', 'drivers', 'skyline',
                     'logs'):
            setattr(other, name, getattr(self, name))
        other.whole = self.whole or self
        return other

    def log_of(self, name):
        """Times and values of a driver, from all rows of the run and from its log.

        Returns
        -------
        time, value : ndarray, shape (m,)
            In increasing time; equal times are averaged.
        """
        rows = [(one.get('time'), one.get(name)) for one in {id(c): c for c in (
            self.whole or self, self)}.values()]
        rows = [np.stack(both) for both in rows if all(v is not None for v in both)]
        rows += [self.logs[name]] if name in self.logs else []
        if not rows:
            return np.empty((2, 0))
        rows = np.hstack(rows)
        rows = rows[:, np.isfinite(rows).all(axis=0)]
        time, place = np.unique(rows[0], return_inverse=True)
        return time, np.bincount(place, rows[1]) / np.bincount(place)

    def extra(self):
        """Names of the user's numeric columns that are causes by name, or declared drivers."""
        return [name for name in self.own_columns() if name in self.drivers or is_cause(name)]

    def left_out(self):
        """Names of the user's numeric columns that are not drivers unless declared."""
        taken = self.extra()
        return [name for name in self.own_columns() if name not in taken]

    def own_columns(self):
        """Names of the user's numeric columns."""
        return [name for name, v in self.columns.items()
                if name not in _KNOWN and np.asarray(v).dtype.kind in 'fiub']

    def several_nights(self):
        """Whether the runs are of several nights: ``run_hours`` then repeats, unlike ``time``."""
        hours, time, run = (self.get(name) for name in ('run_hours', 'time', 'run'))
        if hours is None or time is None or run is None or len(np.unique(run)) < 2:
            return False
        # runs of one night share a clock
        return bool(np.ptp(_per_run(np.fmin, time, _labels(run))) > _NIGHT)

    def get(self, name):
        """Driver `name`, shape (n,), or None if it is entirely unknown."""
        if name not in self._derived:
            self._derived[name] = self._find(name)
        return self._derived[name]

    def span(self, name):
        """Finite values of a driver, or the reason why it is unusable.

        Returns
        -------
        values : ndarray or None
        reason : str or None
        """
        value, wording = self.get(name), self.wording(name)
        if value is None:
            return None, UNKNOWN.get(name, f'{wording} is not known')
        finite = value[np.isfinite(value)]
        if len(finite) < 0.5 * len(value):
            return None, f'{wording} is known in only {len(finite)} of {len(value)} rows'
        low, high = float(finite.min()), float(finite.max())
        if high - low <= 1e-9 * max(abs(low), abs(high)):
            return None, f'{wording} does not vary'
        return finite, None

    def wording(self, name):
        """Name of a driver for people: ``approach_az`` is "direction of approach in hour angle"."""
        if name in self.columns and name not in _KNOWN:
            words = _UNIT.sub('', name).replace('_', ' ')
            return words if words == name else f'{words} (column {name})'
        kind, axis = name.removesuffix('_rate'), ''
        if kind == name:
            kind, _, axis = name.rpartition('_')
        else:
            kind, axis = 'rate', kind
        if axis not in ('az', 'el') or kind not in _IN_WORDS:
            return name
        return f'{_IN_WORDS[kind]} {self.mount.names.word(axis)}'

    def _find(self, name):
        value = self.columns.get(name)
        if value is None:
            head, _, axis = name.rpartition('_')
            if hasattr(self, f'_derive_{name}'):
                value = getattr(self, f'_derive_{name}')()
            elif hasattr(self, f'_derive_{head}') and axis in ('az', 'el', 'x', 'y'):
                value = getattr(self, f'_derive_{head}')(axis)
        if value is None or np.asarray(value).dtype.kind not in 'fiub':
            return None
        value = np.broadcast_to(np.asarray(value, float), self.az.shape)
        return value if np.isfinite(value).any() else None

    # ------------------------------------------------------------------------------- derived

    def on_horizon(self):
        """Azimuth and elevation of the places, for either way of pointing there."""
        return self.mount.horizon_of(self.az, self.el)

    def _derive_azimuth(self):
        return self.on_horizon()[0]

    def _derive_elevation(self):
        return self.on_horizon()[1]

    def _derive_pier_side(self):
        beyond = is_beyond(self.el)
        if self.mount.vertical and not np.any(beyond):
            return None
        return np.where(beyond, -1.0, 1.0)

    def _derive_counterweight(self):
        # of a level counterweight shaft; it turns with the first axis
        return np.cos(self.az) if self.mount.two_sided else None

    @cached_property
    def _sequence(self):
        """Rows in the order of observation, run after run, and which of them begin a run."""
        label = np.zeros(len(self), int)
        run = self.columns.get('run')
        if run is not None:
            label = _labels(np.broadcast_to(np.asarray(run), self.az.shape))
        rows, time = np.arange(len(self)), self.get('time')
        if time is not None and np.isfinite(time).all():
            rows = np.lexsort((time, label))
        starts = np.zeros(len(self), bool)
        starts[:1] = True
        starts[1:] |= np.diff(label[rows]) != 0
        return rows, starts

    def _from_before(self, value):
        """`value(rows, previous rows)` for each row; NaN where a run begins."""
        rows, starts = self._sequence
        out = np.full(len(self), np.nan)
        out[rows[1:]] = value(rows[1:], rows[:-1])
        out[rows[starts]] = np.nan
        return out

    def _run_hours(self):
        time = self.get('time')
        if time is None:
            return None
        run = self.columns.get('run')
        label = np.zeros(len(self), int) if run is None else _labels(run)
        return (time - _per_run(np.fmin, time, label)[label]) / 3600.0

    def _derive_order(self):
        rows, starts = self._sequence
        starts = np.flatnonzero(starts)
        length = np.diff(np.append(starts, len(self)))
        position = np.arange(len(self)) - np.repeat(starts, length)
        order = np.empty(len(self))
        order[rows] = position / np.repeat(np.maximum(length - 1, 1), length)
        return order

    def _derive_lst(self):
        hours = self.columns.get('lst_h')
        if hours is not None:
            return np.asarray(hours, float) * (np.pi / 12.0)
        time = self.get('time')
        if time is None or self.longitude is None or not self.time_is_utc:
            return None
        # Greenwich mean sidereal time with UT1 = UTC: at most 15" off, constant over a night
        return self.longitude + 4.894961212735793 + _TURN * 1.00273790935 * (
            (time - _J2000) / 86400.0)

    def _derive_reading(self, axis):
        raw = self.columns.get(f'{axis}_raw')
        if raw is not None:
            return raw
        if not self.raw_reading:
            return None
        angle = self.columns.get(f'{axis}_enc')
        miss = self.columns.get('miss_x' if axis == 'az' else 'miss_y')
        if angle is None or miss is None:
            return angle
        miss = np.nan_to_num(np.asarray(miss, float))
        return angle - (miss / self.trig.cos_el if axis == 'az' else miss)

    def _derive_travel(self, axis):
        angle = self.columns.get(f'{axis}_enc')
        if angle is None or np.ndim(angle) == 0 or len(self) < 2:
            return None
        angle = np.asarray(angle)
        way = self._from_before(lambda rows, last: angle[rows] - angle[last])
        return np.abs(wrap(way) if axis == 'az' else way)

    def _derive_unwrapped(self, axis):
        # place of the star, in the turn that the encoder reads
        angle = self.az if axis == 'az' else self.el
        reading = self.columns.get(f'{axis}_enc')
        if reading is None:
            return angle
        return angle + _TURN * np.rint((np.asarray(reading, float) - angle) / _TURN)

    def _derive_slew(self, axis):
        angle = self.columns.get(f'{axis}_enc')
        if angle is None or np.ndim(angle) == 0 or len(self) < 2:
            return None
        angle = np.asarray(angle, float)
        side = self.get(f'approach_{axis}')
        way = self._from_before(lambda rows, last: angle[rows] - angle[last])
        # a move of more than half a turn is real if the encoder counts whole turns, or if every
        # approach agrees with it: the mount then never passes the end of its circle
        far = np.abs(way) > 0.5 * _TURN
        if axis == 'az' and np.ptp(angle) <= _TURN and not (
                side is not None and (side * way > 0.0)[far].all()):
            way = wrap(way)
        # more than half a turn, if the direction of approach shows it
        round_ = 0.0 if side is None or axis == 'el' else np.nan_to_num(side * way < 0.0) * (
            np.abs(way) > 0.25 * _TURN)
        return way - _TURN * np.sign(way) * round_

    def _derive_before(self, axis):
        approach = self.get(f'approach_{axis}')
        if approach is None or len(self) < 2:
            return None
        return self._from_before(lambda _, last: approach[last])

    def _derive_az_rate(self):
        return None if self.latitude is None else self._star_rates[0] / self.trig.cos_el

    def _derive_el_rate(self):
        return None if self.latitude is None else self._star_rates[1]

    @cached_property
    def _star_rates(self):
        return star_rates(self.direction(), self.tangent(), self.latitude)

    def _drop_noisy_rates(self):
        """Replace measured rates by sidereal ones if they differ only by noise."""
        x, y = self.columns.get('az_rate'), self.columns.get('el_rate')
        if self.latitude is not None and x is not None and y is not None and are_star_rates(
                x * self.trig.cos_el, y, *self._star_rates):
            del self.columns['az_rate'], self.columns['el_rate']

    def equatorial(self):
        """East-north-up components of the equatorial axes X, Y, Z, or None.

        Returns
        -------
        ndarray, shape (3, 3, n)
            Index of axis, component, row. X and Y need the sidereal time.
        """
        lst = self.get('lst')
        if self.latitude is None or lst is None:
            return None
        from .sky.star_catalogue import equatorial_axes
        return equatorial_axes(lst, self.latitude)

    def tangent(self):
        """East-north-up unit vectors in which the axis angles increase, each of shape (3, n)."""
        return self.mount.tangents(self.az, self.el)

    def direction(self):
        """East-north-up unit vectors of the catalogue place, shape (3, n)."""
        return self.mount.direction(self.az, self.el)

    def _derive_pm(self, axis):
        axes, star = self.equatorial(), self.columns.get('star')
        if axes is None or star is None or np.asarray(star).dtype.kind not in 'iu':
            return None
        from .sky.star_catalogue import proper_motion

        motion = proper_motion(np.broadcast_to(star, self.az.shape), axes)
        return None if motion is None else np.sum(
            motion * self.tangent()['xy'.index(axis)], axis=0) / ARCSEC
