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

"""Typical orbit errors, for files that do not state them."""

import numpy as np

#: error of a coordinate, m: of an orbit fitted to data; of predictions: upper limit of the orbit's
#: radius (low satellites, then high ones), error on the first day, and growth per day. Predictions
#: for one satellite by several providers differ by 40 to 420 m.
FITTED = 0.1
PREDICTED = ((8.4e6, 60.0, 120.0), (np.inf, 20.0, 20.0))
#: error of a coordinate from two-line elements, m: lower limit of the revolutions per day, error at
#: the epoch of the elements, and growth per day
ELEMENTS = ((11.25, 700.0, 1000.0), (-np.inf, 400.0, 100.0))


def usual_sigma(places, tai, predicted, issued=None):
    """Typical 1-sigma of a coordinate at each position.

    Parameters
    ----------
    places : ndarray, shape (n, 3)
        ITRF, m.
    tai : ndarray, shape (n,)
        Seconds since 1970-01-01.
    predicted : bool
    issued : float, optional
        TAI from which the error of a prediction grows; by default its first epoch.

    Returns
    -------
    ndarray, shape (n,)
        m.
    """
    if not predicted:
        return np.full(len(tai), FITTED)
    radius = float(np.median(np.linalg.norm(places, axis=1)))
    first, growth = next(one[1:] for one in PREDICTED if radius < one[0])
    return first + growth * np.maximum(tai - (tai[0] if issued is None else issued), 0.0) / 86400.0
