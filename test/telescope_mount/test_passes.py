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

"""The command `passes`."""

import json

import numpy as np
from kepler_orbit import sp3

from pointing_model.runs.formats.csv import iso_utc

#: of the ISS, 2008-09-20 (Vallado et al. 2006, AIAA 2006-6753, use the form)
TLE = '''1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
'''
PLACE = ('--latitude', '34.3', '--longitude', '109')


def test_passes_of_a_file_are_listed(ended, tmp_path):
    (tmp_path / 'a.sp3').write_text(sp3(120.0 * np.arange(720), velocities=False))
    code, out, err = ended('passes', '--orbit', tmp_path / 'a.sp3', *PLACE, '--day-too', '--json',
                           tmp_path / 'p.json')
    assert (code, err) == (0, '') and 'L52' in out and 'keyhole' in out
    found = json.loads((tmp_path / 'p.json').read_text())
    assert len(found) >= 3 and found == sorted(found, key=lambda one: one['start'])
    assert all(one['top_el_deg'] > 20.0 and one['lost_s'] == 0.0 for one in found)
    seen = ended('passes', '--orbit', tmp_path / 'a.sp3', *PLACE, '--hours', '1')[1]
    assert 'no sunlit pass at night in these hours' in seen or 'L52' in seen


def test_passes_ask_for_the_site(refused, tmp_path):
    (tmp_path / 'a.sp3').write_text(sp3(120.0 * np.arange(20)))
    assert 'give --latitude and --longitude' in refused('passes', '--orbit', tmp_path / 'a.sp3')


def test_a_pass_that_ends_as_the_hours_begin_is_one(ended, tmp_path):
    (tmp_path / 'a.sp3').write_text(sp3(120.0 * np.arange(720), velocities=False))
    common = ('passes', '--orbit', tmp_path / 'a.sp3', *PLACE, '--day-too', '--json',
              tmp_path / 'p.json', '--overwrite')
    ended(*common)
    end = json.loads((tmp_path / 'p.json').read_text())[0]['end']
    for before in (3.0, 0.5):
        code, out, err = ended(*common, '--date', iso_utc(np.array([end - before]))[0],
                               '--hours', '0.1')
        assert (code, err) == (0, '') and 'satellite' in out


def test_old_elements_are_said(ended, tmp_path):
    (tmp_path / 'iss.tle').write_text(TLE)
    out = ended('passes', '--orbit', tmp_path / 'iss.tle', *PLACE, '--day-too', '--date',
                '2009-09-20', '--hours', '24')[1]
    assert 'elements of 25544 are 365.0 days old' in ' '.join(out.split())


def test_hours_that_an_orbit_does_not_have_are_said(ended, refused, tmp_path):
    (tmp_path / 'a.sp3').write_text(sp3(120.0 * np.arange(720), velocities=False))
    common = ('passes', '--orbit', tmp_path / 'a.sp3', *PLACE, '--day-too')
    assert 'orbit data from 2017-12-03 00:00 UTC to 2017-12-03 23:58 UTC, asked for ' in refused(
        *common, '--date', '2026-11-30')
    out = ended(*common, '--hours', '23')[1]
    assert 'orbit data from' not in out
    code, out, _ = ended(*common, '--hours', '72')
    assert code == 0 and 'note: L52: orbit data from 2017-12-03 00:00 UTC to 2017-12-03' in out
