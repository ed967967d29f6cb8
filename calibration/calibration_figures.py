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

"""Results of a calibration as numbers to plot: terms, zero, errors, residuals."""

import re

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.effects.base import readable
from pointing_model.rms import rms_arcsec

from .rows import is_for_zero

_NO_WORD = re.compile(r'\W+')


def calibration_figures(model, zero, report=None, tracked=None, left=None):
    """The published results as numbers, in groups of at most fifteen.

    Parameters
    ----------
    model : PointingModel or None
    zero : PowerOnZero or None
    report : dict, optional
        Report of the last fit.
    tracked : dict, optional
        Document of an adaptive model (mode track).
    left : dict, optional
        Residuals of the stars from `model`, see `residual_table`.

    Returns
    -------
    dict of str to dict of str to float
        ``term/IA`` and ``effect/NAME/COEFFICIENT``: ``value_arcsec``, ``sigma_arcsec``; ``zero``;
        ``rms/STEP/used`` and ``held_out`` of each step of the report, ``rms/active_model`` of the
        active model; ``fit``; ``expected_error`` of the model; ``tracking``. Unknown values are
        omitted.
    """
    groups = {}
    if model is not None:
        expected = model.provenance.get('expected') or {}
        groups['expected_error'] = {key: expected.get(key) for key in (
            'rms_arcsec', 'low_arcsec', 'high_arcsec')}
        for (name, value), sigma in zip(model.terms.items(), model.sigmas):
            groups[f'term/{name}'] = _value(value, sigma)
        for one in model.effects:
            for name, value, sigma in zip(one.effect.coefficient_names, one.coefficients,
                                          one.sigma):
                groups[f'effect/{_NO_WORD.sub("_", readable(one.effect.name))}/{name}'] = _value(
                    value, sigma)
    if zero is not None:
        sigma = zero.sigma if zero.covariance is not None else (np.nan, np.nan)
        groups['zero'] = {
            'first_axis_arcsec': zero.az / ARCSEC, 'second_axis_arcsec': zero.el / ARCSEC,
            'first_axis_sigma_arcsec': sigma[0] / ARCSEC,
            'second_axis_sigma_arcsec': sigma[1] / ARCSEC, 'power_on': zero.run}
    if report:
        groups |= _of_report(report)
    if left:
        groups |= _of_residuals(left)
    if tracked:
        groups['tracking'] = {'stars': tracked['stars'], **{
            f'expected_error_{when.replace(" ", "_")}_arcsec': value
            for when, value in tracked['expected_arcsec'].items()}}
    known = {name: {key: float(value) for key, value in rows.items()
                    if value is not None and np.isfinite(value)} for name, rows in groups.items()}
    return {name: rows for name, rows in known.items() if rows}


def expected_figures(expected):
    """Predicted change of the zero of a power-on, as a group like those of `calibration_figures`.

    Parameters
    ----------
    expected : dict
        For each axis ``change_arcsec`` and ``sigma_arcsec``, None where unknown.

    Returns
    -------
    dict of str to dict of str to float
        ``expected_change``, with the keys of ``zero``.
    """
    rows = {f'{name}_axis{end}_arcsec': expected[axis][key]
            for name, axis in (('first', 'azimuth'), ('second', 'elevation'))
            for end, key in (('', 'change_arcsec'), ('_sigma', 'sigma_arcsec'))}
    return {'expected_change': {key: value for key, value in rows.items() if value is not None}}


def _value(value, sigma):
    return {'value_arcsec': value / ARCSEC, 'sigma_arcsec': sigma / ARCSEC}


def _of_report(report):
    groups = {}
    for step in report.get('steps') or ():
        for rows in ('used', 'held_out'):
            if of := step.get(rows):
                groups[f'rms/{_NO_WORD.sub("_", step["step"])}/{rows}'] = _rms_of(of)
    x, y = report.get('noise_arcsec') or (None, None)
    groups['fit'] = {'stars': report.get('stars'), 'rejected': report.get('rejected'),
                     'condition': report.get('condition'), 'noise_x_arcsec': x,
                     'noise_y_arcsec': y}
    return groups


def _of_residuals(left):
    """RMS of the stars that may be fitted, and of the held-out (blind) ones."""
    x, y = left['residual_right'], left['residual_up']
    blind = np.asarray(left.get('check', np.zeros(len(x)))) == 1.0
    return {f'rms/active_model/{name}': _rms_of(rms_arcsec(x[rows], y[rows])._asdict())
            for name, rows in (('used', ~blind), ('check', blind)) if rows.any()}


def _rms_of(found):
    return {'rows': found['n'], **{f'{axis}_arcsec': found[axis] for axis in ('x', 'y', 'radial')}}


def residual_table(active, rows, site=None):
    """Residuals of the stars of a night from the active model.

    Parameters
    ----------
    active : ModelWithZeros
    rows : PointingRun
        All rows of the night.
    site : dict, optional
        ``latitude``, ``longitude``, rad.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        ``time`` (UTC s), ``azimuth`` and ``elevation`` of the star (the mount's own angles, rad),
        ``residual_right`` and ``residual_up`` (encoder - model on the sky, rad: along the first
        axis times the cosine of the second, and along the second), ``check``, ``power_on``.
        Columns that the rows lack are omitted.
    """
    x, y = active.residuals(rows, site)
    columns = {'time': rows.get('time'), 'azimuth': rows['az'], 'elevation': rows['el'],
               'residual_right': x, 'residual_up': y, 'check': rows.get('check'),
               'power_on': rows['run']}
    stars = ~is_for_zero(rows)
    return {name: np.asarray(values, float)[stars] for name, values in columns.items()
            if values is not None}
