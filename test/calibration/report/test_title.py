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

"""Of what a page is: the title, and the angles where a telescope looks through the pole."""

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.report.driver_labels import driver_of
from calibration.report.provenance import about, axes_note
from msg_tools.units import DEG, wrap
from pointing_model.context import Context
from pointing_model.mounts import parse_mount


def test_angles_beyond_the_pole_are_in_one_piece_and_explained():
    star, through = np.linspace(-30.0, 80.0, 60) * DEG, np.arange(60) % 2 == 1
    hour = np.linspace(-80.0, 80.0, 60) * DEG
    dec = np.where(through, np.pi - star, star)
    mount = parse_mount('german', 0.5)
    context = Context(wrap(hour + np.pi * through), wrap(dec), {}, mount=mount)
    found = driver_of(context, 'declination').values
    assert found == pytest.approx(dec / DEG) and found.max() > 180.0
    assert 'In 30 of 60 rows' in axes_note(context) and '12 h from that of' in axes_note(context)
    one = Context(hour, star, {}, mount=mount)
    assert driver_of(one, 'hour_angle').values == pytest.approx(hour / DEG)
    assert axes_note(one) == '' and axes_note(Context(hour, star, {})) == ''


def test_the_title_says_of_which_telescope_when_and_where():
    obs = SimpleNamespace(run=SimpleNamespace(meta={
        'caption': 'Toy 1 m', 'site': {'latitude': -0.5, 'longitude': 1.2}}),
        context=Context(np.zeros(2), np.zeros(2), {'time': np.array([1.7e9, 1.7e9 + 2e5])}))
    assert about(obs, ['run.txt']) == 'Toy 1 m, 2023-11-14 to 2023-11-17, 28.65° S 68.75° E'
    obs.run.meta.clear()
    assert about(obs, ['run.txt']).startswith('run, 2023-11-14')
