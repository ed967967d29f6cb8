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

"""Rows of a diagnosis: counts of rows used and excluded, worst rows, repeated stars."""

from dataclasses import dataclass, replace
from pathlib import PurePath

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import rms
from pointing_model.runs.columns.row_checks import LOG_OF_AIR
from pointing_model.runs.copies import SAME

from ..finding import Finding
from .reading_fits import MOST_LEFT_OUT

#: exclusion reasons of rows that the author of the file had withdrawn, or that are not observations
_TAKEN_BACK = ('commented out', 'rejected by', LOG_OF_AIR)
#: keys of the entries ``before`` and ``after`` of a result
RMS_KEYS = ('rms_arcsec', 'rms_x_arcsec', 'rms_y_arcsec', 'cv_rms_arcsec', 'cv_rms_x_arcsec',
            'cv_rms_y_arcsec', 'cv_spread', 'holdout_rms_arcsec')
_PLACES_NAMED = 4  # largest number of repeated stars that are listed


@dataclass
class RowCounts:
    """Row counts of one diagnosis or fit.

    Attributes
    ----------
    read : int
        Rows in the files, without those rejected in the file itself.
    used : int
        Rows with non-zero weight in the fit.
    copies : int
        Duplicate rows.
    outliers : list of dict
        ``row`` (the line in the file), ``source`` (if there are several files), ``star`` (its
        number or name, for a fit), ``x_arcsec``, ``y_arcsec``: on-sky residual; largest first.
    rms_with : float or None
        Radial RMS in arcsec including the outliers.
    word : {'row', 'line'}
        Whether row numbers are lines of a file, or rows of a run without one.
    taken_back : int
        Rows withdrawn by the author of the file; not included in `read`.
    not_drawn : int
        Rows of a long run that were not sampled, see `Observations.thinned`.
    """

    read: int
    used: int
    copies: int
    outliers: list
    rms_with: float | None
    word: str = 'row'
    taken_back: int = 0
    not_drawn: int = 0

    @property
    def too_few(self):
        """Whether more than a third of the rows is excluded."""
        offered = self.read - self.copies - self.not_drawn
        return offered - self.used > MOST_LEFT_OUT * offered

    @property
    def lost(self):
        """Number of rows read but not used."""
        return self.read - self.used - self.not_drawn

    @property
    def refusal(self):
        """Finding: no effect is claimed because too few rows are used."""
        return Finding('too few rows', self.used, unit='rows', evidence={'read': self.read})

    @property
    def detection_factor(self):
        """Ratio of the detection limit to that with all rows."""
        return (1.0 + self.not_drawn / max(self.used, 1)) ** 0.5

    def to_dict(self):
        """Keys of the JSON result."""
        return {'rows_read': self.read, 'rows_used': self.used, 'outliers': self.outliers,
                'rms_with_outliers_arcsec': self.rms_with, 'rows_are': self.word,
                'rows_taken_back': self.taken_back, 'rows_not_drawn': self.not_drawn,
                'detection_factor': self.detection_factor}


def diagnosis_row_counts(result):
    """Count the rows of a diagnosis.

    Parameters
    ----------
    result : Diagnosis

    Returns
    -------
    RowCounts
    """
    obs = result.observations
    sources = obs.sources if len(set(obs.sources)) > 1 else None
    counts = _row_counts(result.residual_after, result.weights, obs.excluded, obs.lines, sources,
                 word=row_word(obs.run))
    left = len(obs.whole) - len(obs) if obs.whole else 0
    return replace(counts, read=counts.read + left, not_drawn=left)


def fit_row_counts(run, result):
    """Count the rows of a fit.

    Parameters
    ----------
    run : PointingRun
    result : FitResult

    Returns
    -------
    RowCounts
    """
    usable = np.isfinite(result.residual_x)
    left = np.stack((result.residual_x, result.residual_y))[:, usable]
    return _row_counts(left, result.weights[usable],
                 [*run.meta.get('excluded', ()), *result.excluded], run.lines[usable],
                 stars=run['star'][usable] if 'star' in run else None, word=row_word(run))


def excluded_of_fit(run, result):
    """Rows excluded by the reader and by the fit: ``row`` (line in the file) and ``reason``."""
    return [*run.meta.get('excluded', ()),
            *({**one, 'row': run.lines[one['row']]} for one in result.excluded)]


def row_word(run):
    """Whether the row numbers of a run are lines of its file (``line``) or not (``row``)."""
    return 'row' if run.meta.get('lines') is None else 'line'


def _row_counts(left, weights, excluded, lines, sources=None, stars=None, word='row'):
    lost, copies = _lost(excluded)
    away = np.flatnonzero(~(weights > 0.0))
    away = away[np.argsort(-np.hypot(*left[:, away]), kind='stable')]
    outliers = [{'row': int(lines[i]),
                 **({} if sources is None else {'source': PurePath(str(sources[i])).name}),
                 **({} if stars is None else _named(stars[i])),
                 'x_arcsec': float(left[0, i]) / ARCSEC, 'y_arcsec': float(left[1, i]) / ARCSEC}
                for i in away]
    n = left.shape[1]
    return RowCounts(
        n + lost, n - len(away), copies, outliers,
        float(np.hypot(*(rms(r) for r in left))) / ARCSEC if outliers else None, word,
        len(excluded) - lost)


def _named(star):
    """Dictionary entry with the number or name of a star, if any."""
    if isinstance(star, str):
        return {'star': str(star)}
    return {'star': int(star)} if np.isfinite(star) else {}


def _lost(excluded):
    """Number of excluded rows, without withdrawn ones, and how many of them are copies."""
    reasons = [e['reason'] for e in excluded if not e['reason'].startswith(_TAKEN_BACK)]
    return len(reasons), sum(reason.startswith(SAME) for reason in reasons)


def reader_row_counts(run):
    """Count the rows of a run, with those that its reader excluded.

    Parameters
    ----------
    run : PointingRun

    Returns
    -------
    RowCounts
    """
    lost, copies = _lost(run.meta.get('excluded', ()))
    return RowCounts(len(run) + lost, len(run), copies, [], None, row_word(run),
                    len(run.meta.get('excluded', ())) - lost)


def count_rows(result):
    """Add row counts to a diagnosis; with more than a third of the rows excluded, refuse it.

    Parameters
    ----------
    result : Diagnosis

    Returns
    -------
    Diagnosis
        If refused, the verdict is ``refused`` and the model is that of the base.
    """
    counts = diagnosis_row_counts(result)
    if counts.too_few:
        result = replace(
            result, verdict='refused', effects=[], model=result.base_model,
            after=dict(result.before), residual_after=result.residual_before,
            next_observations=[], cv_contiguous={}, cautions=[counts.refusal], noise_memory=None,
            detectable=None, expected=None, no_star=[])
        counts = diagnosis_row_counts(result)
    return replace(result, counts=counts.to_dict())


def worst_rows(diagnosis):
    """The row with the largest residual among those with weight, before and after.

    Parameters
    ----------
    diagnosis : Diagnosis

    Returns
    -------
    dict or None
        ``before`` and ``after``: each with ``row``, ``source`` (if there are several files),
        ``az_deg``, ``el_deg`` (mount axes), ``before_arcsec`` and ``after_arcsec``. None if no
        effect was found.
    """
    used = np.flatnonzero(diagnosis.weights > 0.0)
    if not diagnosis.effects or not len(used):
        return None
    obs = diagnosis.observations
    sizes = {when: np.hypot(*getattr(diagnosis, f'residual_{when}')) / ARCSEC
             for when in ('before', 'after')}
    several = len(set(obs.sources)) > 1
    az, el = np.degrees(obs.run['az']), np.degrees(obs.run['el'])
    if obs.run.mount.vertical:
        az = np.mod(az, 360.0)
    return {when: {'row': int(obs.lines[i]), 'az_deg': float(az[i]), 'el_deg': float(el[i]),
                   **({'source': PurePath(str(obs.sources[i])).name} if several else {}),
                   **{f'{key}_arcsec': float(one[i]) for key, one in sizes.items()}}
            for when, size in sizes.items() for i in [used[np.argmax(size[used])]]}


def repeats(rows):
    """A Finding on stars measured repeatedly, with the RMS difference; empty if there are many.

    Parameters
    ----------
    rows : ResidualRows

    Returns
    -------
    list of Finding
    """
    group, left = rows.sequence.group, rows.residual
    pairs = [np.flatnonzero(group == g) for g, count in zip(*np.unique(
        group, return_counts=True)) if count > 1]
    if not 0 < len(pairs) <= _PLACES_NAMED:
        return []
    off = np.hstack([left[:, pair[1:]] - left[:, pair[:-1]] for pair in pairs])
    return [Finding('star measured again', float(np.hypot(*(rms(one) for one in off))) / ARCSEC,
                    evidence={'word': rows.word,
                              'rows': [[rows.lines[i] for i in pair] for pair in pairs]})]
