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

"""Nothing is proposed for the day."""

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.analysis.diagnosis.discriminating_star import Points
from calibration.analysis.diagnosis.next_observations import _grid, _matters
from calibration.analysis.diagnosis.observation_places import DARK, dark_hours, next_night, utc_of
from calibration.report.observation_wording import place_words
from msg_tools.units import DEG
from pointing_model.context import Context
from pointing_model.sky.places import sun_place
from pointing_model.sky.site import Site

DAWN = 1_768_519_800.0  # 2026-01-15T23:30, an hour before sunrise at 34.3 N, 109 E
HOURS = 0.25, 2.0, 6.0


def rows(last, latitude=34.3, longitude=109.0, utc=True):
    time = last - np.linspace(4.0, 0.0, 40) * 3600.0
    az, el = np.linspace(0.0, 6.0, 40), np.linspace(0.3, 1.3, 40)
    context = Context(az, el, {'time': time}, latitude * DEG,
                      None if longitude is None else longitude * DEG)
    context.time_is_utc = utc
    return context


def sun(context, hours):
    site = Site(context.latitude, context.longitude, 0.0)
    return sun_place(float(context.get('time').max()) + 3600.0 * hours, site)[1]


def test_hours_of_the_day_are_left_out():
    night, dawn = rows(DAWN - 7.0 * 3600.0), rows(DAWN)
    assert dark_hours(night, HOURS) == [0.25, 2.0, 6.0]
    assert dark_hours(rows(DAWN - 3.0 * 3600.0), HOURS) == [0.25, 2.0]
    assert dark_hours(dawn, HOURS) == []
    later = next_night(dawn, HOURS)
    assert later[0] == pytest.approx(11.0) and len(later) == 4
    assert all(sun(dawn, h) < DARK for h in later) and sun(dawn, later[0] - 0.5) > DARK
    assert utc_of(dawn, later[0]) == '2026-01-16 10:30'


@pytest.mark.parametrize('context', [
    rows(DAWN, longitude=None), rows(DAWN, utc=False), rows(DAWN + 6.0 * 3600.0)])
def test_where_the_sun_is_not_known_or_no_matter_all_hours_are_left(context):
    assert dark_hours(context, HOURS) == list(HOURS)


def test_in_the_summer_of_the_north_the_darkest_hour_is_proposed():
    context = rows(1_782_002_400.0, latitude=64.0, longitude=20.0)
    (hour,) = next_night(context, HOURS)
    grid = [sun(context, h) for h in np.arange(0.25, 48.0, 0.25)]
    assert sun(context, hour) == min(grid)


@pytest.mark.parametrize('before, tomorrow', [(7.0, False), (3.0, False), (0.0, True)])
def test_no_proposal_lies_in_daylight(before, tomorrow):
    known = rows(DAWN - 3600.0 * before)
    context, later, _, next_one, _ = _grid(known)
    assert next_one is tomorrow
    assert max(sun(known, h) for h in np.unique(later)) < DARK
    assert len(context) % (8 * len(np.unique(later))) == 0
    points = Points(SimpleNamespace(context=known), {'time'}, hours=8.0, only_later=True)
    assert max(sun(known, h) for h in np.unique(points.later)) < DARK


def test_one_hour_that_is_left_is_said():
    assert _matters(np.ones(8), 0, 1)[2] and not _matters(np.ones(16), 0, 2)[2]
    text = place_words({'az_deg': 10.0, 'el_deg': 50.0, 'after_hours': 11.25, 'next_night': True,
                        'utc': '2026-01-16 10:45'})
    assert text.endswith('11.25 h after the last row (next night, 2026-01-16 10:45 UTC)')
