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

"""Data with which a page refits its terms without rows that the user excludes; in base64."""

from base64 import b64encode

import numpy as np

from calibration.estimation.robust import LOSS
from msg_tools.units import ARCSEC

from .drawing import MAX_POINTED
from .page_parts import refit_data
from .provenance import command_line

#: bytes -> steps up to the largest number: 4 bytes for a refit, 2 for plots
_STEPS = {4: 2**31 - 1, 2: 2**15 - 1}
#: size of the table of robust weights by distance: interpolation is good to 1e-7
_DISTANCES = 2049


def preview(data, fits, rows, command, file=''):
    """The data of the refit; None if there is nothing to refit.

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
        Input file, for a command line that does not name it.

    Returns
    -------
    Markup or None
    """
    if not len(data) or len(data) > MAX_POINTED or not any(fit for _, fit, _ in fits):
        return None
    columns, models = [], []
    for when, fit, names in fits:
        models.append({'when': when, **_model(fit, names, data.of(when), columns)})
    angle, flip = _turns(data)
    # --exclude takes row numbers of one file: with several files they would be ambiguous
    return refit_data({
        'keys': ' '.join(data.keys), 'rows': [int(row) for row in rows],
        'used': ''.join('01'[bool(used)] for used in data.used),
        'angle': _scaled(angle, 2), 'flip': flip, 'models': models,
        'columns': [[_scaled(half) for half in column] for column in columns],
        'command': _excluding(command, file)})


def _model(fit, names, residual, columns):
    """Data of one fit; design columns not yet in `columns` are added to it."""
    if fit is None:
        return {'names': [], 'residual': [_scaled(v, 2) for v in np.nan_to_num(residual)]}
    of = []
    for column in fit.columns:
        same = (i for i, one in enumerate(columns) if np.array_equal(one, column))
        of.append(next(same, len(columns)))
        if of[-1] == len(columns):
            columns.append(column)
    # coefficients in arcsec; columns have no unit
    return {'names': names, 'values': (fit.coefficients / ARCSEC).tolist(), 'of': of,
            'residual': [_scaled(v) for v in fit.residual / ARCSEC],
            'weights': _weights(fit),
            'given': fit.given, 'consistency': fit.consistency, 'inflation': fit.inflation,
            'loss': {'scales': [s / ARCSEC for s in fit.scales], **_loss()} if fit.scales else None}


def _loss():
    """Table of robust weights by distance, up to where they are zero."""
    reach, weights = LOSS.table(_DISTANCES)
    return {'reach': reach, 'weights': _packed(weights, '<f4')}


def _weights(fit):
    """Weights of x and y, only once if equal; in 1 / arcsec^2 if sigmas were given."""
    both = fit.weights * (ARCSEC**2 if fit.given else 1.0)
    return [_packed(one, '<f4') for one in (both[:1] if np.array_equal(*both) else both)]


def _scaled(values, size=4):
    """Quantised values: step, integers of `size` bytes, and `size`; 0 if all values are zero."""
    most = float(np.abs(values).max(initial=0.0))
    if not most:
        return 0
    step = most / _STEPS[size]
    return [step, _packed(np.rint(np.asarray(values) / step), f'<i{size}'), size]


def _packed(values, kind):
    return b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()


def _turns(data):
    """Angle of each row's x on the map, rad, and the handedness (1 or -1) of x and y."""
    sine, cosine = np.sin(data.az), np.cos(data.az)
    own = np.broadcast_to(np.eye(2)[:, :, None], (2, 2, len(data))) \
        if data.turned is None else np.asarray(data.turned)
    # components of x and y toward azimuth and elevation, then right and down on the map
    right, down = (np.array([row[0] * a + row[1] * b for row in own.transpose(1, 0, 2)])
                   for a, b in ((cosine, -sine), (sine, cosine)))
    flip = np.nanmedian(np.nan_to_num(right[0] * down[1] - down[0] * right[1], nan=1.0))
    return np.nan_to_num(np.arctan2(down[0], right[0])), 1 if flip > 0.0 else -1


def _excluding(command, file):
    """The command that excludes rows permanently, up to the row numbers."""
    line = command_line()
    words = line.split()
    if command not in words:
        line = f'telescope-mount {command} {file or "RUN"}'
    elif '--overwrite' not in words and {'--report', '--json', '--save'} & set(words):
        line += ' --overwrite'
    return f'{line} --exclude '
