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

"""The fit of a night's model to its rows, and the report of the fit."""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.runs.run import PointingRun
from pointing_model.zero import NO_ZERO, is_for_zero
from pointing_model.zero_drift import Following

from .analysis.diagnosis.mistaken_columns import check_columns
from .analysis.diagnosis.residual_patterns import ResidualRows, jump_findings
from .analysis.encoders.zero_following import zero_following
from .analysis.external_check import power_on_check, split_half, ways
from .analysis.fit_result import FitResult
from .analysis.harmonic_fit import Recipe, fit_chosen
from .analysis.holdout_comparison import held_out_steps
from .analysis.zero.power_on_zeros import zero_change, zero_changes
from .report.night_document import fit_report, labelled_checks, labelled_steps
from .report.wording import wording
from .rows import for_fitting, without_zeros


@dataclass
class NightFit:
    """A fit of the rows of a night.

    Attributes
    ----------
    observed, rows : PointingRun
        Rows available to fits: as observed, and as fitted (corrected for drift of the counts).
    follows : Following
        Zeros that follow the absolute encoder, for that correction.
    terms : FitResult
        The terms, and their zero of each power-on.
    chosen : FitResult
        The harmonics if requested, else `terms`.
    harmonics : dict or None
        Their entry in the report.
    misfits : int
        Rows that are outliers of the harmonics but not of the terms.
    notes : list of str
    """

    observed: PointingRun
    rows: PointingRun
    follows: Following
    terms: FitResult
    chosen: FitResult
    harmonics: dict | None
    misfits: int
    notes: list

    @property
    def stars(self):
        """Its rows without the exposures for zeros."""
        return self.rows.select(~is_for_zero(self.rows))


def first_zeros(zeros, rows):
    """Zero of each power-on from its exposures; without any, that of the power-on before."""
    return zeros.carried(map(int, np.unique(rows['run'])), first=NO_ZERO)


def recipe_of(zeros, rows):
    """`Recipe` with the first power-on's zero from its exposures; later zeros are fitted to it."""
    return Recipe(first_zeros(zeros, rows)[rows['run'].min()])


def fit_terms_of(zeros, rows):
    """Fit the terms, and their zero of each power-on; a FitResult."""
    check_columns(rows.select(~is_for_zero(rows)))
    return recipe_of(zeros, rows).terms(rows)


def fit_night(observations, zeros, harmonics, seed):
    """Fit the terms, and the harmonics if requested.

    The terms and the change of the zero from power-on to power-on are fitted together, to stars
    and exposures for the zero: the exposures determine most of the change, the stars the rest.

    Parameters
    ----------
    observations : PointingRun
        All observations of the night.
    zeros : Zeros
        From the exposures for a zero alone.
    harmonics : HarmonicChoice
    seed : int
        Random seed for the choice of held-out stars.

    Returns
    -------
    NightFit

    Raises
    ------
    ValueError
        Too few stars.
    """
    observed = for_fitting(observations)
    follows = zero_following(observed)
    rows = follows.corrected(observed)
    terms = fit_terms_of(zeros, rows)
    jumps = jump_findings(ResidualRows.from_fit(rows, terms), terms.model.terms)
    out = NightFit(observed, rows, follows, terms, terms, None, 0, list(map(wording, jumps)))
    if not harmonics:
        return out
    out.chosen, out.harmonics, findings = fit_chosen(
        rows, harmonics, recipe_of(zeros, rows), terms, seed)
    out.misfits = int(np.count_nonzero(out.chosen.weights[terms.weights > 0.0] == 0.0))
    if out.misfits:
        out.notes.append(f'{out.misfits} rows are outliers to the harmonics, and not to the terms: '
                         'how wrong they are on fresh stars is not said')
    out.notes += map(wording, findings)
    return out


def report_of(night, zeros, reference, harmonics, seed, notes):
    """Report of a fit, with the errors of each kind of model on held-out stars.

    Parameters
    ----------
    night : NightFit
    zeros, harmonics, seed
        The arguments of its `fit_night`.
    reference : PointingModel or None
        Model of an earlier night.
    notes : list of str
        Notes from before the fit.

    Returns
    -------
    dict
        See `report.night_document`; JSON-ready.
    """
    rows, published, notes = night.rows, None, [*notes, *night.notes]
    if night.harmonics:
        degree = night.harmonics['degree']
        published = harmonics.label(degree), lambda rows, recipe: recipe.fit(
            rows, harmonics, degree)
    first = first_zeros(zeros, rows)
    return {
        **fit_report(rows, night.chosen, zeros, zero_changes(
            night.observed, sorted(zeros), night.chosen.model), bool(night.harmonics), notes),
        'steps': labelled_steps(held_out_steps(
            rows, lambda part: recipe_of(zeros, part), split_half(night.stars, seed), reference,
            first, ways(zeros.values()), notes, published)),
        'external_check': labelled_checks(power_on_check(
            rows, reference, first if zeros else {}, zeros, zero_change, notes,
            published and ('harmonics', published[1]))),
        'notes': notes,
        **({'harmonics': night.harmonics} if night.harmonics else {}),
    }


def expected_error(night, zeros, harmonics):
    """Expected error on new stars, as `Diagnosis.expected`, or None.

    If the newest power-on has no exposures for its zero, the variance of that zero is added.

    Parameters
    ----------
    night : NightFit
    zeros, harmonics
        The arguments of its `fit_night`.
    """
    from .analysis.diagnosis.expected_error import expected_error_of_terms
    stars, newest = night.stars, night.chosen.zeros.newest
    if night.misfits or not len(stars):
        return None
    expected = expected_error_of_terms(without_zeros(stars, night.chosen.zeros), harmonics.base(
        night.harmonics and night.harmonics['degree']))
    if expected is None or newest.run in zeros or not np.isfinite(newest.sigma).all():
        return expected
    more = float(np.mean(np.cos(stars['el'])**2) * newest.sigma[0]**2
                 + newest.sigma[1]**2) / ARCSEC**2
    # the squared error exceeds 3 times this variance in 1 of 20 cases if both axes are as
    # uncertain, in 1 of 12 if only one is
    return {**expected, 'rms_arcsec': float(np.sqrt(expected['rms_arcsec']**2 + more)),
            'high_arcsec': float(np.sqrt(expected['high_arcsec']**2 + 3.0 * more))}
