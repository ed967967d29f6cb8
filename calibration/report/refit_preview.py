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

"""What a page needs to refit its terms without rows that a reader excludes: numbers in base64."""

from base64 import b64encode

import numpy as np

from calibration.estimation.robust import LOSS
from msg_tools.units import ARCSEC

from .drawing import MAX_POINTED
from .page_parts import RefitData
from .provenance import command_line

#: steps of the largest number: those of a refit, and of what is only drawn
_STEPS = {4: 2**31 - 1, 2: 2**15 - 1}
#: distances at which the page knows the weight of a row: between them it is good to 1e-7
_DISTANCES = 2049


def preview(data, fits, rows, command, file=''):
    """The data of the refit; None where there is nothing to refit.

    Parameters
    ----------
    data : Residuals
    fits : list of (str, Linearisation or None, list of str)
        ``before`` or ``after``, its fit (None: offsets as they are), and the names of the
        coefficients in the page's table of terms.
    rows : sequence of int
        Number of each row, as ``--exclude`` counts them.
    command : str
        ``fit`` or ``diagnose``.
    file : str
        That was read, where no command line says so.

    Returns
    -------
    RefitData or None
    """
    if not len(data) or len(data) > MAX_POINTED or not any(fit for _, fit, _ in fits):
        return None
    columns, models = [], []
    for when, fit, names in fits:
        models.append({'when': when, **_model(fit, names, data.of(when), columns)})
    angle, flip = _turns(data)
    # what a reader excludes is of the file: of a page of several files there is no such number
    return RefitData({
        'keys': ' '.join(data.keys), 'rows': [int(row) for row in rows],
        'used': ''.join('01'[bool(used)] for used in data.used),
        'angle': _scaled(angle, 2), 'flip': flip, 'models': models,
        'columns': [[_scaled(half) for half in column] for column in columns],
        'command': _excluding(command, file)})


def _model(fit, names, residual, columns):
    """One fit; `columns` gets those that are not in it yet."""
    if fit is None:
        return {'names': [], 'residual': [_scaled(v, 2) for v in np.nan_to_num(residual)]}
    of = []
    for column in fit.columns:
        same = (i for i, one in enumerate(columns) if np.array_equal(one, column))
        of.append(next(same, len(columns)))
        if of[-1] == len(columns):
            columns.append(column)
    # what is subtracted from the offsets, in arcsec, beside columns without a unit
    return {'names': names, 'values': (fit.coefficients / ARCSEC).tolist(), 'of': of,
            'residual': [_scaled(v) for v in fit.residual / ARCSEC],
            'weights': _weights(fit),
            'given': fit.given, 'consistency': fit.consistency, 'inflation': fit.inflation,
            'loss': {'scales': [s / ARCSEC for s in fit.scales], **_loss()} if fit.scales else None}


def _loss():
    """Weights by the distance, up to where they are zero."""
    reach, weights = LOSS.table(_DISTANCES)
    return {'reach': reach, 'weights': _packed(weights, '<f4')}


def _weights(fit):
    """Of x and of y, once where they are the same; in 1 / arcsec^2 where sigmas were given."""
    both = fit.weights * (ARCSEC**2 if fit.given else 1.0)
    return [_packed(one, '<f4') for one in (both[:1] if np.array_equal(*both) else both)]


def _scaled(values, size=4):
    """A step, whole steps of it in so many bytes each, and how many; 0 of nothing but zeros."""
    most = float(np.abs(values).max(initial=0.0))
    if not most:
        return 0
    step = most / _STEPS[size]
    return [step, _packed(np.rint(np.asarray(values) / step), f'<i{size}'), size]


def _packed(values, kind):
    return b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()


def _turns(data):
    """Angle of each row's x on the map, rad, and whether y is to the other side of it."""
    sine, cosine = np.sin(data.az), np.cos(data.az)
    own = np.broadcast_to(np.eye(2)[:, :, None], (2, 2, len(data))) \
        if data.turned is None else np.asarray(data.turned)
    # of x and y the parts toward azimuth and elevation, then right and down on the map
    right, down = (np.array([row[0] * a + row[1] * b for row in own.transpose(1, 0, 2)])
                   for a, b in ((cosine, -sine), (sine, cosine)))
    flip = np.nanmedian(np.nan_to_num(right[0] * down[1] - down[0] * right[1], nan=1.0))
    return np.nan_to_num(np.arctan2(down[0], right[0])), 1 if flip > 0.0 else -1


def _excluding(command, file):
    """The command that excludes rows for good, up to their numbers."""
    line = command_line()
    words = line.split()
    if command not in words:
        line = f'telescope-mount {command} {file or "RUN"}'
    elif '--overwrite' not in words and {'--report', '--json', '--save'} & set(words):
        line += ' --overwrite'
    return f'{line} --exclude '
