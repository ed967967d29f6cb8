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

"""What a driver tells of its mount at one moment."""

from typing import NamedTuple

import numpy as np


class Tick(NamedTuple):
    """What the driver sent at one moment.

    Attributes
    ----------
    stamp : int
        ns since 1970, as it came.
    axes : ndarray, shape (2,)
        As the driver counts them, rad.
    place : ndarray, shape (2,), or None
        Right ascension and declination of date at which it looks, rad; None where it did not
        come with the axes: a driver sends it as it changes.
    tracking : bool
        Whether the driver says that it has arrived.
    """

    stamp: int
    axes: np.ndarray
    place: np.ndarray | None
    tracking: bool
