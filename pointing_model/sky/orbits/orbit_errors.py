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

"""How far off an orbit is where its file does not say."""

import numpy as np

#: m, of a coordinate where a file does not say: an orbit that was fitted to data; a prediction of a
#: low satellite and of a high one on its first day, and how it grows in a day. Predictions of one
#: satellite by several providers differ by 40 to 420 m.
FITTED = 0.1
PREDICTED = ((8.4e6, 60.0, 120.0), (np.inf, 20.0, 20.0))
#: m, of a coordinate by two-line elements: revolutions a day above which an orbit is such, its
#: error at the epoch of the elements, and how it grows in a day
ELEMENTS = ((11.25, 700.0, 1000.0), (-np.inf, 400.0, 100.0))


def usual_sigma(places, tai, predicted, issued=None):
    """Of a coordinate of each position.

    Parameters
    ----------
    places : ndarray, shape (n, 3)
        ITRF, m.
    tai : ndarray, shape (n,)
        Seconds since 1970-01-01.
    predicted : bool
    issued : float, optional
        TAI from which a prediction ages; by default its first.

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
