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

"""Two-line elements: checks, files, and the orbit through a leap second."""

import numpy as np
import pytest

from pointing_model.sky.elements import GPS_26690, load_elements, parse_elements

GPS = parse_elements(GPS_26690)
START = 1379721600.0  # 2013-09-21
ISS = ('1 25544U 98067A   13264.51000000  .00002182  00000-0  45000-4 0  9991',
       '2 25544  51.6480 100.0000 0003000  80.0000 280.0000 15.50000000849993')


def _with_checksum(line):
    from sgp4.io import compute_checksum
    return line[:68] + str(compute_checksum(line[:68] + '0'))


def test_elements_of_the_paper():
    assert GPS.number == 26690
    assert GPS.epoch == pytest.approx(START + 0.32975019 * 86400.0, abs=1e-3)
    position, velocity = GPS.state(np.array([GPS.epoch]))
    assert 26.1e6 < np.linalg.norm(position) < 27.0e6
    assert 3.8e3 < np.linalg.norm(velocity) < 4.0e3


def test_elements_from_a_file_with_names(tmp_path):
    path = tmp_path / 'two.tle'
    path.write_text('\n'.join(['', 'GPS', *GPS_26690, '']))
    assert load_elements(path) == GPS
    iss = [_with_checksum(line) for line in ISS]
    path.write_text('\n'.join(['ISS', *iss, '', 'GPS', *GPS_26690, '']))
    with pytest.raises(ValueError, match=r'two\.tle: 2 sets of elements, .* 25544, 26690'):
        load_elements(path)


@pytest.mark.parametrize(('lines', 'what'), [
    ([], 'a line that begins'),
    ([GPS_26690[0]], 'line 2 should begin'),
    ([GPS_26690[0], GPS_26690[1][:-1]], 'line 2 has 68 characters'),
    ([GPS_26690[0], GPS_26690[1].replace('53.1031', '53.1032')], 'line 2 has checksum 9'),
    ([GPS_26690[0], _with_checksum(GPS_26690[1].replace('26690', '26691'))], 'of 26691'),
    ([_with_checksum(GPS_26690[0].replace('.32975019', '.3x975019')), GPS_26690[1]],
     'line 1, columns 21 to 32'),
    ([GPS_26690[0], _with_checksum(GPS_26690[1].replace(' 2.00567355', ' 0.00000000'))],
     'no orbit'),
])
def test_damaged_elements_are_refused_in_one_line(lines, what):
    with pytest.raises(ValueError, match=what) as error:
        parse_elements(lines)
    assert '\n' not in str(error.value)


def test_decay_is_reported():
    drag = _with_checksum(ISS[0].replace(' 45000-4', ' 45000-1'))
    falling = parse_elements([drag, _with_checksum(ISS[1])])
    with pytest.raises(ValueError, match='satellite 25544: .* days from the epoch') as error:
        falling.state(np.array([falling.epoch + 86400.0 * 300]))
    assert '\n' not in str(error.value)


def test_orbit_runs_through_a_leap_second():
    """POSIX time gives the second 2015-06-30 23:59:60 the number of the one after it."""
    midnight = 1435708800.0
    before, velocity = GPS.state(midnight - 0.5)
    after, _ = GPS.state(midnight + 0.5)
    assert np.linalg.norm(after - before) == pytest.approx(2 * np.linalg.norm(velocity), rel=1e-3)


def test_elements_of_another_theory_are_refused():
    typed = [_with_checksum(GPS_26690[0][:62] + '4' + GPS_26690[0][63:]), GPS_26690[1]]
    with pytest.raises(ValueError, match='line 1, column 63: elements of type 4, not SGP4'):
        parse_elements(typed)
