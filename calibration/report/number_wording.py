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

"""Numbers as texts."""

import numpy as np


def number(value, digits=2, sign=False):
    """A number as text; a dash for None and NaN."""
    if value is None or not np.isfinite(value):
        return '–'
    out = f'{value:{"+" if sign else ""}.{digits}f}'
    if not out.strip('+-0.'):  # zero has no sign
        out = out.lstrip('+-')
    return out.replace('-', '−')


def value_and_error(value, sigma):
    """A value and its standard error as texts, to two significant digits of the error.

    Parameters
    ----------
    value : float
    sigma : float or None
        None: the value has five significant digits.

    Returns
    -------
    tuple of str
    """
    if sigma is None or not np.isfinite(sigma) or not sigma > 0.0:
        size = abs(value) if np.isfinite(value) else 0.0
        return number(value, _digits(size, 5) if size else 2, True), number(sigma, 3)
    digits = _digits(sigma, 2)
    return number(value, digits, True), number(sigma, digits)


def _digits(size, significant):
    """Decimal places that give a number of significant digits, at most 6."""
    return int(np.clip(significant - 1 - np.floor(np.log10(float(f'{size:.{significant}g}'))),
                       0, 6))


def probability(p):
    """A p-value as text."""
    if p is None or not np.isfinite(p):
        return '–'
    return f'{p:.1g}' if p < 0.01 else f'{p:.2f}'


def group_name(value):
    """Name of a power-on, night or run, for users."""
    return f'{value:g}' if isinstance(value, (float, np.floating)) else str(value)
