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

"""External check: fit on half of the stars, test on the others (paper 000)."""

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.context import Context
from pointing_model.rms import rms_arcsec
from pointing_model.runs.run import PointingRun
from pointing_model.zero import NO_ZERO, active_zero, is_for_zero

from ..rows import by_power_on
from .diagnosis.observations import run_labels, sequence_of
from .harmonic_fit import Recipe
from .term_fit import fit_terms


def split_half(run, seed=0):
    """Choose half of the rows, with the same distribution over the sky as all.

    Within each night (column ``run``, if present) the stars are sorted into elevation bands of
    equal number, and by azimuth within a band; one of each pair of neighbours is taken at random.
    Rows of one star within minutes are taken together: they share its errors.

    Parameters
    ----------
    run : PointingRun
    seed : int

    Returns
    -------
    ndarray of bool, shape (n,)
        The rows to fit; the others are the check. Odd stars go to either half at random.

    Raises
    ------
    ValueError
        Fewer than two rows.
    """
    n = len(run)
    if n < 2:
        raise ValueError(f'{n} observations cannot be split in halves; observe more')
    rng = np.random.default_rng(seed)
    night, star = np.asarray(run.get('run', 0.0)), _stars(run)
    used, first = np.zeros(n, bool), star == np.arange(n)
    odd = rng.integers(2)  # alternates, so that odd nights do not all favour one half
    for number in np.unique(night):
        rows = np.flatnonzero((night == number) & first)
        bands = max(1, round(np.sqrt(len(rows) / 4.0)))
        order = rows[np.argsort(run['el'][rows], kind='stable')]
        az = np.mod(run['az'], 2.0 * np.pi)
        # every band but the last has an even number, so that no pair straddles two
        size = 2 * int(np.ceil(len(rows) / bands / 2.0))
        sequence = np.concatenate([
            band[np.argsort(az[band], kind='stable')]
            for band in (order[i:i + size] for i in range(0, len(order), size))])
        pairs = len(sequence) // 2
        coin = rng.integers(2, size=pairs)
        used[sequence[2 * np.arange(pairs) + coin]] = True
        if len(sequence) % 2:
            used[sequence[-1]] = bool(odd)
            odd = 1 - odd
    return used[star]


def _stars(run):
    """For each row, the first of the rows of its star within minutes."""
    return sequence_of(Context.from_run(run), run_labels([run])[1]).group


def external_check(run, *, seed=0, encoder='enc', zero=NO_ZERO, **options):
    """Fit each half of a run and test it on the other: every row is held out once.

    Parameters
    ----------
    run : PointingRun
    seed : int
        Seed of `split_half`.
    encoder : {'enc', 'abs'}
    zero : PowerOnZero or Zeros
        Zero of the encoder, for all rows.
    options
        Options of `fit_terms`.

    Returns
    -------
    Rms
        arcsec on the sky, including rows that a fit would reject.

    Raises
    ------
    ValueError
        A half has too few rows for the fit.
    """
    used = split_half(run, seed)
    left = np.empty((2, len(run)))
    for half in (used, ~used):
        fitted = fit_terms(run.select(half), encoder=encoder, zero=zero, **options)
        left[:, ~half] = fitted.model.residuals(run.select(~half), encoder=encoder,
                                                zero=fitted.zeros)
    return rms_arcsec(*left)


def checked_by_halves(run, result, names, **options):
    """`external_check` of a fit, on the rows that it used; None if they are too few.

    Parameters
    ----------
    run : PointingRun
    result : FitResult
        Fit of terms to `run`.
    names : sequence of str
        The terms.
    **options
        Options of the fit, for `external_check`.
    """
    used = run.select(result.weights > 0.0)
    if len(np.unique(_stars(used))) < 4 * len(names):
        return None
    if options.get('run_zeros') and np.unique(used['run'], return_counts=True)[1].min() < 2:
        return None  # a run has its own zero and only one row: nothing to test
    return external_check(used, names=names, **options)


def rms_of(model, run, zero):
    """RMS of a model's residuals on a run, dict: ``x``, ``y``, ``radial``, arcsec."""
    return rms_arcsec(*model.residuals(run, zero=zero))._asdict()


def power_on_check(rows, reference, first, measured, change, notes, other=None):
    """The paper's check: coefficients of one power-on tested on stars of the next.

    Parameters
    ----------
    rows : PointingRun
    reference : PointingModel or None
        Model of an earlier night; if given, it is tested on all stars, before and after Polaris.
    first : Zeros
        Zero of each power-on from its exposures alone; empty without any.
    measured : Zeros
        MeasuredZero of the power-ons with such exposures.
    change : callable
        ``change(rows, before, after, model)`` gives the change of the zero, a MeasuredZero.
    notes : list of str
        Gets a line where a power-on has too few stars.
    other : (str, callable), optional
        Another kind of model: its name, such as ``harmonics``, and ``fit(rows, recipe)``, which
        gives a FitResult.

    Returns
    -------
    list of dict
        ``of`` (the kind of model), ``fitted`` and ``tried`` (power-ons fitted and tested; None:
        the earlier night, tonight), ``by`` (how the zero was set), ``renewed`` (whether that zero
        or the old one is used), and the RMS, see `rms_of`.
    """
    stars = rows.select(~is_for_zero(rows))
    if not first:
        return []
    if reference is not None:
        return [{'of': 'model', 'fitted': None, 'tried': None, 'by': ways(measured.values()),
                 'renewed': renewed, **rms_of(reference, stars, zero)}
                for renewed, zero in ((False, active_zero(reference)), (True, first))]
    kinds = [('model', lambda part, zero: fit_terms(part, zero=zero).model)]
    if other is not None:
        kinds.append((other[0], lambda part, zero: other[1](
            part, Recipe(zero, run_zeros=False)).model))
    out, parts = [], by_power_on(rows)
    numbers = [n for n in np.unique(stars['run']) if int(n) in measured]
    for before, after in zip(numbers, numbers[1:]):
        out += _from_to(parts[before], parts[after], before, after, first[before],
                        ways([measured[int(after)]]), change, kinds, notes)
    return out


def _from_to(then, later, before, after, old, way, change, kinds, notes):
    """Checks of models of one power-on on the stars of another."""
    out = []
    both, stars = PointingRun.concatenate([then, later]), later.select(~is_for_zero(later))
    for kind, fit in kinds:
        try:
            model = fit(then, old)
        except ValueError as err:
            notes.append(f'external check: {err}')
            continue
        new = old.plus(*change(both, before, after, model).angles)
        out += [{'of': kind, 'fitted': int(before), 'tried': int(after), 'by': way,
                 'renewed': renewed, **rms_of(model, stars, zero)}
                for renewed, zero in ((False, old), (True, new))]
    return out


def ways(zeros):
    """How some MeasuredZero were set, in words: ``Polaris``, ``stars``."""
    return ' or '.join(dict.fromkeys(zero.by.partition(' (')[0] for zero in zeros))


#: The four numbers of each curve in paper 000 (azimuth, elevation), in the keys of gps.json.
PAPER = {
    'before': {'az_mean_arcsec': 13.99, 'az_std_arcsec': 11.33,
               'el_mean_arcsec': 11.50, 'el_std_arcsec': 4.81},
    'after': {'az_mean_arcsec': 5.94, 'az_std_arcsec': 2.04,
              'el_mean_arcsec': -3.49, 'el_std_arcsec': 2.63},
}


def tracking_errors(model, run, zero=NO_ZERO):
    """Tracked minus computed place of a satellite, as in the paper's curves.

    Parameters
    ----------
    model : PointingModel
        The model active during the track.
    run : PointingRun
        Exposures of the satellite, with the encoder angles at which it is centred.
    zero : PowerOnZero or Zeros
        Zero of the encoders.

    Returns
    -------
    dict of str to list
        ``time`` (UTC s), ``el_deg``, ``az_arcsec`` (encoder angle, not times cos E),
        ``el_arcsec``; rows with a NaN are omitted.
    """
    x, y = model.residuals(run, zero=zero)
    good = np.isfinite(x) & np.isfinite(y)
    columns = {'time': run['time'], 'el_deg': run['el'] / DEG,
               'az_arcsec': x / np.cos(run['el']) / ARCSEC, 'el_arcsec': y / ARCSEC}
    return {name: values[good].tolist() for name, values in columns.items()}


def tracking_statistics(errors):
    """Mean and standard deviation of tracking errors.

    Parameters
    ----------
    errors : dict
        From `tracking_errors`.

    Returns
    -------
    dict
        ``az_mean_arcsec``, ``az_std_arcsec`` (encoder angle, our reading of the paper),
        ``az_sky_...`` (times cos(elevation)), ``el_...`` and ``n``.

    Raises
    ------
    ValueError
        Fewer than two exposures.
    """
    az, el = np.array(errors['az_arcsec']), np.array(errors['el_arcsec'])
    if len(az) < 2:
        raise ValueError(f'{len(az)} exposures of the satellite: two at least are needed for a '
                         'mean and a scatter')
    sky = az * np.cos(np.array(errors['el_deg']) * DEG)
    out = {'n': len(az)}
    for name, values in (('az', az), ('az_sky', sky), ('el', el)):
        out[f'{name}_mean_arcsec'] = float(np.mean(values))
        out[f'{name}_std_arcsec'] = float(np.std(values, ddof=1))
    return out


def gps_statistics(tracks):
    """Content of gps.json: our numbers before and after the zero calibration, and the paper's.

    Parameters
    ----------
    tracks : dict
        ``before`` and ``after`` from `tracking_errors`.

    Returns
    -------
    dict
        ``before``, ``after``: see `tracking_statistics`; ``paper``: `PAPER`.
    """
    return {**{part: tracking_statistics(tracks[part]) for part in ('before', 'after')},
            'paper': PAPER}
