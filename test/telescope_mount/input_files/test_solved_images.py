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

"""Runs from FITS images with a WCS, by the keywords that a small YAML maps."""

import shutil
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from places import CASES

from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.mounts import parse_mount, through_pole
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.formats.csv import iso_utc
from pointing_model.runs.plate_solves.fits_images import (
    NotThere,
    frame_of,
    read_header,
    solution_of,
)
from pointing_model.runs.plate_solves.frames import OF_DATE, to_icrs
from pointing_model.runs.run_reader import read_run
from pointing_model.sky.places import observed_to_icrs, sidereal_time
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site
from telescope_mount.input_files.run_loader import load_run

if find_spec('astropy') is None:
    pytest.skip('needs astropy (./install.sh ros,test,images)', allow_module_level=True)

SITE = Site(34.3 * DEG, 109.0 * DEG, 500.0)
MOUNT = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)))
START = 1_795_000_000.0
YAML = """\
images: '*.fits'
site: {latitude_deg: SITELAT, longitude_deg: 109.0, height_m: 500}
time_is: start
encoders_at: end
keywords:
  time: DATE-OBS
  exposure_s: EXPTIME
  az_enc_deg: ENC_AZ
  el_enc_deg: {keyword: ENC_EL, scale: 0.5, offset: 1.0}
  pressure_hpa: 950
  temperature_c: AMBTEMP
  telescope: TELESCOP
"""


def header_of(ra, dec, begin, az_enc, el_enc, scale=1.2, roll=0.3, parity=-1, **more):
    from astropy.io import fits
    cd = scale / 3600 * np.array([[parity * np.cos(roll), np.sin(roll)],
                                  [-parity * np.sin(roll), np.cos(roll)]])
    # the reference pixel is not the centre: the centre is computed
    return fits.Header({
        'CTYPE1': 'RA---TAN', 'CTYPE2': 'DEC--TAN', 'CRPIX1': 32.5, 'CRPIX2': 24.5,
        'CRVAL1': ra / DEG, 'CRVAL2': dec / DEG, 'CD1_1': cd[0, 0], 'CD1_2': cd[0, 1],
        'CD2_1': cd[1, 0], 'CD2_2': cd[1, 1], 'RADESYS': 'ICRS',
        'DATE-OBS': iso_utc(np.array([begin]))[0].rstrip('Z')[:-3], 'EXPTIME': 20.0,
        'ENC_AZ': az_enc / DEG, 'ENC_EL': 2.0 * (el_enc / DEG - 1.0), 'AMBTEMP': 5.0,
        'TELESCOP': 'one', 'SITELAT': '+34:18:00.0', **more})


@pytest.fixture(scope='module')
def images(tmp_path_factory):
    """24 images without pixels that matter, and their YAML."""
    from astropy.io import fits
    folder = tmp_path_factory.mktemp('images')
    rng = np.random.default_rng(4)
    time = START + np.arange(24) * 600.0
    az, el = rng.uniform(0, 2 * np.pi, 24), rng.uniform(25, 75, 24) * DEG
    ra, dec = observed_to_icrs(az, el, time, SITE, Weather(950.0, 5.0))
    az_enc, el_enc = MOUNT.sky_to_encoder(az, el)
    for i in range(24):
        header = header_of(ra[i], dec[i], time[i] - 20.0, az_enc[i], el_enc[i])
        fits.writeto(folder / f'img_{i:02d}.fits', np.zeros((48, 64), np.int16), header)
    (folder / 'mount.yaml').write_text(YAML)
    return folder


@pytest.fixture
def folder(images, tmp_path):
    """A copy of them."""
    return Path(shutil.copytree(images, tmp_path, dirs_exist_ok=True))


def change(folder, number, drop=(), **cards):
    from astropy.io import fits
    path = folder / f'img_{number:02d}.fits'
    data, header = fits.getdata(path, header=True)
    for name in drop:
        del header[name]
    header.update({name.replace('_O', '-O'): value for name, value in cards.items()})
    fits.writeto(path, data, header, overwrite=True)


def reasons(run):
    return {row['row']: row['reason'] for row in run.meta['excluded']}


def test_images_are_a_run(folder, ended):
    run = load_run(folder / 'mount.yaml')
    assert len(run) == 24 and not reasons(run)
    fitted = fit_terms(run).model.terms
    for name, value in MOUNT.terms.items():
        assert fitted[name] == pytest.approx(value, abs=0.02 * ARCSEC), name
    code, out, err = ended('export', folder / 'mount.yaml', folder / 'run.csv')
    assert code == 0 and err == '' and len(read_run(folder / 'run.csv')) == 24


def test_the_moment_of_the_encoders_counts(folder):
    text = YAML.replace('encoders_at: end', 'encoders_at: start')
    (folder / 'mount.yaml').write_text(text)
    early = fit_terms(load_run(folder / 'mount.yaml'), robust=False)
    # 20 s are 300" of hour angle: an azimuth zero and a tilt, as a clock is
    assert abs(early.model.terms['AW'] - MOUNT.terms['AW']) / ARCSEC == pytest.approx(
        300 * np.cos(SITE.latitude), abs=2)


def test_what_an_image_lacks_is_named(folder):
    change(folder, 2, ('CTYPE1',))
    change(folder, 4, CRVAL1=float('1e3'), CTYPE1='GLON-TAN', CTYPE2='GLAT-TAN')
    change(folder, 5, EQUINOX=1875.0, RADESYS='FK5')
    change(folder, 6, RADESYS='FK4')
    change(folder, 7, ('ENC_AZ',))
    change(folder, 8, ENC_AZ='moving')
    change(folder, 9, DATE_OBS='last night')
    change(folder, 10, TIMESYS='TAI')
    change(folder, 11, CD1_1=0.0, CD1_2=0.0)
    (folder / 'img_12.fits').write_bytes(b'no image')
    told = reasons(load_run(folder / 'mount.yaml'))
    for row, words in {
            3: 'img_02.fits: no WCS', 5: 'GLON-TAN', 6: 'outside 1900 to 2100', 7: 'is B1950, of',
            8: 'no keyword ENC_AZ for az_enc_deg', 9: "ENC_AZ is 'moving'",
            10: "'last night' is no time", 11: 'TIMESYS is TAI', 12: 'its WCS',
            13: 'not a FITS image'}.items():
        assert words in told.pop(row)
    assert not told


ONE = {'CTYPE1': 'RA---TAN', 'CTYPE2': 'DEC--TAN', 'NAXIS1': 1000, 'NAXIS2': 800, 'CRPIX1': 100.0,
       'CRPIX2': 300.0, 'CRVAL1': 80.0, 'CRVAL2': 40.0, 'RADESYS': 'ICRS'}
COS, SIN = 2.78e-4 * np.cos(0.5), 2.78e-4 * np.sin(0.5)
CD = {'CD1_1': -COS, 'CD1_2': SIN, 'CD2_1': SIN, 'CD2_2': COS}
OLD = {'CDELT1': -5e-4, 'CDELT2': 5e-4}
PC = {'PC1_1': np.cos(0.5), 'PC1_2': -np.sin(0.5), 'PC2_1': np.sin(0.5), 'PC2_2': np.cos(0.5),
      'CDELT1': -2.78e-4, 'CDELT2': 2.78e-4}
SIP = {'A_ORDER': 2, 'B_ORDER': 2, 'A_2_0': 1e-5, 'B_0_2': 1e-5}
FAINT = {'A_ORDER': 2, 'B_ORDER': 2, 'A_2_0': 1e-8, 'B_0_2': 1e-8}
PV = {'PV1_0': 0.001, 'PV1_1': 1.0, 'PV2_0': 0.0, 'PV2_1': 1.0}
TPV = {'CTYPE1': 'RA---TPV', 'CTYPE2': 'DEC--TPV'}
WITH_SIP = {'CTYPE1': 'RA---TAN-SIP', 'CTYPE2': 'DEC--TAN-SIP'}
#: right ascension, declination of the middle: plain, with SIP, with TPV (wcslib)
PLAIN, BENT, OF_TPV = (79.889810, 40.077845), (79.889315, 40.078083), (79.891117, 40.077847)


def header_with(*parts, twice=None):
    from astropy.io import fits
    header = fits.Header({k: v for part in (ONE, *parts) for k, v in part.items()})
    for card in (twice or {}).items():
        header.append(card)
    return header


@pytest.mark.parametrize('parts, place', [
    ([CD], PLAIN), ([CD, OLD], PLAIN), ([CD, OLD, {'CROTA2': 10.0}], PLAIN), ([PC], PLAIN),
    ([PC, {'CROTA2': -np.degrees(0.5)}], PLAIN), ([CD, FAINT], PLAIN), ([CD, SIP, WITH_SIP], BENT),
    ([CD, WITH_SIP], PLAIN), ([CD, PV], OF_TPV), ([CD, PV, TPV], OF_TPV),
    ([CD, {'CTYPE1A': 'RA---TAN', 'CTYPE2A': 'DEC--TAN', 'CRVAL1A': 9.0, 'PC1_1A': 2.0}], PLAIN),
    ([{'CTYPE1': 'DEC--TAN', 'CTYPE2': 'RA---TAN', 'CRVAL1': 40.0, 'CRVAL2': 80.0, 'CD1_1': SIN,
       'CD1_2': COS, 'CD2_1': -COS, 'CD2_2': SIN}], PLAIN)],
    ids=['CD', 'old CDELT', 'old CROTA', 'PC', 'CROTA as PC', 'faint SIP without suffix', 'SIP',
         'suffix alone', 'TAN of SCAMP', 'TPV', 'another version', 'declination first'])
def test_what_the_standard_says_of_a_header_counts(parts, place):
    found = solution_of(header_with(*parts))
    assert (found.ra_deg, found.dec_deg) == pytest.approx(place, abs=2e-6)
    assert found.parity == -1 and found.scale_arcsec_px == pytest.approx(1.0008)


@pytest.mark.parametrize('parts, twice, said', [
    ([CD, OLD, PC], None, 'PC beside CD, which the FITS standard forbids'),
    ([CD, {'PC001001': 1.0, 'PC002002': 1.0}], None, 'PC beside CD'),
    ([PC, {'CROTA2': 10.0}], None, 'CROTA beside PC'),
    ([CD, SIP], None, 'coefficients of SIP, and no -SIP in CTYPE'),
    ([CD, SIP, PV, WITH_SIP], None, 'coefficients of SIP and of TPV'),
    ([CD], {'CRVAL1': 81.0}, 'CRVAL1 is there 2 times, with different values'),
    ([CD, {'CTYPE1': 'RA---TNX', 'CTYPE2': 'DEC--TNX'}], None, 'projection TNX'),
    ([CD, {'CTYPE2': 'DEC--SIN'}], None, 'cannot be read')])
def test_a_header_that_contradicts_itself_has_no_place(parts, twice, said, capsys):
    with pytest.raises(NotThere, match=said):
        solution_of(header_with(*parts, twice=twice))
    assert capsys.readouterr() == ('', '')


def test_images_whose_header_contradicts_itself_are_left_out_by_name(folder):
    from astropy.io import fits
    whole = load_run(folder / 'mount.yaml')
    for number in (3, 4):
        change(folder, number, PC1_1=1.0, PC2_2=1.0, CDELT1=-1e-3, CDELT2=1e-3)
    change(folder, 5, CDELT1=-1e-3, CDELT2=1e-3, CROTA2=70.0)
    path = folder / 'img_06.fits'
    data, header = fits.getdata(path, header=True)
    header.append(('ENC_AZ', 1.0))
    fits.writeto(path, data, header, overwrite=True)
    # a solution in the extension does not get parts of an old one before it
    data, header = fits.getdata(folder / 'img_07.fits', header=True)
    fits.HDUList([fits.PrimaryHDU(header=fits.Header({'PC1_1': 1.0, 'PC2_2': 1.0, 'CRVAL1': 3.0})),
                  fits.ImageHDU(data, header)]).writeto(folder / 'img_07.fits', overwrite=True)
    run = load_run(folder / 'mount.yaml')
    told = reasons(run)
    assert sorted(told) == [4, 5, 7] and told[4].startswith('img_03.fits: its WCS has PC beside CD')
    assert told[7] == 'img_06.fits: ENC_AZ is there 2 times, with different values'
    np.testing.assert_array_equal(run['az'], np.delete(whole['az'], [3, 4, 6]))


@pytest.mark.skipif(not CASES.is_dir(), reason='the small inputs are not there')
def test_the_small_input_with_an_old_pc_is_refused_by_the_name_of_an_image():
    with pytest.raises(ValueError, match='none of 30 rows .*i00.fits: its WCS has PC beside CD'):
        load_run(CASES / 'both' / 'mount.yaml')


def test_false_images_are_named_by_file(folder):
    from astropy.io import fits
    data, header = fits.getdata(folder / 'img_03.fits', header=True)
    for name in ('CRVAL1', 'CRVAL2', 'CD1_1', 'CD1_2', 'CD2_1', 'CD2_2'):
        change(folder, 9, **{name: header[name]})
    change(folder, 14, CD1_1=1e-4, CD2_2=1e-4)
    (folder / 'img_99.fits').write_bytes((folder / 'img_20.fits').read_bytes())
    told = reasons(load_run(folder / 'mount.yaml'))
    assert sorted(told) == [10, 15, 25]
    assert told[10].startswith('img_09.fits: solution copied from row 4')
    assert 'img_14.fits: image scale' in told[15] and 'a second solution' in told[25]


@pytest.mark.parametrize('change_of, words', [
    (('ENC_AZ', 'ENC-AZ'), ['keyword ENC-AZ is in none of 24 images', 'closest: ENC_AZ']),
    (('keywords:', 'keyword:'), ['no section "keywords:"']),
    (('time_is:', 'time_iz:'), ["unknown key 'time_iz'; did you mean time_is?"]),
    (('encoders_at: end\n', ''), ['encoders_at is not said: start, middle or end']),
    (('at: end', 'at: dusk'), ["encoders_at 'dusk' is unknown"]),
    (('  exposure_s: EXPTIME\n', ''), ['no keyword for exposure_s']),
    (('  az_enc_deg: ENC_AZ\n', ''), ['no keyword for az_enc_deg']),
    (('az_enc_deg: ENC_AZ', 'az_enc: ENC_AZ'), ['no keyword for az_enc_deg (closest: az_enc)']),
    (('telescope: TELESCOP', 'ra_deg: RA'), ['ra_deg comes from the solution']),
    (('offset', 'ofset'), ["unknown key 'ofset'; did you mean offset?"]),
    (("'*.fits'", "'*.png'"), ['has no image *.png']),
    (('SITELAT', 'OBSLAT'), ['no image has the keywords of the site']),
    (('latitude_deg: SITELAT, ', ''), ['need the site']),
    (('images:', 'frame: galactic\nimages:'), ["'galactic' is unknown"]),
    (('images:', 'boresight: 5\nimages:'), ['not a pixel']),
    (('images:', 'images: [\n'), ['line', 'not a YAML']),
])
def test_a_mapping_that_does_not_fit_is_one_line(folder, refused, change_of, words):
    assert change_of[0] in YAML
    (folder / 'mount.yaml').write_text(YAML.replace(*change_of, 1))
    line = refused('fit', folder / 'mount.yaml')
    assert all(word in line for word in words), line


def test_images_of_two_mounts_or_sites_are_refused(folder, refused):
    change(folder, 7, TELESCOP='other')
    assert "img_07.fits is of mount 'other'" in refused('fit', folder / 'mount.yaml')
    change(folder, 7, TELESCOP='one', SITELAT=12.0)
    assert 'img_07.fits has another site' in refused('fit', folder / 'mount.yaml')


def test_images_that_are_not_solved_are_refused(folder, refused):
    for i in range(24):
        change(folder, i, ('CTYPE1', 'CTYPE2'))
    line = refused('fit', folder / 'mount.yaml')
    assert 'none of 24 rows can be used (img_00.fits: no WCS' in line


def test_images_that_cannot_be_read_are_refused(folder, refused):
    for file in folder.glob('*.fits'):
        file.write_bytes(b'no image')
    line = refused('fit', folder / 'mount.yaml')
    assert 'none of 24 images can be read (img_00.fits: not a FITS image' in line


@pytest.mark.parametrize('cards, said', [
    ({}, None), ({'EQUINOX': 2000.0}, 'ICRS'), ({'EQUINOX': 1950.0}, 'B1950'),
    ({'EQUINOX': 2024.5}, 'J2024.5'), ({'RADESYS': 'FK5', 'EQUINOX': 2000.0}, 'ICRS'),
    ({'RADECSYS': 'FK4'}, 'B1950'), ({'RADESYS': 'GAPPT'}, 'of date'), ({'EPOCH': 2000.0}, 'ICRS')])
def test_frames_of_headers(cards, said):
    from astropy.io import fits
    frame = frame_of(fits.Header(cards))
    assert (frame.text if frame else None) == said


@pytest.mark.parametrize('cards', [{'EQUINOX': 'NaN'}, {'RADESYS': 'FK4-NO-E'},
                                   {'EQUINOX': 'J20'}, {'RADESYS': 'HIPPARCOS'}])
def test_odd_equinoxes_are_told(cards):
    from astropy.io import fits
    with pytest.raises(NotThere, match='EQUINOX'):
        frame_of(fits.Header(cards))


def test_the_boresight_is_a_pixel_or_the_middle(folder):
    header = read_header(folder / 'img_00.fits')
    middle, corner = solution_of(header), solution_of(header, (1.0, 1.0))
    # the reference pixel of these is their middle: 64 x 48 pixels
    assert middle.ra_deg == pytest.approx(header['CRVAL1'], abs=1e-9)
    assert middle.dec_deg == pytest.approx(header['CRVAL2'], abs=1e-9)
    away = np.hypot((corner.ra_deg - middle.ra_deg) * np.cos(middle.dec_deg * DEG),
                    corner.dec_deg - middle.dec_deg) * 3600
    assert away == pytest.approx(1.2 * np.hypot(31.5, 23.5), rel=1e-3)
    assert middle.scale_arcsec_px == pytest.approx(1.2) and middle.parity == -1


def test_without_astropy_a_line_says_what_to_install(folder, refused, monkeypatch):
    import sys
    monkeypatch.setitem(sys.modules, 'astropy', None)
    assert './install.sh ros,images' in refused('fit', folder / 'mount.yaml')


def german_images(folder, mapping, readings):
    """24 images of a German mount and its model; `readings`: keywords of time, h and dec."""
    from astropy.io import fits
    rng = np.random.default_rng(6)
    mount = parse_mount('german', SITE.latitude)
    time, az = START + np.arange(24) * 600.0, rng.uniform(0, 2 * np.pi, 24)
    el, west = rng.uniform(25, 75, 24) * DEG, rng.random(24) < 0.5
    ra, dec = observed_to_icrs(az, el, time, SITE, Weather(950.0, 5.0))
    model = PointingModel(dict(zip(mount.names.physical, MOUNT.terms.values())), mount=mount)
    # readings as places of the sky, and the side of the pier beside them
    axes = through_pole(*model.sky_to_encoder(*mount.axes_of(az, el, west)), west)
    cards = {name: value / DEG for name, value in readings(time, *axes).items()}
    for i in range(24):
        fits.writeto(folder / f'img_{i:02d}.fits', np.zeros((48, 64), np.int16), header_of(
            ra[i], dec[i], time[i], 0.0, 0.0, PIERSIDE='WEST' if west[i] else 'EAST',
            **{name: value[i] for name, value in cards.items()}))
    (folder / 'mount.yaml').write_text(mapping)
    return model


def german_yaml(first, second, more=''):
    return YAML.replace('encoders_at: end', f'encoders_at: start\nmount: german{more}').replace(
        'az_enc_deg: ENC_AZ', f'{first}\n  pier_side: PIERSIDE').replace(
        'el_enc_deg: {keyword: ENC_EL, scale: 0.5, offset: 1.0}', second)


def same_terms(path, model, within):
    run = load_run(path)
    assert len(run) == 24 and not reasons(run)
    fitted = fit_terms(run).model.terms
    assert fitted == pytest.approx(model.terms, abs=within * ARCSEC)


def test_images_of_a_german_mount(tmp_path, refused):
    text = german_yaml('ha_enc_deg: HA', 'dec_enc_deg: DECENC')
    model = german_images(tmp_path, text, lambda _, h, dec: {'HA': h, 'DECENC': dec})
    same_terms(tmp_path / 'mount.yaml', model, 0.02)
    (tmp_path / 'mount.yaml').write_text(text.replace('dec_enc_deg', 'el_enc_deg'))
    line = refused('fit', tmp_path / 'mount.yaml')
    assert "'el_enc_deg' is unknown; did you mean dec_enc_deg?" in line


def test_images_with_the_place_of_the_mount_in_j2000(tmp_path, refused):
    """As INDI's cameras and N.I.N.A. write it."""
    def readings(time, h, dec):
        ra, dec = to_icrs(sidereal_time(time, SITE) - h, dec, OF_DATE, time)
        return {'RA': ra, 'DEC': dec}
    text = german_yaml('ra_enc_deg: RA', 'dec_enc_deg: DEC', '\nreadings: J2000')
    model = german_images(tmp_path, text, readings)
    same_terms(tmp_path / 'mount.yaml', model, 0.02)
    (tmp_path / 'mount.yaml').write_text(text.replace('ra_enc_deg: RA', 'ha_enc_deg: RA'))
    assert 'readings ICRS needs a column ra_enc_deg' in refused('fit', tmp_path / 'mount.yaml')
