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

"""A zero that tracks the absolute encoder while the counts of the incremental encoder drift.

Incremental - absolute is measured at every exposure without any star. It has three parts:
a reference, at which the active zero is right; low harmonics of the angle, caused by the encoder
discs and part of the model; and the rest, the drift of the counts, which is added to the zero.
"""

from dataclasses import dataclass, field

import numpy as np

from msg_tools.units import ARCSEC, wrap

from .runs.run import PointingRun

AXES = ('az', 'el')
WORDS = {'az': 'azimuth', 'el': 'elevation'}
#: key in a model's provenance
KEY = 'zero_follows'
#: orders of the disc errors: eccentricity and tilt
ORDERS = (1, 2)


def harmonic_columns(angle, orders=ORDERS):
    """cos and sin of an angle for each order, shape (n, 2 len(orders))."""
    angle = np.asarray(angle, dtype=float)
    return np.stack([f(k * angle) for k in orders for f in (np.cos, np.sin)], axis=-1)


@dataclass(frozen=True)
class AxisFollowing:
    """Tracking parameters of the zero of one axis.

    Attributes
    ----------
    discs : ndarray, shape (4,)
        Disc harmonics of incremental - absolute, see `harmonic_columns`, rad.
    references : dict of int to float
        Power-on -> incremental - absolute, without discs, at which its zero is right, rad.
    noise : float
        1 sigma of a difference, the noise added by tracking, rad.
    step : float
        1 sigma of the unknown drift of the counts on the way to the next star, rad.
    starts : dict of int to float
        Power-on -> begin of the absolute encoder's power-on at the reference, UTC s; only
        where it was reported.
    """

    discs: np.ndarray
    references: dict = field(default_factory=dict)
    noise: float = 0.0
    step: float = 0.0
    starts: dict = field(default_factory=dict)

    def stopped(self, run, start):
        """Whether the absolute encoder was power-cycled since the reference.

        Its zero is unknown since then, so it must not be tracked.

        Parameters
        ----------
        run : float or ndarray, shape (n,)
        start : float or ndarray, shape (n,)
            Begin of its power-on, UTC s; NaN if not reported: then never stopped.

        Returns
        -------
        ndarray of bool
        """
        run, start = np.broadcast_arrays(np.asarray(run, float), np.asarray(start, float))
        out = np.zeros(run.shape, bool)
        for number, began in self.starts.items():
            out |= (run == number) & np.isfinite(start) & (start != began)
        return out

    def moved(self, run, incremental, absolute):
        """Drift of the counts, rad; 0 in a power-on without a reference.

        Valid only without a power cycle of the absolute encoder: see `stopped`.

        Parameters
        ----------
        run : float or ndarray, shape (n,)
        incremental, absolute : float or ndarray, shape (n,)
            Readings, rad.
        """
        run, incremental = np.asarray(run, float), np.asarray(incremental, float)
        out = np.zeros(np.shape(incremental))
        difference = wrap(incremental - absolute) - harmonic_columns(incremental) @ self.discs
        for number, reference in self.references.items():
            out = np.where(run == number, wrap(difference - reference), out)
        return out


@dataclass(frozen=True)
class Following:
    """Which axes track the absolute encoder, and how; none by default.

    Attributes
    ----------
    axes : dict of str to AxisFollowing
        Keys are ``az`` and ``el``.
    """

    axes: dict = field(default_factory=dict)

    def __bool__(self):
        return bool(self.axes)

    def moved(self, run, incremental, absolute):
        """Drift of the counts, shape (2,) or (2, n), rad; see `AxisFollowing.moved`.

        Zero for readings that are not finite.
        """
        out = np.zeros(np.shape(incremental))
        for i, name in enumerate(AXES):
            if name in self.axes:
                out[i] = np.nan_to_num(self.axes[name].moved(run, incremental[i], absolute[i]))
        return out

    def stopped(self, run, start):
        """Whether tracking has stopped on any axis; see `AxisFollowing.stopped`."""
        shape = np.broadcast_shapes(np.shape(run), np.shape(start))
        return np.any([np.zeros(shape, bool), *(
            axis.stopped(run, start) for axis in self.axes.values())], axis=0)

    def sigma(self):
        """Error of the zero due to tracking, shape (2,), coordinate angles, rad."""
        return np.array([np.hypot(self.axes[name].noise, self.axes[name].step)
                         if name in self.axes else 0.0 for name in AXES])

    def corrected(self, rows):
        """The rows corrected for the drift of the counts.

        Rows used for the fit are corrected with their own readings. A row that was pointed blind
        (``check``) is corrected only with the drift of the previous row: no more was known when the
        mount was sent there.

        Parameters
        ----------
        rows : PointingRun
            In order of time, with ``run``, ``az_abs`` and ``el_abs``; unchanged without them.

        Returns
        -------
        PointingRun
        """
        if not self or 'az_abs' not in rows:
            return rows
        readings = [np.array([rows[f'{name}_{of}'] for name in AXES]) for of in ('enc', 'abs')]
        run = np.asarray(rows['run'], float)
        moved = self.moved(run, *readings)
        known = np.isfinite(readings).all(axis=(0, 1))
        known &= ~self.stopped(run, rows.get('absolute_start', np.nan))
        place = np.where(known, np.arange(len(run)), -1)
        last = np.maximum.accumulate(place)
        before = np.concatenate([[-1], last[:-1]])
        usable = (before >= 0) & (run[before] == run)
        blind = np.asarray(rows.get('check', 0.0), float) != 0.0
        use = np.where(blind & usable, before, np.where(known, np.arange(len(run)), before))
        moved = np.where((use >= 0) & (run[use] == run), moved[:, use], 0.0)
        return PointingRun({**rows.columns, **{
            f'{name}_enc': readings[0][i] - moved[i] for i, name in enumerate(AXES)}}, rows.meta)

    def document(self):
        """JSON-ready, for a model's provenance."""
        return {WORDS[name]: {
            'follows': 'absolute encoder',
            'reference': [{'run': int(run), 'difference_arcsec': float(value / ARCSEC),
                           **({'absolute_start': axis.starts[run]} if run in axis.starts else {})}
                          for run, value in sorted(axis.references.items())],
            'discs_arcsec': dict(zip(_DISC_NAMES, (axis.discs / ARCSEC).tolist())),
            'noise_arcsec': axis.noise / ARCSEC, 'step_arcsec': axis.step / ARCSEC,
        } for name, axis in self.axes.items()}

    @classmethod
    def from_model(cls, model):
        """The tracking in a model's provenance; ValueError if it is damaged."""
        entries = {} if model is None else model.provenance.get(KEY) or {}
        try:
            return cls({name: AxisFollowing(
                np.array([entries[word]['discs_arcsec'][n] for n in _DISC_NAMES], float) * ARCSEC,
                {int(row['run']): row['difference_arcsec'] * ARCSEC
                 for row in entries[word]['reference']},
                entries[word]['noise_arcsec'] * ARCSEC, entries[word]['step_arcsec'] * ARCSEC,
                {int(row['run']): float(row['absolute_start']) for row in entries[word]['reference']
                 if row.get('absolute_start') is not None})
                for name, word in WORDS.items() if word in entries})
        except (KeyError, TypeError, AttributeError):
            raise ValueError(f'{KEY} of the model is damaged: {entries!r:.60}') from None


_DISC_NAMES = tuple(f'{f}_{k}' for k in ORDERS for f in ('cos', 'sin'))
