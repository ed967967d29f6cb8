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

"""The result of a solver."""

from typing import NamedTuple

import numpy as np

from .undetermined_terms import Undetermined


class Estimate(NamedTuple):
    """The result of a solver: k coefficients from n rows."""

    coefficients: np.ndarray
    covariance: np.ndarray  # (k, k)
    freedom: np.ndarray  # (k,), degrees of freedom of each standard error
    scatter: tuple  # standard deviation of each axis, in the unit of the residual, or in sigmas
    residual: np.ndarray  # (axes * n,), x of all rows, then y; NaN where there is none
    weights: np.ndarray  # (n,), of the rows: 0 to 1
    rank: int
    robust: bool = False  # whether rows were down-weighted or, if few, tested and rejected
    undetermined: Undetermined | None = None
    singular_values: np.ndarray | None = None  # of the first-order design, descending
    log_likelihood: float | None = None  # restricted, but for a constant
    design: object = None  # (k, axes * n), last design, of the coefficients not held at zero
    scatter_freedom: tuple = ()  # degrees of freedom of the scatter of each axis; one: of both
    #: scatter of each axis over the given sigmas, 1 if not significantly different; the sigmas were
    #: multiplied by ratios above 1
    ratios: tuple = (1.0, 1.0)
