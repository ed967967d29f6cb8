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

"""The toy telescope of `examples/`, which the sample drivers talk to."""

import importlib.util
import time

import numpy as np
from places import ROOT

from msg_tools.units import DEG

RATES = np.array([0.4, -0.1])  # deg/s


def toy():
    spec = importlib.util.spec_from_file_location('toy', ROOT / 'examples' / 'toy_telescope.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_its_camera_measures_a_satellite_that_the_axes_follow(monkeypatch):
    module, began = toy(), time.time()

    class Light:

        def place(self, when, site, weather):
            return tuple(start + rate * (when - began) * DEG for start, rate in zip(
                (1.0, 0.8), RATES))
    monkeypatch.setattr(module, 'satellite_target', lambda text: Light())
    telescope = module.Telescope(satellite='L52 orbit.sp3')

    def steer():
        now = time.time()
        place = Light().place(now, None, None)
        angles = np.degrees(telescope._model.sky_to_encoder(*place))
        telescope.move(now, *angles, *RATES)
        return angles
    telescope._angles = steer()
    middle, right, up = telescope.expose(0.3)
    assert began < middle < time.time() and np.hypot(right, up) < 10.0
    telescope.stop()  # it leaves the field, or is blurred
    assert np.isnan(telescope.expose(0.3)[1:]).all()
