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

"""RMS of held-out stars, from no correction to the full model."""

from contextlib import suppress

import numpy as np

from pointing_model.harmonics import INTERPRETATIONS
from pointing_model.model import PointingModel
from pointing_model.zero import active_zero, is_for_zero

from .external_check import rms_of
from .term_fit import fit_harmonics

#: kinds of models
RAW, REFERENCE, ZEROED, TERMS = 'raw', 'reference', 'zeroed', 'terms'
HARMONICS, BOTH, PUBLISHED = 'harmonics', 'terms and harmonics', 'published'


def held_out_steps(rows, recipe_of, used, reference, first, way, notes, published=None):
    """RMS of each kind of model on the fitted stars, and on the held-out ones.

    Parameters
    ----------
    rows : PointingRun
        Stars, and exposures for zeros, which all fits use.
    recipe_of : callable
        ``recipe_of(rows)`` gives the `harmonic_fit.Recipe` for them.
    used : ndarray of bool
        Mask of the stars to fit.
    reference : PointingModel or None
        Model of an earlier night.
    first : Zeros
        Zero of each power-on from its exposures alone.
    way : str
        How they were set (`external_check.ways`); '' if none was.
    notes : list of str
        Gets a line if there are too few stars for the request.
    published : (str, callable), optional
        Published harmonics: their label, and ``fit(rows, recipe)``.

    Returns
    -------
    list of dict
        ``kind``, ``of`` (how zeros were set, the reading of the harmonics, or a label), and the
        RMS ``used`` and ``held_out``, see `external_check.rms_of`.
    """
    is_star = ~is_for_zero(rows)
    stars = rows.select(is_star)
    halves = {'used': stars.select(used), 'held_out': stars.select(~used)}
    seen = ~is_star  # exposures for the zero, and the stars used
    seen[np.flatnonzero(is_star)[used]] = True
    base = reference or PointingModel({}, mount=rows.mount)
    steps = []

    def compare(kind, model, zero, of=''):
        steps.append({'kind': kind, 'of': of, **{
            name: rms_of(model, half, zero) for name, half in halves.items()}})

    compare(RAW if reference is None else REFERENCE, base, active_zero(reference))
    if way:
        compare(ZEROED, base, first, way)
    # harmonics of azimuth and elevation, only for comparison: no note if there are too few stars
    for reading in INTERPRETATIONS if rows.mount.vertical else ():
        with suppress(ValueError):
            compare(HARMONICS, fit_harmonics(halves['used'], reading, zero=first).model, first,
                  reading)
    try:
        part = rows.select(seen)
        fitted = recipe_of(part).terms(part)
        model, zeros = fitted.model, fitted.zeros
        compare(TERMS, model, zeros)
    except ValueError as err:
        notes.append(f'held-out check: {err}')
    else:
        if rows.mount.vertical:
            with suppress(ValueError):
                compare(BOTH, fit_harmonics(halves['used'], held=model, zero=zeros).model, zeros)
    if published is not None:
        label, fit = published
        try:
            fitted = fit(part, recipe_of(part))
            compare(PUBLISHED, fitted.model, fitted.zeros, label)
        except ValueError as err:
            notes.append(f'{label}: {err}')
    return steps
