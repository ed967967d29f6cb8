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

import numpy as np
import pytest

from msg_tools.units import ARCSEC
from pointing_model.rms import Rms, rms, rms_arcsec


def test_of_values_and_of_vectors():
    assert rms([3.0, -3.0]) == 3.0
    assert rms([3.0, 0.0], [4.0, 0.0]) == pytest.approx(5.0 / 2**0.5)
    assert np.isnan(rms([])) and np.isnan(rms([], []))


def test_on_the_sky_in_arcsec():
    x, y = np.array([3.0, np.nan, 3.0]) * ARCSEC, np.array([4.0, 1.0, -4.0]) * ARCSEC
    assert rms_arcsec(x, y) == pytest.approx(Rms(3.0, 4.0, 5.0, 2))
    assert rms_arcsec(x, y).radial == pytest.approx(rms(x[::2], y[::2]) / ARCSEC)
    nothing = rms_arcsec(x[1:2], y[1:2])
    assert nothing.n == 0 and np.isnan(nothing[:3]).all()
