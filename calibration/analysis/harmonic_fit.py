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

"""The harmonics of paper 000 as a published model: choice of reading and degree, and its errors.

Alone, as in the paper, or fitted to the residuals of the physical terms. The report compares the
requested choice with all others by cross-validation.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pointing_model.harmonics import DEGREE, INTERPRETATIONS, count_of
from pointing_model.model_document import coefficient_row
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.rms import rms_arcsec
from pointing_model.zero import PowerOnZero, is_for_zero

from .finding import Finding
from .term_fit import RCOND_HARMONICS, fit_harmonics, fit_terms

NONE = 'none'
#: values of the parameter and the option `harmonics`
CHOICES = (NONE, *INTERPRETATIONS)
READ_AS = {'zenith': 'E read as zenith distance', 'printed': 'E read as printed'}
FOLDS = 10
BY_PARAMETER = 'parameter'  # or by cross-validation
#: parameter of a calibration -> field of `HarmonicChoice`
_PARAMETERS = {'harmonics': 'reading', 'harmonics_alone': 'alone', 'harmonics_degree': 'degree',
               'harmonics_rcond': 'rcond'}
#: part of the RMS by which another choice must be better to be reported
_NAMED = 0.01


@dataclass(frozen=True)
class HarmonicChoice:
    """Which harmonics a model has.

    Parameters
    ----------
    reading : {'none', 'zenith', 'printed'}
        Meaning of the paper's E.
    alone : bool
        Without the physical terms, as in the paper.
    degree : int
        1 to 4; 0: selected by cross-validation.
    rcond : float
        See `fit.fit_harmonics`: directions that the stars do not determine are dropped; a tiny
        value keeps all.

    Raises
    ------
    ValueError
        Unknown reading or degree; `alone` or `degree` without harmonics.
    """

    reading: str = NONE
    alone: bool = False
    degree: int = 0
    rcond: float = RCOND_HARMONICS

    def __post_init__(self):
        if self.reading not in CHOICES:
            raise ValueError(f'unknown harmonics {self.reading!r}; take {", ".join(CHOICES)}')
        if self.degree not in range(DEGREE + 1):
            raise ValueError(f'harmonics of degree {self.degree}; take 1 to {DEGREE}, or 0: by '
                             'cross-validation')
        if self.reading == NONE and (self.alone or self.degree):
            raise ValueError('a degree of harmonics, or harmonics alone, but no harmonics; take '
                             f'{" or ".join(INTERPRETATIONS)} for how to read their E')

    def __bool__(self):
        return self.reading != NONE

    def parameters(self):
        """The choice as parameters of a calibration; empty for none."""
        return {} if not self else {name: getattr(self, of) for name, of in _PARAMETERS.items()}

    def base(self, degree=None):
        """Name of the model as the base of a diagnosis; by default with the highest degree."""
        if not self:
            return 'physical'
        series = f'sh{degree or self.degree or DEGREE}' + 'p' * (self.reading == 'printed')
        return series if self.alone else f'physical+{series}'

    def label(self, degree, terms=PHYSICAL):
        """The choice in words; `terms`: names of the terms."""
        series = f'{count_of(degree)} harmonics, {READ_AS[self.reading]}'
        return f'{series}, alone' if self.alone else f'{len(terms)} terms, then {series}'


def choice_of(parameters):
    """`HarmonicChoice` from the parameters of a calibration.

    Parameters
    ----------
    parameters : dict
        ``harmonics``, ``harmonics_alone``, ``harmonics_degree`` and ``harmonics_rcond``, or some
        of them.
    """
    return HarmonicChoice(**{
        of: parameters[name] for name, of in _PARAMETERS.items() if name in parameters})


def choice_of_report(report):
    """`HarmonicChoice` from the report of a calibration; `report` None: no harmonics."""
    document = (report or {}).get('harmonics')
    if not document:
        return HarmonicChoice()
    degree = document['degree'] if document['degree_by'] == BY_PARAMETER else 0
    return HarmonicChoice(document['harmonics'], document['alone'], degree, document['rcond'])


class Recipe(NamedTuple):
    """Options of a fit.

    Attributes
    ----------
    first : PowerOnZero
        Zero of the first run; harmonics alone cannot fit a constant zero of the azimuth.
    run_zeros : bool
        Fit the zero of each run relative to that of the first.
    names : tuple of str, optional
        Terms; by default the physical ones of the mount.
    encoder : {'enc', 'abs'}
    robust : bool
    """

    first: PowerOnZero
    run_zeros: bool = True
    names: tuple | None = None
    encoder: str = 'enc'
    robust: bool = True

    def terms(self, rows):
        """Fit the terms alone; a FitResult. See `fit_terms` for errors."""
        return fit_terms(rows, self.names, zero=self.first, run_zeros=self.run_zeros,
                         encoder=self.encoder, robust=self.robust)

    def fit(self, rows, choice, degree, terms=None):
        """Fit the harmonics; a FitResult.

        Parameters
        ----------
        rows : PointingRun
        choice : HarmonicChoice
        degree : int
        terms : FitResult, optional
            Fit of the terms to the same rows, if known.

        Raises
        ------
        ValueError
            Too few rows for the degree.
        """
        how = {'degree': degree, 'encoder': self.encoder, 'robust': self.robust,
               'rcond': choice.rcond}
        try:
            if choice.alone:
                return fit_harmonics(rows, choice.reading, zero=self.first,
                                     run_zeros=self.run_zeros, **how)
            terms = terms or self.terms(rows)
            return fit_harmonics(rows, choice.reading, after=terms, zero=terms.zeros, **how)
        except ValueError as err:
            raise ValueError(f'harmonics of degree {degree}: {err}, or take a lower degree') \
                from None

    def left(self, fitted, rows):
        """Residuals of rows, shape (2, n), rad; a run without a zero has that of the run before."""
        zeros = fitted.zeros
        if self.run_zeros:
            zeros = zeros.carried(np.unique(rows['run']))
        return np.array(fitted.model.residuals(rows, encoder=self.encoder, zero=zeros))


def every_choice(rcond=RCOND_HARMONICS):
    """Yield all choices: terms alone (None, 0), each reading alone or after terms, every degree."""
    yield None, 0
    for alone in (True, False):
        for reading in INTERPRETATIONS:
            for degree in range(1, DEGREE + 1):
                yield HarmonicChoice(reading, alone, degree, rcond), degree


def cross_validated(rows, recipe, seed=0, rcond=RCOND_HARMONICS, folds=FOLDS):
    """Cross-validated RMS of every choice of model.

    All rows of a star are held out together; exposures for a zero, of Polaris or of stars, are
    never held out. Outliers of all choices (zero weight in each fit to all rows) are not counted:
    they add the same error to all.

    Parameters
    ----------
    rows : PointingRun
    recipe : Recipe
    seed : int
        Random seed of the folds.
    rcond : float
        See `fit.fit_harmonics`.
    folds : int

    Returns
    -------
    dict
        JSON-ready: ``folds``, ``stars`` (rows counted), ``outliers``, and ``choices``, for each
        choice that the stars determine: ``harmonics``, ``alone``, ``degree``, ``label``, and RMS
        ``x``, ``y``, ``radial``, arcsec.
    """
    star = rows['star'] if 'star' in rows else np.arange(len(rows))
    terms_of = recipe.names or rows.mount.names.physical
    test_rows = np.flatnonzero(~is_for_zero(rows) if 'star' in rows else star >= 0)
    names, member = np.unique(star[test_rows], return_inverse=True)
    folds = min(folds, len(names))
    fold = (np.random.default_rng(seed).permutation(len(names)) % max(folds, 1))[member]
    kinds = list(every_choice(rcond))
    left = {kind: np.full((2, len(test_rows)), np.nan) for kind in kinds}
    failed, outlier = set(), np.ones(len(rows), bool)
    for k in (*range(folds), None):  # None: all rows, for the outliers
        out = np.zeros(len(rows), bool) if k is None else np.isin(
            np.arange(len(rows)), test_rows[fold == k])
        seen, terms = rows.select(~out), None
        for kind in kinds:
            choice, degree = kind
            if kind in failed or (k is None and degree not in (0, DEGREE)):
                continue
            try:
                if choice is None:
                    fitted = terms = recipe.terms(seen)
                elif terms is None and not choice.alone:
                    raise ValueError('no terms')
                else:
                    fitted = recipe.fit(seen, choice, degree, terms)
            except (ValueError, np.linalg.LinAlgError):
                failed.add(kind)
                continue
            if k is None:
                outlier &= fitted.weights == 0.0
            else:
                left[kind][:, fold == k] = recipe.left(fitted, rows.select(out))
    counts = ~outlier[test_rows] & np.all(
        [np.isfinite(v).all(axis=0) for kind, v in left.items() if kind not in failed], axis=0)
    choices = []
    for kind in kinds:
        if kind not in failed and counts.any():
            choice, degree = kind
            rms = rms_arcsec(*left[kind][:, counts])
            choices.append({
                'harmonics': choice.reading if choice else NONE,
                'alone': bool(choice and choice.alone), 'degree': degree,
                'label': (choice.label(degree, terms_of) if choice
                          else f'{len(terms_of)} terms'),
                'x': rms.x, 'y': rms.y, 'radial': rms.radial})
    return {'folds': folds, 'stars': int(counts.sum()),
            'outliers': int(np.count_nonzero(outlier[test_rows])), 'choices': choices}


def fit_chosen(rows, choice, recipe, terms=None, seed=0):
    """Fit the requested harmonics, and cross-validate every choice.

    Parameters
    ----------
    rows : PointingRun
    choice : HarmonicChoice
        Not ``none``.
    recipe : Recipe
    terms : FitResult, optional
        Fit of the terms alone, if known.
    seed : int
        Random seed of the folds.

    Returns
    -------
    fitted : FitResult
    section : dict
        For a report: ``harmonics``, ``alone``, ``degree``, ``degree_by``, ``label``,
        ``coefficients`` (rows with ``name``, ``value_arcsec``, ``sigma_arcsec``), ``rcond``,
        ``rank``, ``condition``, ``rejected``, ``fitted`` (RMS of the rows with weight),
        ``cross_validation``.
    findings : list of Finding

    Raises
    ------
    ValueError
        Too few stars for the degree, or to choose one.
    """
    # fit first: fails early if the rows do not allow the degree
    fitted = choice.degree and recipe.fit(rows, choice, choice.degree, terms)
    tried = cross_validated(rows, recipe, seed, choice.rcond)
    own = {one['degree']: one for one in tried['choices']
           if (one['harmonics'], one['alone']) == (choice.reading, choice.alone)}
    degree = choice.degree
    if not degree:
        if not own:
            recipe.fit(rows, choice, 1, terms)  # raises the specific reason, if there is one
            raise ValueError('too few stars to choose the degree of the harmonics by '
                             'cross-validation; observe more or give a degree, 1 to 4')
        degree = min(own, key=lambda d: (own[d]['radial'], d))
        fitted = recipe.fit(rows, choice, degree, terms)
    series = fitted.model.harmonics
    label = choice.label(degree, recipe.names or rows.mount.names.physical)
    findings = [*fitted.open_directions, *fitted.sigma_findings(rows.mount.names.axes)]
    best = min(tried['choices'], key=lambda one: one['radial'], default=None)
    if degree not in own:
        findings.append(Finding('not cross-validated', evidence={'model': label}))
    elif best['radial'] < (1.0 - _NAMED) * own[degree]['radial']:
        findings.append(Finding('better model', before=own[degree]['radial'],
                                after=best['radial'],
                                evidence={'model': label, 'best': best['label']}))
    return fitted, {
        'harmonics': choice.reading, 'alone': choice.alone, 'degree': degree,
        'degree_by': BY_PARAMETER if choice.degree else 'cross-validation', 'label': label,
        'coefficients': [
            coefficient_row(name, *both, name in fitted.model.undetermined_harmonics)
            for name, both in series.coefficients.items()],
        'fitted': fitted.rms_arcsec(rejected=False)._asdict(),
        'rcond': choice.rcond, 'rank': fitted.rank, 'condition': fitted.condition,
        'rejected': len(fitted.rejected), 'cross_validation': tried,
    }, findings


def rows_of_terms(model):
    """Rows like those of `FitResult.term_rows`, of a PointingModel."""
    return [coefficient_row(name, value, float(sigma), not np.isfinite(sigma))
            for (name, value), sigma in zip(model.terms.items(), model.sigmas)]
