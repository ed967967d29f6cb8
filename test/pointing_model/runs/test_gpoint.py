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

"""Input files of RTS2's gpoint: German and alt-azimuth mounts."""

import numpy as np
import pytest

from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ, parse_mount
from pointing_model.runs.columns.run_table import NoObservations
from pointing_model.sky.places import observed_to_icrs, sidereal_time
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site
from telescope_mount.input_files.run_loader import load_run

SITE = Site(-35.5 * DEG, -69.45 * DEG, 1430.0)
HEAD = '#  Observation MJD MNT-LST RA-MNT DEC-MNT AXRA AXDEC RA-TRUE DEC-TRUE\n'
TIME = 1_478_000_000.0 + 300.0 * np.arange(40)


def file_of(kind, *columns):
    rows = '\n'.join('\t'.join([f'{i:02d}x', *(f'{v:.9f}' for v in row)])
                     for i, row in enumerate(zip(*columns)))
    return f'{HEAD}# {kind} -69.45 -35.5 1430\n{rows}\n'


@pytest.fixture
def sky():
    rng = np.random.default_rng(4)
    return rng.uniform(0, 2 * np.pi, 40), rng.uniform(25, 75, 40) * DEG


def terms_of(mount):
    return dict(zip(mount.names.physical, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC))


@pytest.fixture
def german(sky):
    """A German mount on both sides; angles of its axes as RTS2 writes them, dec beyond 90."""
    mount = parse_mount('german', SITE.latitude)
    ra, dec = observed_to_icrs(*sky, TIME, SITE, Weather(0.0))
    beyond = np.arange(40) % 2 == 0
    first, second = PointingModel(terms_of(mount), mount=mount).sky_to_encoder(
        *mount.axes_of(*sky, beyond))
    lst = sidereal_time(TIME, SITE) / DEG
    # MJD to 0.00001 days: the clock tells the moment
    return file_of('observatory', np.round(TIME / 86400.0 + 40587.0, 5), lst,
                   (lst - first / DEG) % 360.0, second / DEG - 360.0 * (second < -1.6), first * 0,
                   first * 0, ra / DEG, dec / DEG)


def test_a_german_mount_is_read_on_both_sides(german, tmp_path):
    path = tmp_path / 'run.gpoint'
    path.write_text(german)
    run = load_run(path, weather=Weather(0.0))
    assert run.mount.two_sided and len(run) == 40
    # no frame is declared: the rows tell it
    assert any('ICRS is used' in note for note in run.meta['notes'])
    fitted = fit_terms(run).model.terms
    for name, value in terms_of(run.mount).items():
        assert fitted[name] == pytest.approx(value, abs=0.02 * ARCSEC), name
    path.write_text(german.replace(HEAD, HEAD + '# frame: of date\n'))
    with pytest.raises(ValueError, match='as ICRS the places leave'):
        load_run(path, weather=Weather(0.0))


def test_azimuth_of_rts2_counts_from_south_through_west(sky, read):
    az, el = sky
    az_enc, el_enc = PointingModel(terms_of(ALTAZ)).sky_to_encoder(az, el)
    text = file_of('altaz', TIME / 86400.0 + 2440587.5, az * 0, az_enc / DEG - 180.0,
                   el_enc / DEG, az * 0, az * 0, az / DEG - 180.0, el / DEG)
    run = read(text)
    assert run['time'] == pytest.approx(TIME, abs=1e-3) and run['star'][3] == '03x'
    assert np.cos(run['az'] - az) == pytest.approx(np.ones(40))
    fitted = fit_terms(run).model.terms
    for name, value in terms_of(ALTAZ).items():
        assert fitted[name] == pytest.approx(value, abs=0.01 * ARCSEC), name


def test_images_that_were_not_solved_are_listed(german, read):
    lines = german.splitlines()
    lines[5] = '# ' + lines[5]
    told = read('\n'.join(lines)).meta['excluded']
    assert told == [{'row': 6, 'reason': 'commented out'}]


@pytest.mark.parametrize('change, words', [
    (('observatory', 'altaz-manual'), ['row 2', 'altaz-manual is not read']),
    (('-35.5 1430', '-135.5 1430'), ['row 2', 'latitude_deg -135.5 is outside']),
    (('# observatory', '# gem 1 2 3\n# observatory'), ['row 3', 'another mount or site']),
    (('# observatory', '# frame: galactic\n# observatory'), ["'galactic' is unknown"]),
])
def test_other_files_are_refused(german, refuse, change, words):
    assert change[0] in german
    refuse(german.replace(*change, 1), *words)


def test_cells_and_dates_that_are_none_are_told(german, refuse, read):
    lines = german.splitlines()
    cells = lines[4].split('\t')
    for row, reason in (([*cells[:3], 'far', *cells[4:]], "RA-MNT 'far' is not a number"),
                        ([cells[0], '5.0', *cells[2:]], "JD '5.0' is outside 1900 to 2100, as"),
                        ([*cells, '1'], '10 columns, but 9 are read')):
        run = read('\n'.join([*lines[:4], '\t'.join(row), *lines[5:]]))
        (left,) = run.meta['excluded']
        assert left['row'] == 5 and left['reason'].startswith(reason)
    with pytest.raises(NoObservations):
        read('\n'.join(lines[:2]))
