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

"""Whatever a file holds, `read_run` gives a sound run or one line of error."""

import warnings

import numpy as np
import pytest

from msg_tools.units import DEG
from pointing_model.runs.run_reader import read_run
from pointing_model.sky.site import Site

SEEDS = {
    'csv': 'time,star,run,az_deg,el_deg,az_enc_deg,el_enc_deg,az_abs_deg,el_abs_deg,'
           'sigma_az_arcsec,approach_az,humidity\n'
           '2021-08-21T04:36:01.5Z,"a, b",1,10,20,10.1,20.1,10,20,1,-1,0.5\n'
           '2021-08-21T04:37:01.5+02:00,c,1,350,40,350.2,40.2,350,40,1.5,1,\n'
           '# 2021-08-21T04:38:01.5Z,c,2,100,60,100.3,60.3,100,60,2,0,0.75\n'
           ',,2,200,70,200.3,70.3,200,70,2,0,0.75\n',
    'offsets': 'ra_deg;dec_deg;time;x_arcsec;y_arcsec;temperature_c\n'
               '283.8;43.9;1629520561;1;2;10\n10;20;1629536400;-1;2;11\n250;-5;1.6e9;1;2;9\n',
    'tpoint': '! South = 0\nTest run\n: ALTAZ\n: ROTL\n-30 14 26.4 2021 8 21 13.0 741 2608 0.75\n'
              '! 99 99 99 99 0\n 10.0 20.0 10.1 20.2 -5.0 ! one\n 350.0 40.0 350.1 40.2 -6.0\nEND\n'
              '1 2 3 4 5\n',
    'short': '8m altazimuth\nA\n-30.240667\n264.4 28.1 264.5 28.2\n259.6 29.8 259.7 29.9\n',
    'mmt': 'CAT: FK5-0711  18:55:20.1 +43:56:45.9 +0.2 +0.2  3.9  M3  J2000.0\n'
           'RAA:   77.3  347.2\nTAA:   77.3  -12.3\nABS_AA:   77.3  -12.3\nLST: 19:11:22.950\n'
           'CAT: FK5-0712  18:55:20.1 +43:56:45.9 +0.2 +0.2  4.9  M3  J2000.0\n'
           'RAA:   37.3  147.2\nTAA:   37.3  147.3\nABS_AA:   37.3  147.3\nLST: 19:14:22.950\n',
    'iram': '# id\tobject\tUTh(f2)\tTamb(f1)\tAZd(f0) ELd(f0)\tpnt.X(f1) pnt.Y(f1)\n'
            '2012-04-16.8\t1253\t23.50\t-8.1\t161 45\t2.9 -47.3\n'
            '#2012-04-16.9\t1253\t23.60\t-8.3\t100 50\t-9.0 -37.2\n'
            '2012-04-17.1\tW3\t0.25\t-8.2\t-76 46\t4.9 -43.3\n',
}
BITS = ['nan', 'inf', '-1e999', '1e308', '', ' ', ',', ';', '\t', '\n', '\r', '\x0c', '"', "'", '#',
        '!', ':', '-', '---', 'E', '\u2028', 'é', '１２', '1_0', '0x1', '9' * 400, 'time', 'run',
        'az_deg', 'x_arcsec', 'ra_deg', '2021-02-30', '24:61:61', '1969-12-31T23:59:59', 'END',
        ': ALTAZ', 'A', 'CAT:', '# id\tpnt.', '\ufeff', '1e5', '-5', '90.2', '(f1)', '.', '+', '0']
TURNS = 300
SITE = Site(31.7 * DEG, -110.9 * DEG, 2608.0)


def spoiled(rng, text):
    """`text` with a few random wounds."""
    for _ in range(rng.integers(1, 4)):
        i, j = np.sort(rng.integers(0, len(text) + 1, 2))
        j = min(j, i + int(rng.integers(0, 12)))
        kind = rng.integers(6)
        bit = BITS[rng.integers(len(BITS))]
        if kind == 0:
            text = text[:i] + bit + text[i:]
        elif kind == 1:
            text = text[:i] + bit + text[j:]
        elif kind == 2:
            text = text[:i] + text[j:]
        elif kind == 3:
            lines = text.split('\n')
            k, m = rng.integers(len(lines), size=2)
            lines[k] = lines[m]
            text = '\n'.join(lines)
        elif kind == 4:
            words = text.split(' ')
            words[rng.integers(len(words))] = bit
            text = ' '.join(words)
        else:
            text = text[:i] + chr(int(rng.integers(9, 0x250))) + text[i:]
    return text


@pytest.mark.parametrize('name', SEEDS)
def test_a_spoiled_file_gives_a_run_or_one_line(name, tmp_path):
    rng = np.random.default_rng(list(name.encode()))
    path = tmp_path / 'run.dat'
    read = refused = 0
    for turn in range(TURNS):
        text = spoiled(rng, SEEDS[name])
        data = text.encode('utf-8', 'replace')
        if turn % 10 == 0:
            data = bytes(rng.permutation(np.frombuffer(data, np.uint8).copy()))
        path.write_bytes(data)
        options = {'encoder': 'abs'} if turn % 7 == 0 else {'azimuth_origin': 'S'} \
            if turn % 5 == 0 else {}
        with warnings.catch_warnings():
            warnings.simplefilter('error')
            try:
                run = read_run(path, site=SITE, **options)
            except ValueError as error:
                message = str(error)
                assert message.startswith(str(path)), message
                assert message.isprintable() and len(message) < 2000, message
                refused += 1
                continue
        read += 1
        assert len(run) >= 1
        for column in ('az', 'el', 'az_enc', 'el_enc', 'approach_az', 'approach_el'):
            assert np.isfinite(run[column]).all()
        assert np.isin(run['approach_az'], (-1, 0, 1)).all()
        assert (run['el'] > -5.1 * DEG).all() and (run['el'] < 90.2 * DEG).all()
        for row in run.meta['excluded']:
            assert 1 <= row['row'] <= text.count('\n') + text.count('\r') + 1 and row['reason']
    assert read > 5 and refused > 20
