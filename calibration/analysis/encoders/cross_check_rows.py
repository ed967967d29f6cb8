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

"""The rows of a night with differences of sky and both encoders, for `cross_check`."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.context import Context
from pointing_model.pointing_terms import design
from pointing_model.runs.run import PointingRun
from pointing_model.zero import MARK, is_for_zero, is_marked
from pointing_model.zero_drift import harmonic_columns

from ...estimation.group_columns import GroupColumns
from ...estimation.step_scan import LocalColumns, noise_beside, robust_fit
from ..finding import Finding
from ..term_fit import fit_terms

AXES = ('azimuth', 'elevation')
SHORT = ('az', 'el')
INCREMENTAL, ABSOLUTE, MOUNT = 'incremental encoder', 'absolute encoder', 'mount or sky'
NOTHING, BOTH = 'nothing', 'both encoders'
#: both moved equally, which is indistinguishable from a turn of the mount about this axis
ALIKE = 'both or mount'

#: fewest stars to compare with the sky: five terms and the zeros of two power-ons are 9 parameters,
#: for which 12 stars give 24 values
FEWEST_STARS = 12
#: smallest noise of a reading: a count of the incremental encoder (0.0686") / sqrt(12)
LEAST = 0.02 * ARCSEC
#: physical terms other than the zeros, for any mount
OTHERS = slice(2, 7)


class Budget(NamedTuple):
    """Usual changes, 1 sigma in rad, and the false-alarm probability."""

    #: change of the absolute encoder's zero
    absolute: float = 0.5 * ARCSEC
    #: change of the incremental encoder's zero at a power-on
    power_on: float = 20.0 * ARCSEC
    #: the mount's terms, if no model is given
    term: float = 60.0 * ARCSEC
    #: size of an unusual change; affects the posterior probabilities only
    anomaly: float = 20.0 * ARCSEC
    #: false-alarm probability per night, over all tests of one of three kinds: inside a power-on,
    #: against the sky, from power-on to power-on
    false_alarm: float = 0.005 / 3
    #: probability that a jump of one encoder inside a power-on is attributed to both
    second: float = 0.01


USUAL = Budget()


class SkyResiduals(NamedTuple):
    """Encoder - model on the sky at the rows, and the columns of a refit."""

    incremental: np.ndarray  # (2n,): x of all rows, then y; no zero subtracted
    absolute: np.ndarray
    terms: np.ndarray  # (2n, 5)
    design: GroupColumns  # 2n rows: zeros of each power-on, terms of each night, disc errors
    noise: float


class NightNoise(NamedTuple):
    """Correlation of consecutive rows.

    Attributes
    ----------
    difference : tuple of CorrelatedNoise
        Noise of incremental - absolute, for each axis.
    sky : ndarray, shape (2, 2)
        Correlation of residuals against the sky, by axis; incremental and absolute encoder.
    """

    difference: tuple
    sky: np.ndarray


class CrossCheckNight:
    """Rows of the reference night (numbered below 0) and of tonight, in order of time.

    Attributes
    ----------
    run : ndarray, shape (n,)
        Power-on of the incremental encoder.
    interval : ndarray, shape (n,)
        Interval without a power-on of either encoder: `run`, plus 0.01 for each power-on of the
        absolute encoder within it.
    for_zero : ndarray of bool, shape (n,)
        Exposures for a zero, of Polaris or of stars.
    difference : ndarray, shape (2, n)
        Incremental - absolute, coordinate angles, rad.
    begins : ndarray of int
        First row of each place: of the exposures in a row of one star.
    """

    def __init__(self, rows, reference):
        parts = [rows]
        if isinstance(reference, PointingRun) and len(reference):
            number = reference['run'] - reference['run'].max() - 1.0
            parts.insert(0, PointingRun({**reference.columns, 'run': number},
                                        reference.meta))
        # older logs do not have this column
        parts = [PointingRun({**part.columns, 'absolute_start': part.get('absolute_start'),
                              MARK: is_marked(part)}, part.meta) for part in parts]
        table = PointingRun.concatenate(parts)
        usable = np.isfinite([table[name] for name in (
            'az', 'el', 'az_enc', 'el_enc', 'az_abs', 'el_abs', 'time')]).all(axis=0)
        table = table.select(np.flatnonzero(usable))
        self.rows = rows = table.select(np.lexsort((table['time'], table['run'])))
        self.mount = rows.mount
        self.run = rows['run'].astype(float)
        self.runs = np.unique(self.run)
        self.tonight = self.runs[self.runs >= 0.0]
        self.interval = self.run + 0.01 * self._absolute_power_ons()
        self.for_zero = is_for_zero(rows)
        self.difference = np.stack([wrap(rows['az_enc'] - rows['az_abs']),
                                    wrap(rows['el_enc'] - rows['el_abs'])])
        self.cos_el = np.cos(rows['el'])
        self.begins = np.flatnonzero((np.diff(
            [self.run, self.interval, rows['star']], prepend=np.nan) != 0.0).any(axis=0))

    def by_place(self, values):
        """Means over the exposures in a row of one place, shape (..., places).

        They share the errors of graduation and subdivision of that place.
        """
        counts = np.diff(self.begins, append=len(self.run))
        return np.add.reduceat(values, self.begins, axis=-1) / counts

    def _absolute_power_ons(self):
        """Number of power-ons of the absolute encoder before each row, within one of the other."""
        out = np.zeros(len(self.run))
        for run in self.runs:
            at = np.flatnonzero(self.run == run)
            known = at[np.isfinite(self.rows['absolute_start'][at])]
            out[known[1:]] = np.cumsum(np.diff(self.rows['absolute_start'][known]) != 0.0)
            out[at] = np.maximum.accumulate(out[at])
        return out

    def candidates(self, shortest, runs=None, drifts=True):
        """Candidate steps, at least `shortest` rows from the ends of a power-on, and drifts.

        Parameters
        ----------
        shortest : int
        runs : sequence of float, optional
            By default the power-ons of tonight.
        drifts : bool

        Returns
        -------
        LocalColumns
            Columns for coordinate angles, labelled (run, kind, time).
        """
        blocks, labels = [], []
        for run in self.tonight if runs is None else runs:
            at = np.flatnonzero(self.run == run)
            times = self.rows['time'][at]
            begins = np.arange(shortest, len(at) - shortest + 1)
            columns = (np.arange(len(at))[:, None] >= begins).astype(float)
            labels += [(run, 'step', 0.5 * (times[i - 1] + times[i])) for i in begins]
            if drifts and len(at) >= 2 * shortest and np.ptp(times) > 0.0:
                columns = np.column_stack([columns, times - times.mean()])
                labels.append((run, 'drift', times.mean()))
            if columns.shape[1]:
                blocks.append((at, columns))
        return LocalColumns(len(self.run), blocks, labels)

    def difference_design(self, axis):
        """GroupColumns for incremental - absolute: power-ons, eccentricity and tilt of discs."""
        return GroupColumns.of(self.run, common=harmonic_columns(self.rows[SHORT[axis]]).T)

    def on_sky(self, axis, column):
        """Convert a column of coordinate angles to the sky, shape (2n,)."""
        nothing = np.zeros(len(self.run))
        return np.concatenate(
            [column * self.cos_el, nothing] if axis == 0 else [nothing, column])

    def sky(self, events, model, notes):
        """Residuals against the sky, with a separate zero between the events found.

        Parameters
        ----------
        events : list of DifferenceEvent
        model : PointingModel or None
            None: fitted to the night.
        notes : list of Finding
            If there are none, the reason is appended.

        Returns
        -------
        SkyResiduals or None
            None if there are too few stars.
        """
        if np.count_nonzero(~self.for_zero) < FEWEST_STARS:
            notes.append(Finding('few stars for the sky'))
            return None
        if model is None:
            part = self.run + sum(
                (event.column > 0.0) * 2.0 ** -(i + 1) for i, event in enumerate(events))
            try:
                model = fit_terms(PointingRun({**self.rows.columns, 'run': part}, self.rows.meta),
                                  run_zeros=True).model
            except (ValueError, np.linalg.LinAlgError) as err:
                notes.append(Finding('sky not fitted', evidence={'why': str(err)}))
                return None
        incremental = np.concatenate(model.residuals(self.rows))
        absolute = np.concatenate(replace(model, effects=self._shared_effects(model)).residuals(
            self.rows, encoder='abs'))
        terms = np.concatenate(design(self.mount.names.physical[OTHERS], self.rows['az'],
                                      self.rows['el'], self.mount))
        # disc errors beyond the model, common to all nights
        discs = [self.on_sky(axis, column) for axis in (0, 1)
                 for column in harmonic_columns(self.rows[SHORT[axis]]).T]
        number = np.searchsorted(self.runs, self.run)
        columns = GroupColumns(np.concatenate([number, number + len(self.runs)]),
                               np.concatenate([self.cos_el, np.ones(len(self.run))])[None],
                               np.vstack([*(of.T for of in self._by_night(terms)), *discs]))
        moved = [self.on_sky(event.axis, event.column) for event in events]
        noise = robust_fit(columns.beside(*moved), incremental).scatter[0]
        return SkyResiduals(incremental, absolute, terms, columns, noise)

    def _shared_effects(self, model):
        """Effects of a model that also apply to the absolute encoder.

        An effect of the incremental encoder alone appears in the difference of the two with the
        same amount.
        """
        shared = []
        for fitted in model.effects:
            axis = {'az': 0, 'el': 1}.get(fitted.effect.axes)
            if axis is not None:
                column = fitted.offsets(Context.from_run(self.rows))[axis]
                column = column / (self.cos_el if axis == 0 else 1.0)
                fit = robust_fit(GroupColumns.of(self.run, common=column[None]),
                                 self.difference[axis])
                if fit.coefficients[-1] > 0.5:
                    continue
            shared.append(fitted)
        return shared

    def _by_night(self, terms):
        """Separate terms for tonight and for the reference night, between which they may change."""
        tonight = np.tile(self.run >= 0.0, 2)
        return [terms * (tonight == which)[:, None] for which in np.unique(tonight)[::-1]]

    def noise(self, sky, events):
        """Estimate the correlation of consecutive rows, a NightNoise.

        Parameters
        ----------
        sky : SkyResiduals or None
            None: from Polaris alone.
        events : list of EncoderEvent
            Motions inside power-ons.
        """
        columns = [[event.column for event in events if event.axis == name] for name in AXES]
        difference = tuple(noise_beside(self.difference_design(axis).beside(*columns[axis]),
                                        self.difference[axis], self.run) for axis in (0, 1))
        if sky is not None:
            fitted = sky.design.beside(*(self.on_sky(AXES.index(event.axis), event.column)
                                         for event in events))
            return NightNoise(difference, np.stack([
                noise_beside(fitted, y, self.run).neighbour
                for y in (sky.incremental, sky.absolute)], axis=1))
        rows = self.rows.select(self.for_zero)
        label = np.unique(np.stack([self.interval[self.for_zero], is_marked(rows) * rows['star']]),
                          axis=1, return_inverse=True)[1].ravel()
        return NightNoise(difference, np.array([[
            noise_beside(GroupColumns.of(label), wrap(rows[f'{short}_{encoder}'] - rows[short]),
                         label).neighbour[0]
            for encoder in ('enc', 'abs')] for short in SHORT]))
