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

"""Check, before any conclusion, whether the columns of a run hold what their names say.

The seven physical terms are fitted robustly to the run as written and under other readings
(`readings`). The misfit is a robust scatter. It is divided by the scale factor from the columns as
written to on-sky offsets, so that misfits of two readings compare as likelihoods do.
"""

from dataclasses import dataclass, field

import numpy as np

from msg_tools.units import DEG
from pointing_model.runs.run import PointingRun

from ..finding import Finding
from .clock_and_site import other_places
from .file_rows import FileRows
from .reading_fits import FEW, MOST_LEFT_OUT, ReadingFits
from .readings import (
    MIRRORED,
    NEGATED,
    SIGNS,
    SOUTH,
    Reading,
    double_readings,
    single_readings,
    without_signs,
)

#: robust radial RMS, arcsec, above which no terms describe a run as written: of 73 measured runs
#: the largest values are 37 and 13; a loose amateur mount has 90.
ABSURD = 1800.0
#: smallest and largest RMS of a fit, arcsec: below what a detector resolves, above any mount
_FITS = (0.05, 600.0)
#: noise ratio and log-likelihood by which another reading must beat a run that would pass as
#: written. Of 73 measured runs none has another reading beyond 0.8 times as good, except for a bad
#: night (1.7 times; the effects below explain it, too). With zenith distances in both pairs 67 of
#: 70 runs of three telescopes are recognised; the other three have 2, 15 and 46 rows.
_BETTER, _LIKELIER = 1.25, 15.0
#: radial RMS ratio for on-sky offsets given in a file: exchanged, they may fit one axis by chance
_CLEARLY = 1.5
#: the same for a mount taken to be a fork, since nobody says what it is, read as a German one
_FLEXED = 2.0
#: noise ratio and log-likelihood if common effects are fitted, too (`usual` of the kind of mount)
_WITH_EFFECTS = (1.15, 10.0)
#: largest number of these effects fitted to the run as written, as an alternative to a mistake
_MOST_EFFECTS = 2
#: misfit ratio or log-likelihood within which two readings are indistinguishable
_ALIKE, _AS_LIKELY = 1.05, 3.0
_NEAR = 3.0  # largest first-order noise of a reading, relative to the best, if the run fits as is
_WRONG = {'columns': 'the columns are not what they are named', 'times': 'the times are not UTC',
          'site': 'the site is wrong', 'syncs': 'the mount was synchronised on each star'}
_DAY = 18.0  # smallest span of azimuths in hours
#: deg and rows: width in hour angle, length in declination and fewest rows of a strip along the
#: meridian, which nobody observes
_STRIP, _STRIP_LONG, _STRIP_ROWS = 13.0, 60.0, 12
_FIELD = 2.0 * DEG  # columns of a run within a smaller field cannot be checked


class MistakenColumns(ValueError):
    """The columns of a run do not hold what their names say.

    Parameters
    ----------
    text : str
        Message, one line.
    readings : list of dict
        ``reading`` and ``rms_arcsec`` of the readings that fit, best first.
    rows_read, rows_used : int
        Number of rows with the columns as written.
    """

    def __init__(self, text, readings=(), rows_read=0, rows_used=0):
        super().__init__(text)
        self.readings, self.rows_read, self.rows_used = list(readings), rows_read, rows_used


@dataclass
class ColumnCheck:
    """Result of the check of a run that passed.

    Attributes
    ----------
    alike : list of str
        Readings that fit as well and differ by signs, or fit better but only as well as effects.
    findings : list of Finding
    """

    alike: list = field(default_factory=list)
    findings: list = field(default_factory=list)

    @classmethod
    def of(cls, each):
        """Merge the checks of several runs: the readings common to all, the findings of each."""
        alike = [text for text in dict.fromkeys(t for one in each for t in one.alike)
                 if all(text in one.alike for one in each)]
        return cls(alike, [found for one in each for found in one.findings])

    def doubts(self, names):
        """The findings, and one on equally good readings; `names`: names of the mount."""
        unsigned = without_signs(self.alike, names)
        return [*self.findings, *([Finding('columns alike', causes=tuple(unsigned))]
                                  if unsigned else [])]


def check_columns(runs, encoder='enc'):
    """Check that the columns of runs hold what their names say.

    Parameters
    ----------
    runs : PointingRun or sequence of PointingRun
        Each is checked separately, from the columns as in its file (``meta['as_written']``).
    encoder : {'enc', 'abs'}

    Returns
    -------
    ColumnCheck

    Raises
    ------
    MistakenColumns
        The run as written does not fit, or another reading fits far better.
    """
    runs = [runs] if isinstance(runs, PointingRun) else list(runs)
    return ColumnCheck.of([_RunCheck(run, encoder).result() for run in runs
                           if f'az_{encoder}' in run])


class _RunCheck:
    """Column check of one run."""

    def __init__(self, run, encoder):
        self.rows = rows = FileRows(run, encoder)
        self.mount, self.fits = rows.mount, ReadingFits(rows)
        self.physical, self.effects = rows.mount.names.physical, rows.mount.names.usual

    def result(self):
        """The `ColumnCheck`; raises MistakenColumns."""
        if len(self.rows.label) < FEW or all(  # one small field under any reading
                np.ptp(column) < _FIELD for column in self.rows.columns[:2]):
            return ColumnCheck()
        written = self.fits.fit(Reading(), centred=False)
        far = self.rows.misplaced > MOST_LEFT_OUT * self.rows.rows_read
        if written is None or written.rms_arcsec > ABSURD or far:
            self._explain(written, far)
            return ColumnCheck()
        south = self.mount.vertical and abs(np.remainder(written.zeros[0], 2.0 * np.pi)
                                         - np.pi) < SOUTH
        others = self.fits.best([r for r in self._single() if r != MIRRORED], _NEAR)
        if south:
            self._refuse(written, [self.fits.fit(Reading())])
        # the mirror image fits exactly as well: no fit is needed
        out = ColumnCheck()
        out.alike = [] if self.rows.held else [MIRRORED.text(names=self.mount.names)]
        better = [other for other in others if self._is_better(other, written, others, out)]
        if better:
            better = _alike(better)
            out.findings.append(Finding(
                'better reading', causes=tuple(one.text for one in better),
                before=written.rms_arcsec, after=better[0].rms_arcsec, caution=True, evidence={
                    'where': self.rows.where, 'what': better[0].reading.kind}))
        elsewhere = _likeliest([fit for fit in others if fit.reading.elsewhere
                                and fit.better_than(written)[0] > 1.0 / _ALIKE])
        if not out.findings and elsewhere and elsewhere.better_than(written)[1] > -_AS_LIKELY:
            out.findings.append(Finding('reading as good', causes=(elsewhere.text,), evidence={
                'where': self.rows.where, 'what': elsewhere.reading.kind,
                'sizes_deg': _sizes(elsewhere), 'as_written_deg': _sizes(written)}))
        return out

    def _is_better(self, other, written, others, out):
        """Raise MistakenColumns if `other` is clearly right; return whether it is better."""
        # a fork's flexure may look like an unnoticed change of side
        german = 'sideless' in other.reading.encoders and not self.mount.two_sided
        least = _FLEXED if german else _CLEARLY if other.reading.given else 0.0
        if other.rms_arcsec * least > written.rms_arcsec:
            return False
        if other.far_better_than(written, _BETTER, _LIKELIER) and other.rms_arcsec < _FITS[1]:
            if self._is_clear(other.reading) or self._needed(other, written):
                alike = _alike(others)
                self._refuse(written, alike if other in alike else [other])
            if other.rms_arcsec < written.rms_arcsec / _BETTER or other.reading.elsewhere or (
                    other.reading == NEGATED):
                return True
            out.alike.append(other.text)
        elif other.reading in SIGNS and other.as_good_as(written, _ALIKE, _AS_LIKELY):
            # ignore other readings that fit as well: with a drifting mount one often does
            out.alike.append(other.text)
        return False

    def _single(self):
        return [*single_readings(self.rows.held, self.mount, self.rows.lst is not None),
                *other_places(self.rows)]

    def _is_clear(self, reading):
        """Whether the first angle obviously is in hours or radians, by the range of its numbers.

        Azimuths that span 0 to 24 are hours, as no dome limits them to such a sector. A narrow
        range of hour angles with declinations all over the sky is in hours or radians.
        """
        first, second = (np.asarray(v) / DEG for v in self.rows.columns[:2])
        if not set(reading.catalogue) & {'hours', 'radians of the first'} or (
                'swapped' in reading.catalogue):
            return False
        if self.mount.vertical:
            return 'hours' in reading.catalogue and first.min() >= 0.0 and np.ptp(first) > _DAY
        return len(first) >= _STRIP_ROWS and np.ptp(first) < _STRIP and np.ptp(second) > _STRIP_LONG

    def _needed(self, other, written):
        """Whether the other reading still fits far better if common effects are fitted.

        Either a few effects with the columns as written and none in the other reading, or all
        effects in both.
        """
        terms, amended = self.physical, written
        for _ in range(_MOST_EFFECTS):
            fits = [fit for fit in (self.fits.fit(Reading(), False, terms + group)
                                    for group in self.effects if group[0] not in terms)
                    if fit is not None]
            if fits:
                amended = min([amended, *fits], key=lambda fit: fit.misfit)
                terms = amended.terms
        if other.far_better_than(amended, *_WITH_EFFECTS):
            return True
        most = (2 * len(written.places[0]) - 8) * 2 // 3
        terms = self.physical
        for group in self.effects:
            terms += group if len(terms + group) <= most else ()
        fits = [self.fits.fit(Reading(), False, terms), self.fits.fit(other.reading, True, terms)]
        return None not in fits and fits[1].far_better_than(fits[0], *_WITH_EFFECTS)

    def _explain(self, written, far):
        """Refuse a run that does not fit as written; return if it fits but with too few rows."""
        fits = self.fits.best([Reading(), *self._single(), *double_readings(
            self.rows.held, self.mount, self.rows.lst is not None)])
        fits = _alike([fit for fit in fits
                       if _FITS[0] < fit.rms_arcsec < _FITS[1] and fit.explains()])
        if fits or not far or written is None or written.rms_arcsec > ABSURD:
            self._refuse(written, fits)

    def _refuse(self, written, fits):
        left = 'do not fit' if written is None else f'leave {_size(written.rms_arcsec)}'
        kinds = list(dict.fromkeys(fit.reading.kind for fit in fits))
        what = ', or '.join(_WRONG[kind] for kind in kinds) \
            or 'catalogue and encoders do not belong together'
        used, read = self.rows.rows_used, self.rows.rows_read
        text = f'{self.rows.where}{what}: {used} of {read} rows can be used as written, and {left}'
        fitting = '; '.join(f'{fit.text} ({_size(fit.rms_arcsec)})' for fit in fits)
        if len(fits) > 1:
            text += f'. These readings fit equally well: {fitting}'
        elif fits:
            text += f'. Read otherwise they fit: {fitting}'
        else:
            text += '. No other reading that was tried fits'
        advice = 'look at the columns and at the rows' if not fits else fits[0].reading.advice \
            if len(kinds) == 1 else 'set right which of them it is'
        raise MistakenColumns(
            f'{text}. Nothing was concluded; {advice}',
            [{'reading': fit.text, 'rms_arcsec': fit.rms_arcsec} for fit in fits], read, used)


def _alike(fits):
    """The best fit and those indistinguishable from it, with the fewest mistakes only."""
    best = _likeliest(fits)
    one = _likeliest([fit for fit in fits if fit.reading.mistakes < 2])
    if one is not None and not best.far_better_than(one, _BETTER, _LIKELIER):
        best = one
    near = [fit for fit in fits if fit.as_good_as(best, _ALIKE, _AS_LIKELY)]
    fewest = min((fit.reading.mistakes for fit in near), default=0)
    return [fit for fit in near if fit.reading.mistakes == fewest]


def _likeliest(fits):
    best = fits[0] if fits else None
    for fit in fits:
        best = fit if fit.better_than(best)[1] > 0.0 else best
    return best


def _sizes(fit):
    """Sizes of the zero and of the tilt, degrees."""
    return tuple(size / DEG for size in fit.sizes)


def _size(arcsec):
    return f'{arcsec:.1f} arcsec' if arcsec < 3600.0 else f'{arcsec / 3600.0:.1f} deg'
