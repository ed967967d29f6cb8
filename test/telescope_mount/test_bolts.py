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

"""The command ``bolts``: of a model, of a run, and image by image."""

import json
from importlib.util import find_spec

import numpy as np
import pytest
from bolts import UP, Bolted

from msg_tools.units import ARCSEC, DEG
from pointing_model.bolts_and_feet import polar_axis
from pointing_model.image_alignment import Image, axis_of_arc
from pointing_model.model import PointingModel
from pointing_model.mounts import Mount
from telescope_mount.bolt_watch import COLLECTED, ONE, STOPPED, THREE, BoltWatch

START = 1_795_000_000.0


def shot(bolted, hour, dec=20.0, sigma=1.0, number=0):
    """An image at these readings, degrees."""
    place = bolted.looks(np.array([hour * DEG]), np.array([dec * DEG]))[0]
    return Image(hour * DEG, dec * DEG, place, sigma * ARCSEC, 30.0 * number, f'{number}')


def mount(latitude, azimuth=2.0, altitude=-1.5, **errors):
    bolted = Bolted(latitude * DEG, 'equatorial', UP, errors)
    bolted.turn_azimuth(azimuth * DEG)
    bolted.raise_axis(altitude * DEG)
    return bolted


def three(watch, bolted, start=0, dec=20.0):
    return [watch.add(shot(bolted, hour, dec, number=start + i))
            for i, hour in enumerate((-40.0, -5.0, 30.0))]


@pytest.mark.parametrize(('latitude', 'dec'), [(48.0, 20.0), (-30.0, -20.0), (70.0, 40.0)])
def test_three_images_then_one_a_turn_then_three_again(latitude, dec):
    bolted = mount(latitude, ia=0.3 * DEG, ie=-0.2 * DEG, ca=0.1 * DEG, npae=0.1 * DEG)
    watch = BoltWatch(bolted.latitude)
    told = three(watch, bolted, dec=dec)
    assert [one.kind for one in told] == [COLLECTED, COLLECTED, THREE] and not told[-1].again
    axis = told[-1].axis
    assert axis.azimuth_error == pytest.approx(2.0 * DEG, abs=0.01 * ARCSEC)
    assert axis.altitude_error == pytest.approx(-1.5 * DEG, abs=0.01 * ARCSEC)
    bolted.turn_azimuth(-0.7 * axis.azimuth_error)
    bolted.raise_axis(-0.7 * axis.altitude_error)
    # the sky went on, and the mount followed it
    left = watch.add(shot(bolted, 30.5, dec, number=10))
    assert left.kind == ONE
    assert left.axis.azimuth_error == pytest.approx(0.6 * DEG, abs=0.01 * ARCSEC)
    assert left.axis.altitude_error == pytest.approx(-0.45 * DEG, abs=0.01 * ARCSEC)
    assert max(left.axis.sigmas) < 15.0 * ARCSEC
    bolted.turn_azimuth(-0.6 * DEG)
    bolted.raise_axis(0.45 * DEG)
    assert watch.add(shot(bolted, 30.5, dec, number=11)).axis.pole_distance[0] < 0.01 * ARCSEC
    bolted.turn_azimuth(20.0 * ARCSEC)  # as it is locked
    last = three(watch, bolted, 20, dec)[-1]
    assert last.kind == THREE and last.again
    assert last.moved[0] == pytest.approx(20.0 * ARCSEC, abs=0.01 * ARCSEC)


@pytest.mark.parametrize('bolt', ['azimuth', 'altitude'])
def test_an_error_that_doubles_stops(bolt):
    bolted = mount(48.0)
    watch = BoltWatch(bolted.latitude)
    three(watch, bolted)
    turn, angle = {'azimuth': (bolted.turn_azimuth, 2.0),
                   'altitude': (bolted.raise_axis, -1.5)}[bolt]
    turn(0.5 * angle * DEG)
    assert watch.add(shot(bolted, 30.0, number=3)).kind == ONE
    turn(0.5 * angle * DEG)
    told = watch.add(shot(bolted, 30.0, number=4))
    assert told.kind == STOPPED and told.bolt == bolt


def test_an_error_within_its_sigma_does_not_stop():
    bolted = mount(48.0, 3.0 / 3600.0, 0.0)
    watch = BoltWatch(bolted.latitude)
    three(watch, bolted)
    bolted.turn_azimuth(3.0 * ARCSEC)
    assert watch.add(shot(bolted, 30.0, number=3)).kind == ONE


def test_with_a_model_the_first_image_tells(tmp_path):
    bolted = mount(48.0, 0.0, 0.0)
    model = PointingModel({'MA': 0.0, 'ME': 0.0}, np.eye(2) * ARCSEC**2, mount=bolted.mount)
    watch = BoltWatch(bolted.latitude, 0.0, model, polar_axis(model))
    bolted.turn_azimuth(0.4 * DEG)
    told = watch.add(shot(bolted, 10.0))
    assert told.kind == ONE
    assert told.axis.azimuth_error == pytest.approx(0.4 * DEG, abs=0.01 * ARCSEC)


def test_sigma_of_three_images_is_their_scatter():
    rng = np.random.default_rng(3)
    bolted, found = mount(48.0), []
    clean = [shot(bolted, hour, sigma=5.0) for hour in (-40.0, -5.0, 30.0)]
    for _ in range(120):
        images = [one._replace(place=one.place + 5.0 * ARCSEC * rng.normal(size=3))
                  for one in clean]
        images = [one._replace(place=one.place / np.linalg.norm(one.place)) for one in images]
        axis = axis_of_arc(images, bolted.latitude)
        found.append([(axis.azimuth_error - 2.0 * DEG) / axis.sigmas[0],
                      (axis.altitude_error + 1.5 * DEG) / axis.sigmas[1]])
    assert 0.85 < np.std(found) < 1.15


@pytest.mark.parametrize(('change', 'why'), [
    (lambda one: one._replace(first=-one.first), 'wrong sign'),
    (lambda one: one._replace(first=1.2 * one.first), 'look at clock, site and readings'),
    (lambda one: one._replace(second=one.second + one.first * 0.01), 'declination axis moved')])
def test_images_that_give_no_axis_are_refused(change, why):
    bolted = mount(48.0)
    images = [change(shot(bolted, hour)) for hour in (-40.0, -5.0, 30.0)]
    with pytest.raises(ValueError, match=why):
        axis_of_arc(images, bolted.latitude)


def test_a_model_tells_what_to_turn(ended, refused, tmp_path):
    path = tmp_path / 'model.json'
    PointingModel({'CH': 60.0 * ARCSEC, 'MA': 0.01, 'ME': 0.002}, np.eye(3) * ARCSEC**2,
                  mount=Mount.equatorial(-30.0 * DEG, 'german')).save(path)
    code, out, err = ended('bolts', path, '--per-turn', '30,40', '--saddle', 350,
                           '--pole', 'refracted', '--json', tmp_path / 'out.json')
    assert code == 0 and err == ''
    assert 'from the refracted pole' in out and 'the axis goes west' in out and 'turns' in out
    document = json.loads((tmp_path / 'out.json').read_text())
    assert document['shim']['end'] == 'rear' and document['polar_axis']['south']
    assert 90.0 < (document['polar_axis']['pole']['altitude_deg'] - 30.0) * 3600.0 < 101.0
    assert 'needs --live FOLDER' in refused('bolts', path, '--solver', 'astap')
    assert 'on bolts, not on feet' in refused('bolts', path, '--feet', 1000)
    assert ended('bolts', path, '--mount', 'german', '--latitude', '-30.005')[0] == 0
    PointingModel.load(path).save(path.with_suffix('.yaml'))
    assert ended('bolts', path.with_suffix('.yaml'))[1].startswith('The polar axis points')
    for other in (('--latitude', 30), ('--mount', 'fork')):
        assert 'a German mount, latitude -30.0000' in refused('bolts', path, *other)


def solved(place, moment, hour):
    """Keywords of an image that looks there, with and without its solution."""
    from pointing_model.runs.formats.csv import iso_utc
    from pointing_model.sky.places import observed_to_icrs
    from pointing_model.sky.site import Site
    east, north, up = place
    ra, dec = observed_to_icrs(np.arctan2(east, north), np.arcsin(up), moment,
                               Site(34.3 * DEG, 109.0 * DEG, 500.0))
    read = {'DATE-OBS': iso_utc(np.array([moment]))[0].rstrip('Z'), 'HA': hour, 'DEC': 20.0}
    return read, {'CTYPE1': 'RA---TAN', 'CTYPE2': 'DEC--TAN', 'RADESYS': 'ICRS',
                  'CRVAL1': float(ra) / DEG, 'CRVAL2': float(dec) / DEG, 'CRPIX1': 2.5,
                  'CRPIX2': 2.5, 'CD1_1': -3e-4, 'CD1_2': 0.0, 'CD2_1': 0.0, 'CD2_2': 3e-4}


YAML = """\
site: {latitude_deg: 34.3, longitude_deg: 109.0, height_m: 500}
time_is: start
encoders_at: start
keywords: {time: DATE-OBS, ha_enc_deg: HA, dec_enc_deg: DEC}
"""


@pytest.mark.skipif(find_spec('astropy') is None, reason='needs astropy')
def test_an_image_that_the_quick_way_does_not_solve_is_solved_the_other(tmp_path):
    from argparse import Namespace

    from astropy.io import fits

    from telescope_mount.live_bolts import LiveFolder
    (tmp_path / 'mount.yaml').write_text(YAML)
    place = shot(mount(34.3, 0.5, 0.3), -40.0).place
    read, wcs = solved(place, START, -40.0)
    fits.writeto(tmp_path / 'a.fits', np.zeros((4, 4), np.int16), fits.Header(read))
    fits.Header({'SIMPLE': True, 'BITPIX': 8, 'NAXIS': 0, 'IMAGEW': 4, 'IMAGEH': 4,
                 **wcs}).tofile(tmp_path / 'truth.wcs')
    program = tmp_path / 'solve-field-fake'
    program.write_text(f"""#!/bin/sh
echo "$@" >> {tmp_path}/called
case "$*" in *--no-remove-lines*) exit 0;; esac
while [ $# -gt 1 ]; do [ "$1" = --dir ] && dir=$2; shift; done
cp {tmp_path}/truth.wcs "$dir/solved.wcs"
""")
    program.chmod(0o755)
    folder = LiveFolder(tmp_path, Namespace(
        keywords=None, solver=str(program), scale=None, latitude=None,
        longitude=None, height=None, pressure=None, temperature=None))
    (_, _, image, reason), = folder.new_images()
    assert reason is None and len((tmp_path / 'called').read_text().splitlines()) == 2
    assert np.linalg.norm(image.place - place) < 0.1 * ARCSEC
    assert image.sigma == pytest.approx(1.05 * ARCSEC, rel=0.01)
    assert list(folder.new_images()) == []


@pytest.mark.skipif(find_spec('astropy') is None, reason='needs astropy')
def test_a_folder_of_solved_images_is_watched(ended, tmp_path):
    from astropy.io import fits
    bolted = mount(34.3, 0.5, 0.3)
    (tmp_path / 'mount.yaml').write_text(YAML)
    for i, hour in enumerate([-40.0, -5.0, 30.0, 30.0, -40.0, -5.0, 30.0]):
        if i == 3:
            bolted.turn_azimuth(-0.5 * DEG)
            bolted.raise_axis(-0.3 * DEG)
        read, wcs = solved(shot(bolted, hour).place, START + 60.0 * i, hour)
        fits.writeto(tmp_path / f'a{i}.fits', np.zeros((4, 4), np.int16),
                     fits.Header({**read, **wcs}))
    code, out, err = ended('bolts', '--live', tmp_path, '--for', 5, '--every', 0.1)
    assert err == '' and 'Image 2 of 3 is solved' in out
    assert 'Three images are solved: the axis is 30' in out
    assert 'One image is solved, only the bolts fitted: the axis is 0.' in out
    assert 'Lock the bolts' in out and 'Done: measured once more' in out and code == 0
