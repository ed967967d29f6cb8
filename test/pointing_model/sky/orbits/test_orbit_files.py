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

"""Orbits from files: every format gives the same orbit, and bad input one line."""

import gzip

import numpy as np
import pytest
from kepler_orbit import START, cpf, inertial, oem, sp3, terrestrial

from pointing_model.sky.earth import earth_orientation
from pointing_model.sky.elements import GPS_26690, parse_elements
from pointing_model.sky.orbits.orbit_files import Orbits

EPOCHS = 120.0 * np.arange(90)
#: between epochs, not at the ends
TIMES = np.linspace(1500.0, 9000.0, 41) + 0.25


def orbit(tmp_path, text, name=None, file='orbit.txt', **more):
    files = {file: text, **more}
    for one, content in files.items():
        (tmp_path / one).write_bytes(content if isinstance(content, bytes) else content.encode())
    found = Orbits([tmp_path / one for one in files])
    return found.orbit(name), found.notes


def off(found, seconds=TIMES):
    return np.linalg.norm(found.itrf(START + seconds) - terrestrial(seconds)[0], axis=1).max()


@pytest.mark.parametrize(('text', 'most'), [
    (sp3(EPOCHS), 0.003), (sp3(EPOCHS, end=False), 0.003),
    (sp3(EPOCHS, 'GPS', shift=18.0, velocities=False), 0.003),
    (sp3(EPOCHS, 'ccc', ' 18', 'a', velocities=False, frame='IGS00', shift=18.0), 0.003),
    (sp3(EPOCHS, 'TAI', version='d', shift=37.0), 0.003),
    (cpf(EPOCHS), 0.003), (cpf(EPOCHS, version=1, velocities=False), 0.003),
    (oem(EPOCHS), 0.001), (oem(EPOCHS, scale='TT', shift=69.184, by_day=True), 0.001),
], ids=lambda text: str(text)[:12])
def test_every_format_gives_the_same_orbit(tmp_path, text, most):
    assert off(orbit(tmp_path, text)[0]) < most


def test_velocities_help_where_epochs_are_few(tmp_path):
    few = 120.0 * np.arange(4) + 3000.0
    between = np.linspace(3000.0, 3360.0, 9)
    assert off(orbit(tmp_path, oem(few))[0], between) < 0.01
    assert off(orbit(tmp_path, sp3(few, velocities=False))[0], between) > 1.0


def test_inertial_frames_are_turned_into_that_of_the_earth(tmp_path):
    """EME2000 by ERFA's own chain, TEME as the elements are: both to the centimetre."""
    import erfa
    seconds, time = EPOCHS, START + EPOCHS
    earth, day = earth_orientation(time), 58090.0 + EPOCHS / 86400.0
    ut1 = day + (earth.dut1 / 86400.0)
    celestial = erfa.ufunc.c2t06a(2400000.5, day + 69.184 / 86400.0, 2400000.5, ut1, earth.xp,
                                  earth.yp)
    place, rate = inertial(seconds)
    found, _ = orbit(tmp_path, oem(seconds, 'EME2000', states=inertial))
    bias = erfa.bp00(2451545.0, 0.0)[0]
    expected = np.einsum('nij,nj->ni', celestial, place @ bias)
    assert np.abs(found.itrf(time[10:80]) - expected[10:80]).max() < 0.02
    satellite = parse_elements(GPS_26690)
    near = satellite.epoch + 60.0 * np.arange(20)

    def states(_):
        return satellite.state(near)
    text = oem(near - START, 'TEME', states=states)
    found, _ = orbit(tmp_path, text)
    between = near[:-1] + 20.0
    assert np.abs(found.itrf(between) - satellite.itrf(between)).max() < 0.05


def test_sigma_is_what_the_file_says_and_larger_at_its_ends(tmp_path):
    found, _ = orbit(tmp_path, sp3(EPOCHS, code=5))
    assert found.sigma(START + 5000.0) == pytest.approx(0.032, rel=0.02)
    long = 900.0 * np.arange(60)
    found, _ = orbit(tmp_path, sp3(long, code=1, velocities=False, axis=26.6e6))
    assert found.sigma(START + 450.0) > 4.0 * found.sigma(START + 25_200.0)
    assert orbit(tmp_path, oem(EPOCHS, sigma=7.0))[0].sigma(START + 5e3) == pytest.approx(7.0)
    found, _ = orbit(tmp_path, cpf(EPOCHS))
    assert 15.0 < found.sigma(START + 5000.0) < 30.0


def compressed(data):
    """As ``compress`` does, LZW: groups of eight codes of one width are filled up."""
    table, word, codes, width, bits = {bytes([i]): i for i in range(256)}, b'', [], 9, []
    count = 257
    for byte in [*(data[i:i + 1] for i in range(len(data))), None]:
        if byte is not None and word + byte in table:
            word += byte
            continue
        codes.append((table[word], width))
        if byte is not None and count < 1 << 16:
            table[word + byte] = count
            count += 1
            if count == (1 << width) + 1 and width < 16:
                codes += [(0, width)] * (-sum(w == width for _, w in codes) % 8)
                width += 1
        word = byte
    for code, wide in codes:
        bits += [code >> i & 1 for i in range(wide)]
    bits += [0] * (-len(bits) % 8)
    return b'\x1f\x9d\x90' + np.packbits(bits, bitorder='little').tobytes()


def test_what_is_compressed_is_read(tmp_path):
    text = sp3(EPOCHS).encode()
    assert off(orbit(tmp_path, compressed(text), file='a.sp3.Z')[0]) < 0.003
    assert off(orbit(tmp_path, gzip.compress(text), file='a.sp3.gz')[0]) < 0.003
    (tmp_path / 'cut.gz').write_bytes(gzip.compress(text)[:300])
    with pytest.raises(ValueError, match='cut or damaged'):
        Orbits([tmp_path / 'cut.gz'])


def test_two_daily_files_have_the_quarter_of_an_hour_between(tmp_path):
    first, second = 900.0 * np.arange(96), 900.0 * np.arange(96, 192)
    found, notes = orbit(tmp_path, sp3(first), file='a', b=sp3(second))
    midnight = np.linspace(85_600.0, 86_390.0, 9)
    assert off(found, midnight) < 0.05 and not notes
    with pytest.raises(ValueError, match='no position at 2017-12-02 23:00:00 UTC; the files cover '
                                         '2017-12-03 00:00:00 to 2017-12-04 23:45:00'):
        found.itrf(START - 3600.0)


def test_the_later_file_wins_and_a_jump_is_told(tmp_path):
    text = sp3(EPOCHS[40:])
    moved = '\n'.join(
        line[:4] + f'{float(line[4:18]) + 0.05:14.6f}' + line[18:] if line[:1] == 'P' else line
        for line in text.splitlines())
    found, notes = orbit(tmp_path, sp3(EPOCHS), file='a', b=moved)
    assert off(found, np.array([2000.0])) < 0.01
    assert off(found, np.array([7000.0])) == pytest.approx(50.0, abs=0.1)
    assert 'differ by 50.0 m RMS; the later one is taken' in notes[0]


def edited(text, line, change):
    rows = text.splitlines()
    rows[line - 1] = change(rows[line - 1])
    return '\n'.join(rows)


PLAIN = sp3(EPOCHS, velocities=False)


@pytest.mark.parametrize(('text', 'name', 'message'), [
    (PLAIN, 'G05', 'no satellite G05; there are L52'),
    (PLAIN.replace('%c L  cc UTC', '%c L  cc XYZ'), None,
     'orbit.txt, line 5: time scale XYZ is not known; known are UTC, GLO, TAI'),
    (PLAIN.replace('SLR08', 'J2000'), None, 'line 1: frame J2000 does not turn with the Earth'),
    (edited(PLAIN, 30, lambda row: row[:4] + '    4x12.3    ' + row[18:]), None,
     "line 30: '4x12.3' is no coordinate"),
    (edited(PLAIN, 31, lambda row: row.replace('2017 12', '2017 13')), None,
     'line 31: no date: 2017 13'),
    (edited(PLAIN, 31, lambda row: '*  2017 12  3  0  1  0.00000000'), None,
     'line 32: the epoch 2017-12-03 00:01:00 of L52 is not after the one before'),
    (oem(EPOCHS, frame='ICRF'), None,
     'line 8: frame ICRF is not read; known are ITRF, EME2000, TEME'),
    (oem(EPOCHS, scale='UT1'), None, 'line 9: time scale UT1 is not known'),
    (oem(EPOCHS).replace('EARTH', 'MOON'), None, 'positions relative to MOON'),
    (cpf(EPOCHS, frame=2), None, 'its frame is inertial, mean of J2000; give a prediction in the'),
    (edited(cpf(EPOCHS), 8, lambda row: row[:25]), None, 'line 8: a position of 3 numbers'),
    ('a,b\n1,2\n', None, 'is no orbit file; known: CPF, OMM, two-line elements, OEM, SP3'),
])
def test_bad_input_is_one_line(tmp_path, text, name, message):
    with pytest.raises(ValueError) as error:
        orbit(tmp_path, text, name)
    assert message in str(error.value) and '\n' not in str(error.value)


OMM = '''CENTER_NAME = EARTH
EPOCH = 2023-08-27T12:25:40.104192
MEAN_MOTION = 15.72125391
ECCENTRICITY = 0.0006703
INCLINATION = 51.6416
RA_OF_ASC_NODE = 247.4627
ARG_OF_PERICENTER = 130.5360
MEAN_ANOMALY = 325.0288
NORAD_CAT_ID = 25544
'''


def test_an_omm_of_another_theory_or_planet_is_refused(tmp_path):
    for theory in ('SGP4', 'SGP/SGP4'):
        more = f'MEAN_ELEMENT_THEORY = {theory}\nEPHEMERIS_TYPE = 0\n'
        assert orbit(tmp_path, OMM + more)[0].number == 25544
    for text, message in (
            (OMM + 'MEAN_ELEMENT_THEORY = DSST\n', 'of the theory DSST; give elements of SGP4'),
            (OMM + 'EPHEMERIS_TYPE = 4\n', 'of type 4'),
            (OMM.replace('= EARTH', '= MARS'), 'the elements of 25544 are about MARS')):
        with pytest.raises(ValueError, match=message):
            orbit(tmp_path, text)


def test_one_of_several_is_asked_for(tmp_path):
    both = oem(EPOCHS) + oem(EPOCHS).split('\n', 3)[3].replace('LAGEOS-2', 'LAGEOS-1')
    with pytest.raises(ValueError, match='2 satellites; name one with --object: LAGEOS-1'):
        orbit(tmp_path, both)
    assert orbit(tmp_path, both, '1992-070b')[0].name == 'LAGEOS-2'


def test_a_bad_or_a_missing_coordinate_is_told_and_left_out(tmp_path):
    def moved(row):
        return row[:4] + f'{float(row[4:18]) + 30.0:14.6f}' + row[18:]
    found, notes = orbit(tmp_path, edited(PLAIN, 12, moved))  # the second epoch
    assert '30 km' in notes[0] and off(found, np.array([100.0])) < 0.5
    found, notes = orbit(tmp_path, edited(PLAIN, 80, moved))
    assert '30 km off its neighbours, and left out' in notes[0]
    assert off(found) < 0.02
    none = f'{0.0:14.6f}' * 3
    found, notes = orbit(tmp_path, edited(PLAIN, 80, lambda row: row[:4] + none + row[46:]))
    assert notes == [f'{tmp_path}/orbit.txt: L52 has no position at 1 epochs, the first in line 80']
    assert off(found) < 0.02


def test_epochs_too_far_apart_for_the_orbit_are_told(tmp_path):
    coarse = 1800.0 * np.arange(48)
    found, notes = orbit(tmp_path, sp3(coarse, velocities=False))
    assert 'epochs of L52 are too far apart, 30 min, for its orbit' in notes[0]
    at = np.linspace(30_000.0, 50_000.0, 20)
    assert 0.3 < off(found, at) / (3.0**0.5 * found.sigma(START + at).max()) < 3.0
