"""The rows of a night as the sky and the two encoders see them, see `cross_check`."""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.context import Context
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun
from pointing_model.terms import design
from pointing_model.zero_drift import harmonic_columns
from pointing_model.zero_exposures import BY_POLARIS, BY_STARS, MARK, is_for_zero, is_marked

from ...estimation.group_columns import GroupColumns, Moves
from ...estimation.step_scan import (
    clipped,
    evidence,
    log_normal,
    probabilities,
    robust_fit,
    two_sided,
)
from ..fit import fit_terms
from ..zero.polaris_zero import zero_from_polaris
from .cross_check_noise import Colour, colour_of, inflation, strongest
from .cross_check_records import Change, Witness
from .cross_check_stars import stars_seen
from .jump_causes import ABSOLUTE, ALIKE, BOTH, INCREMENTAL, MOUNT, NOTHING, causes, likeliest

AXES = ('azimuth', 'elevation')
SHORT = ('az', 'el')

#: terms beside the zeros, of any mount
_OTHERS = slice(2, 7)
#: stars from which the whole sky judges: five terms and the zeros of two power-ons are 9 numbers,
#: for which 12 stars have 24 values
_FEWEST_STARS = 12
#: rows on either side of a step. Two wild readings together at the end of 40 rows make a step in
#: 29 % of the nights with 1 or 2, in 8 % with 3, in 1.5 % with 4, which is also later to see one
SEGMENT = 3
#: steps and drifts of an axis in a night; who has more has another trouble
_MOST_EVENTS = 3
#: prior of what both hypotheses hold alike, wider than any mount's terms: their evidence does not
#: depend on it
_ANYTHING = 3600.0 * ARCSEC


class Sky(NamedTuple):
    """Encoder - model on the sky at the rows, and what a refit may change of it."""

    enc: np.ndarray  # (2n,): x of all rows, then y; no zero taken off
    abs: np.ndarray
    terms: np.ndarray  # (2n, 5)
    fixed: GroupColumns  # of 2n rows: zeros of each power-on, terms of each night, the discs
    noise: float


class Memory(NamedTuple):
    """Correlation of rows with the one before.

    Attributes
    ----------
    apart : ndarray, shape (2,)
        Of incremental - absolute, by axis.
    seen : ndarray, shape (2, 2)
        Against the sky, by axis; incremental and absolute encoder.
    """

    apart: np.ndarray
    seen: np.ndarray


class CrossCheckNight:
    """Rows of the reference night (numbered below 0) and of tonight, in order of time."""

    def __init__(self, rows, reference):
        parts = [rows]
        if isinstance(reference, PointingRun) and len(reference):
            number = reference['run'] - reference['run'].max() - 1.0
            parts.insert(0, PointingRun({**reference.columns, 'run': number},
                                        reference.meta))
        # logs before that column have none
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
        self.stretch = self.run + 0.01 * self._absolute_power_ons()
        #: exposures for a zero, of Polaris or of stars
        self.for_zero = is_for_zero(rows)
        #: rows in a row, of one series and of two
        self.sequence = np.searchsorted(self.runs, self.run)
        self.sequence_2 = np.concatenate([self.sequence, self.sequence + len(self.runs)])
        self.halves = np.repeat([0, 1], len(self.run))
        self.apart = np.stack([wrap(rows['az_enc'] - rows['az_abs']),
                               wrap(rows['el_enc'] - rows['el_abs'])])
        self.cos_el = np.cos(rows['el'])
        self._moves = {}

    def _absolute_power_ons(self):
        """How many the absolute encoder has had in a power-on of the other before each row."""
        out = np.zeros(len(self.run))
        for run in self.runs:
            at = np.flatnonzero(self.run == run)
            known = at[np.isfinite(self.rows['absolute_start'][at])]
            out[known[1:]] = np.cumsum(np.diff(self.rows['absolute_start'][known]) != 0.0)
            out[at] = np.maximum.accumulate(out[at])
        return out

    # --- inside a power-on ------------------------------------------------------------------------

    def moves(self, shortest, runs=None):
        """Candidates: `Moves`, about (run, kind, time) each, for the power-ons of tonight.

        Or for those of `runs`.
        """
        if runs is None and shortest not in self._moves:
            self._moves[shortest] = self.moves(shortest, self.tonight)
        if runs is None:
            return self._moves[shortest]
        blocks, about = [], []
        for run in runs:
            at = np.flatnonzero(self.run == run)
            times = self.rows['time'][at]
            begins = np.arange(shortest, len(at) - shortest + 1)
            columns = (np.arange(len(at))[:, None] >= begins).astype(float)
            about += [(run, 'step', 0.5 * (times[i - 1] + times[i])) for i in begins]
            if len(at) >= 2 * shortest and np.ptp(times) > 0.0:
                columns = np.column_stack([columns, times - times.mean()])
                about.append((run, 'drift', times.mean()))
            if columns.shape[1]:
                blocks.append((at, columns))
        return Moves(len(self.run), blocks, about)

    def apart_base(self, axis):
        """Design of incremental - absolute: power-ons, and both discs, off their axis and tilted.

        Returns
        -------
        GroupColumns
        """
        return GroupColumns(self.sequence, np.ones(len(self.run)),
                       harmonic_columns(self.rows[SHORT[axis]]))

    def apart_events(self, axis, budget):
        """Steps and drifts of incremental - absolute, a list of `EncoderFinding`."""
        moves, base = self.moves(SEGMENT), self.apart_base(axis)
        found = []
        if not len(moves) or len(self.run) <= len(base) + _MOST_EVENTS + 1:
            return found
        while len(found) < _MOST_EVENTS:
            full = base.beside(*(event.column for event in found))
            best = strongest(full, self.apart[axis], moves, budget.false_alarm / 2.0,  # two axes
                             self.sequence)
            if best is None:
                return found
            found.append(EncoderFinding(*moves.about[best.place], moves.column(best.place),
                                        best.amount,
                               best.sigma, best.probability * 2.0))
        return found

    def sky(self, events, model, notes):
        """Residuals against the sky, with a zero for each stretch between the steps found."""
        if np.count_nonzero(~self.for_zero) < _FEWEST_STARS:
            notes.append(f'fewer than {_FEWEST_STARS} stars: Polaris alone stands for the sky')
            return None
        if model is None:
            stretch = self.run + sum(
                (event.column > 0.0) * 2.0 ** -(i + 1) for i, (_, event) in enumerate(events))
            segmented = PointingRun({**self.rows.columns, 'run': stretch}, self.rows.meta)
            try:
                model = fit_terms(segmented, run_zeros=True).model
            except (ValueError, np.linalg.LinAlgError) as err:
                notes.append(f'sky not fitted: {err}')
                return None
        enc = np.concatenate(model.residuals(self.rows))
        second = np.concatenate(
            replace(model, effects=self._shared_effects(model)).residuals(
                self.rows, encoder='abs'))
        terms = np.concatenate(design(self.mount.names.physical[_OTHERS], self.rows['az'],
                                      self.rows['el'], self.mount))
        fixed = GroupColumns(self.sequence_2, np.concatenate([self.cos_el, np.ones(len(self.run))]),
                        np.column_stack([self._of_nights(terms), self._discs()]))
        moved = [self.on(axis, event.column) for axis, event in events]
        noise = robust_fit(fixed.beside(*moved), enc).scatter[0]
        return Sky(enc, second, terms, fixed, noise)

    def _shared_effects(self, model):
        """Those of a model that the absolute encoder shows too.

        An effect of the incremental encoder alone stands in the difference of the two, to the
        same amount.
        """
        shared = []
        for fitted in model.effects:
            axis = {'az': 0, 'el': 1}.get(fitted.effect.axes)
            if axis is not None:
                column = fitted.offsets(Context.of_run(self.rows))[axis]
                column = column / (self.cos_el if axis == 0 else 1.0)
                fit = robust_fit(GroupColumns.of(self.run, rest=column[:, None]), self.apart[axis])
                if fit.coefficients[-1] > 0.5:
                    continue
            shared.append(fitted)
        return shared

    def _of_nights(self, terms):
        """Terms of tonight and of the reference night: the mount may have changed between them."""
        tonight = np.tile(self.run >= 0.0, 2)
        parts = [terms * (tonight == which)[:, None] for which in (True, False)]
        return np.column_stack(parts if not tonight.all() else parts[:1])

    def on(self, axis, column):
        """What a column of coordinate angles makes on the sky, shape (2n,)."""
        nothing = np.zeros(len(self.run))
        return np.concatenate(
            [column * self.cos_el, nothing] if axis == 0 else [nothing, column])

    def _discs(self):
        """What the disc of an encoder may show that the model lacks, the same on all nights."""
        return np.column_stack([self.on(axis, column) for axis in (0, 1)
                                for column in harmonic_columns(self.rows[SHORT[axis]]).T])

    # --- from power-on to power-on ----------------------------------------------------------------

    def memory(self, sky, jumps):
        """How much a row resembles the one before it.

        Parameters
        ----------
        sky : Sky or None
            None: by Polaris alone.
        jumps : list of Jump

        Returns
        -------
        Memory
        """
        columns = [[jump.column for jump in jumps if jump.axis == axis] for axis in (0, 1)]
        bases = [self.apart_base(axis).beside(*columns[axis]) for axis in (0, 1)]
        apart = [colour_of(base, clipped(base, self.apart[axis]), self.sequence).most
                 if len(self.run) > len(base) + 2 else 0.0 for axis, base in enumerate(bases)]
        seen = np.zeros((2, 2))
        if sky is not None:
            base = sky.fixed.beside(*(self.on(jump.axis, jump.column) for jump in jumps))
            for n, y in enumerate((sky.enc, sky.abs)):
                rho = colour_of(base, clipped(base, y), self.sequence_2, self.halves).rho
                seen[:, n] = rho.reshape(2, -1).max(axis=1)
        else:
            at = self.for_zero
            label = np.unique(np.stack([self.stretch[at], is_marked(self.rows)[at]
                                        * self.rows['star'][at]]), axis=1, return_inverse=True)[1]
            label = np.ravel(label).astype(float)
            base = GroupColumns.of(label)
            if len(label) > len(base) + 2:
                rows = self.rows.select(self.for_zero)
                for axis, short in enumerate(SHORT):
                    for n, encoder in enumerate(('enc', 'abs')):
                        y = wrap(rows[f'{short}_{encoder}'] - rows[short])
                        seen[axis, n] = colour_of(base, clipped(base, y), label).most
        return Memory(np.array(apart), seen)

    def witnesses(self, memory, model=None):
        """A `Witness` for each power-on with Polaris, a `StarsSeen` for one with stars.

        `memory` as of `CrossCheckNight.memory`.
        """
        out = []
        for run in np.unique(self.stretch):
            rows = self.stretch == run
            part = self.rows.select(rows & self.for_zero)
            if len(part) < 2:
                continue
            if is_marked(part).any():
                seen = stars_seen(float(run), part.select(is_marked(part)), model, memory.seen)
                out += [seen] if seen is not None else []
                continue
            out.append(self._witness(run, rows, part, memory))
        return out

    def _witness(self, run, rows, part, memory):
        """By Polaris: of `rows`, a mask, its exposures are `part`."""
        zeros = [zero_from_polaris(part, PointingModel({}, mount=self.mount), encoder=encoder)
                 for encoder in ('enc', 'abs')]
        place = (float(np.arctan2(np.sin(part['az']).mean(), np.cos(part['az']).mean())),
                 float(part['el'].mean()))
        apart = [self.apart_at(axis, rows, place[axis], memory.apart[axis]) for axis in (0, 1)]
        count = min(zero.n for zero in zeros)
        more = np.array([[inflation(rho, count) for rho in both] for both in memory.seen])
        return Witness(
            float(run), *place, *(zero.angles for zero in zeros),
            np.array([self._shared(axis, rows & self.for_zero, zeros)
                      * np.sqrt(np.outer(more[axis], more[axis])) for axis in (0, 1)]),
            np.array([value for value, _ in apart]), np.array([sigma for _, sigma in apart]),
            max(int(count / more.max()), 2))

    def _shared(self, axis, rows, zeros):
        """Covariance of (enc, abs) at Polaris: what they do not share is the encoders' noise."""
        enc, second = (zero.covariance[axis, axis] for zero in zeros)
        between = np.var(self.apart[axis][rows], ddof=1) / np.count_nonzero(rows)
        both = 0.5 * (enc + second - between)
        most = np.sqrt(enc * second)
        both = float(np.clip(both, -most, most))
        return np.array([[enc, both], [both, second]])

    def apart_at(self, axis, rows, place, rho):
        """Incremental - absolute of a power-on at Polaris, by all its `rows`; and 1 sigma.

        Of differences that resemble the one before by `rho`.
        """
        angle = self.rows[SHORT[axis]][rows]
        columns = [np.ones(rows.sum())]
        at = [1.0]
        if np.count_nonzero(rows & ~self.for_zero) >= _FEWEST_STARS:
            columns += [np.cos(angle), np.sin(angle)]
            at += [np.cos(place), np.sin(place)]
        colour = Colour(np.where(np.arange(rows.sum()) > 0, rho, 0.0))
        fit = robust_fit(colour.white(np.column_stack(columns)),
                         colour.white(self.apart[axis][rows]))
        return float(fit.coefficients @ at), float(np.sqrt(at @ fit.covariance @ at))

    def circle(self, before, now, model, budget):
        """How the offset differs between the places of two witnesses, and its variance, (2,) each.
        """
        return _circle(before, now, model, budget.term, self.mount)

    def change(self, axis, before, now, circle, budget, tests, sky):
        """`Change` of an axis between two witnesses; `circle` as of the method."""
        enc, second = now.enc[axis] - before.enc[axis], now.abs[axis] - before.abs[axis]
        enc, second = (wrap(enc), wrap(second)) if axis == 0 else (enc, second)
        covariance = before.covariance[axis] + now.covariance[axis]
        circle, extra = circle
        enc, second = enc - circle[axis], second - circle[axis]
        covariance = covariance + extra[axis]
        apart = wrap(now.apart[axis] - before.apart[axis])
        apart_variance = now.apart_sigma[axis] ** 2 + before.apart_sigma[axis] ** 2
        noise = covariance[1, 1]
        expected = np.sqrt(noise + budget.absolute**2)
        freedom = max(before.exposures + now.exposures - 2, 1)
        with np.errstate(divide='ignore'):  # without any noise all of it is known
            freedom *= (expected**2 / noise) ** 2  # Welch: only the noise was estimated
        p = float(two_sided(second / expected, freedom)) * tests
        alarm = p < budget.false_alarm
        moved, tilt = {}, 0.0
        said = causes(apart, apart_variance, second, noise, budget.anomaly, budget.absolute)
        cause, _ = likeliest(said, (ABSOLUTE, BOTH, ALIKE) if alarm else (NOTHING, INCREMENTAL))
        if alarm:
            moved, tilt = self._suspects(axis, before, now, budget, sky, enc, second, apart,
                                         covariance, apart_variance)
            cause = MOUNT if tilt > 0.5 else cause
        return Change(
            AXES[axis], before.run, now.run, float(enc), float(np.sqrt(covariance[0, 0])),
            float(second), float(np.sqrt(noise)), float(apart), float(np.sqrt(apart_variance)),
            float(second / expected), min(p, 1.0), bool(alarm), moved, tilt, cause, said,
            BY_POLARIS if now.stars is None else BY_STARS)

    def _suspects(self, axis, before, now, budget, sky, enc, second, apart, covariance,
                  apart_variance):
        """Whether the absolute encoder or the mount moved, posterior; and whether that leans."""
        usual = budget.power_on**2
        # had only the absolute encoder moved, incremental - sky is a usual drift; had the mount,
        # incremental - absolute is
        alone = log_normal(enc, covariance[0, 0] + usual)
        together = log_normal(apart, apart_variance + usual + budget.absolute**2)
        logs = {ABSOLUTE: alone, MOUNT: together + np.log(0.5), 'tilt': together + np.log(0.5)}
        rows = np.isin(self.stretch, (before.run, now.run))
        stars = [np.count_nonzero((self.stretch == w.run) & ~self.for_zero) for w in (before, now)]
        if sky is not None and min(stars) >= _FEWEST_STARS:
            both = np.tile(rows, 2)
            after = (self.stretch == now.run).astype(float)
            later = np.tile(after, 2)[:, None]
            zeros = [self.on(k, after) for k in (0, 1)]
            fixed = np.column_stack([sky.terms, *(self.on(k, np.ones(len(rows)))
                                                  for k in (0, 1)), *zeros])
            y = clipped(np.column_stack([fixed, sky.terms * later]), sky.abs)[both]
            # the other axis may have moved as well
            width = [budget.anomaly] * 2
            wide = [_ANYTHING] * 7
            slip = evidence(fixed[both], y, sky.noise, [*wide, *width])
            logs[ABSOLUTE] += slip
            logs[MOUNT] += slip  # about the axis itself: as a slip of both encoders
            logs['tilt'] += evidence(
                np.column_stack([fixed, sky.terms * later])[both], y, sky.noise,
                [*wide, *[budget.absolute if k == axis else budget.anomaly for k in (0, 1)],
                 *[budget.anomaly] * sky.terms.shape[1]])
        out = probabilities(logs)
        return {ABSOLUTE: out[ABSOLUTE], MOUNT: out[MOUNT] + out['tilt']}, out['tilt']


class EncoderFinding(NamedTuple):
    """A step, drift or walk of incremental - absolute, its column shape (n,), before it is judged.
    """

    run: float
    kind: str
    time: float
    column: np.ndarray
    amount: float
    sigma: float
    probability: float
    #: that the incremental encoder did it, before the stars are asked
    odds: float = 1.0


def _circle(before, now, model, term_sigma, mount):
    """How the offset differs between two places of Polaris, (2,), and its variance, (2,).

    Or of the same stars.
    """
    if model is not None:
        offsets = [_over(w, model.offsets) for w in (before, now)]
        names, spread = tuple(model.terms), model.covariance
    else:
        offsets = [np.zeros(2)] * 2
        names = mount.names.physical[_OTHERS]
        spread = np.eye(len(names)) * term_sigma**2
    then, later = (_over(w, partial(design, names, mount=mount)) for w in (before, now))
    moved = later - then
    return offsets[1] - offsets[0], np.diag(moved @ spread @ moved.T)


def _over(witness, offsets):
    """What ``offsets(az, el)`` gives on the sky, (s,) or (s, k) an axis, as its angles have it."""
    if witness.stars is None:
        x, y = offsets(np.array([witness.az]), np.array([witness.el]))
        return np.stack([x[0] / np.cos(witness.el), y[0]])
    az, el, weights = witness.stars
    return np.einsum('as,as...->a...', weights, np.stack(offsets(az, el)))
