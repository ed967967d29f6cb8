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

"""Mounts whose first axis does not stand upright: geometry, names, both sides of the pier."""

from dataclasses import replace

import numpy as np
import pytest

from encoder_sim.mount_geometry import MountErrors, MountGeometry, direction
from encoder_sim.scenario import Scenario
from encoder_sim.scenario_file import load_scenario
from encoder_sim.star_camera import Camera
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.geometry import sky_to_encoder
from pointing_model.mounts import parse_mount
from pointing_model.sky.places import observed_place
from pointing_model.sky.star_catalogue import load_catalogue

NIGHT = 1_768_482_000
LATITUDES = (34.3 * DEG, -30.2 * DEG)
SIZES = (310.0, -170.0, 46.0, -23.0, 37.0, -21.0, 15.0)
KINDS = ('equatorial', 'german', 'free:0,0', 'free:40,20,30')


def scenario(folder, kind, terms, more=''):
    """A scenario of that kind with terms in arcsec, in its own words."""
    path = folder / 'mine.yaml'
    first, second = parse_mount(kind, 0.0).names.keys
    path.write_text(
        f'mount:\n  kind: {kind}\n'
        + ''.join(f'  {name.lower()}_arcsec: {value}\n' for name, value in terms.items()) + more
        + f'incremental: {{{first}: {{mark_angle_deg: 80}}, {second}: {{mark_angle_deg: 40}}}}\n')
    return load_scenario(path)


def sky(n, seed=1, lowest=10 * DEG):
    """Places all over the sky and a side of the pier for each."""
    rng = np.random.default_rng(seed)
    return (rng.uniform(0.0, 2.0 * np.pi, n), np.arcsin(rng.uniform(np.sin(lowest), 1.0, n)),
            rng.random(n) < 0.5)


@pytest.mark.parametrize('latitude', LATITUDES)
@pytest.mark.parametrize('kind', KINDS)
def test_it_looks_where_the_model_with_the_same_terms_says(tmp_path, kind, latitude):
    mount = parse_mount(kind, latitude)
    terms = dict(zip(mount.names.physical, SIZES))
    made = MountGeometry(scenario(tmp_path, kind, terms).mount, latitude=latitude)
    first, second = mount.axes_of(*sky(400))
    reading = sky_to_encoder(
        first, second, {name: value * ARCSEC for name, value in terms.items()}, mount)
    known = np.isfinite(reading[0])
    apart = made.boresight(*reading) - mount.direction(first, second).T
    assert known.mean() > 0.99
    # what is left is where the cosine of the sag is taken: 15" of 300" of tilt
    assert np.linalg.norm(apart[known], axis=1).max() < 0.001 * ARCSEC


@pytest.mark.parametrize('kind', ['equatorial', 'german', 'free:40,20,30'])
def test_each_term_is_its_column_to_first_order(tmp_path, kind):
    from pointing_model.pointing_terms import Trig, terms_of
    mount = parse_mount(kind, LATITUDES[0])
    first, second = mount.axes_of(*sky(300, lowest=20 * DEG))
    plain = np.abs(np.cos(second)) > 0.1
    for name in mount.names.physical:
        made = MountGeometry(scenario(tmp_path, kind, {name: 10.0}).mount, latitude=LATITUDES[0])
        frames = made.frames(first, second)
        # where it should look, seen by the tube that looks elsewhere; encoder - catalogue
        seen = np.einsum('nij,nj->ni', frames, mount.direction(first, second).T)
        x, y = terms_of(mount)[name].of(Trig(first, second, mount=mount))
        column = np.array([np.broadcast_to(v, first.shape) for v in (x, y)])
        error = seen[:, [0, 2]].T / ARCSEC - 10.0 * column
        assert np.abs(error[:, plain]).max() < 0.01, name


def test_the_tube_turns_over_with_the_side_and_gravity_does_not():
    mount = parse_mount('german', LATITUDES[0])
    west, east = (mount.axes_of(1.0, 0.8, beyond) for beyond in (False, True))
    made = MountGeometry(MountErrors(kind='german'), latitude=LATITUDES[0])
    one, other = (made.frames(*axes)[0] for axes in (west, east))
    np.testing.assert_allclose(one[1], direction(1.0, 0.8), atol=1e-12)
    np.testing.assert_allclose(other, np.diag([-1.0, 1.0, -1.0]) @ one, atol=1e-12)
    sagging = MountGeometry(MountErrors(kind='german', tf=20 * ARCSEC), latitude=LATITUDES[0])
    for axes in (west, east):
        assert (np.arcsin(sagging.boresight(*axes)[0, 2]) - 0.8) / ARCSEC == pytest.approx(
            -20.0 * np.cos(0.8), abs=0.01)


@pytest.mark.parametrize('kind', ['equatorial', 'german'])
def test_the_camera_measures_in_the_tube_on_both_sides(kind):
    latitude = Camera(Scenario(), 1).site.latitude
    mount = parse_mount(kind, latitude)
    stars = load_catalogue(3.0)
    az, el = observed_place(stars, NIGHT)
    up = (el > 20 * DEG) & (el < 80 * DEG)
    stars, az, el = stars.select(up), az[up], el[up]
    made = MountGeometry(MountErrors(kind=kind), latitude=latitude)
    # readings too large: the star lies back, toward falling readings of both axes
    step = np.array([40.0, -25.0]) * ARCSEC
    for beyond in (False, True):
        first, second = mount.axes_of(az, el, np.full(len(az), beyond))
        frames = made.frames(first + step[0], second + step[1])
        seen = Camera(Scenario(), 1).expose(np.full(len(az), NIGHT * 10**9), frames)
        alone = seen.hip == stars.hip
        assert alone.sum() > 30
        expected = np.array([-step[0] * np.cos(second), np.full(len(az), -step[1])]).T
        assert np.abs(seen.miss - expected)[alone].max() < 0.02 * ARCSEC


def test_the_pole_is_that_of_the_place_where_it_stands():
    """At another latitude than it was aligned for, an equatorial mount is another mount."""
    mount = MountErrors(kind='fork')
    for latitude in LATITUDES:
        pole = MountGeometry(mount, latitude=latitude).boresight(1.3, 90 * DEG)[0]
        np.testing.assert_allclose(pole, [0.0, np.cos(latitude), np.sin(latitude)], atol=1e-12)


def test_a_free_frame_that_is_the_horizon_is_an_alt_azimuth_mount():
    """All that a scenario may do to a mount, and the wind, in either way of saying it."""
    from encoder_sim.wind_gusts import WindLoad
    base = load_scenario('loop_two_effects').mount
    base = replace(base, bumps=load_scenario('loop_track_bump').mount.bumps, creep=9 * ARCSEC,
                   backlash_azimuth=7 * ARCSEC, tf_rate=1e-9,
                   runouts=load_scenario('mount_runout').mount.runouts)
    az, el, _ = sky(200)
    where = {'time': NIGHT + 3600.0, 'approach_az': 1.0, 'approach_el': -1.0}
    one, other = (MountGeometry(replace(base, kind=kind), NIGHT).frames(az, el, **where)
                  for kind in ('altaz', 'free:180,90'))
    np.testing.assert_allclose(other, one, atol=1e-12)
    wind = replace(load_scenario('mount_gusts').wind, shelter=0.7)
    seconds, angles = np.linspace(0.0, 900.0, 200), np.stack([az, el], axis=1)
    one, other = (WindLoad(wind, 1, parse_mount(kind, 0.0)).turn(seconds, angles)
                  for kind in ('altaz', 'free:180,90'))
    assert np.abs(one).max() > 0.1 * ARCSEC
    np.testing.assert_allclose(other, one, atol=1e-16)


def test_words_of_the_mount_in_the_file(tmp_path):
    made = scenario(tmp_path, 'fork', {'MA': 12.0, 'NP': 5.0}, """  me_arcsec_per_hour: 2
  ma_arcsec_per_degc: 3
  backlash_hour_angle_arcsec: 4
drives: {declination: {gain_per_s: 5}}
""")
    assert made.mount.kind == 'equatorial' and made.mount.names.keys == (
        'hour_angle', 'declination')
    assert made.mount.npae == pytest.approx(5.0 * ARCSEC)
    # MA leans the pole west, AW to the other side of the frame
    assert (made.mount.aw, made.mount.aw_slope) == pytest.approx((-12 * ARCSEC, -3 * ARCSEC))
    assert made.mount.an_rate == pytest.approx(2.0 * ARCSEC / 3600.0)
    assert made.mount.backlash_azimuth == pytest.approx(4 * ARCSEC)
    assert made.drives.elevation.gain == 5.0


@pytest.mark.parametrize('text, parts', [
    ('mount: {kind: equatorial, ia_arcsec: 5}', ["'ia_arcsec' is of another mount",
                                                 'hour angle and declination', "'ih_arcsec'"]),
    ('mount: {ih_arcsec: 5}', ["'ih_arcsec' is of another mount", "write 'ia_arcsec'"]),
    ('mount: {kind: german}\naxes: {azimuth: {travel_min_deg: 0}}', ["write 'hour_angle'"]),
    ('mount: {kind: german, xy_arcsec: 5}', ["unknown key 'xy_arcsec'", 'ih_arcsec, id_arcsec']),
    ('mount: {kind: dobson}', ["mount.kind: unknown mount 'dobson'", 'german']),
    ('mount: {kind: 3}', ['mount.kind: 3 is not a text']),
    ('mount: {kind: "free:1"}', ['free:AZ,EL']),
    ('mount: {kind: german}\naxes: {declination: {travel_min_deg: 9, travel_max_deg: 5}}',
     ['axes.declination']),
    ('mount: {kind: german}\nincremental: {hour_angle: {mark_angle_deg: 189}}',
     ['incremental.hour_angle: mark_angle_deg 189', '-10 to 190']),
])
def test_what_another_mount_has_is_refused_in_one_line(tmp_path, text, parts):
    path = tmp_path / 'bad.yaml'
    path.write_text(text + '\n')
    with pytest.raises(ValueError) as error:
        load_scenario(path)
    assert '\n' not in str(error.value) and 'bad.yaml' in str(error.value)
    for part in parts:
        assert part in str(error.value)


def test_on_another_mount_the_instruments_stay_and_its_errors_do_not(tmp_path):
    fork, german, default = map(load_scenario, ('fork', 'german', 'default'))
    assert fork.camera == german.camera == default.camera
    assert fork.absolute == german.absolute == default.absolute
    assert (fork.mount.ia, german.mount.ia) == pytest.approx((240 * ARCSEC, 180 * ARCSEC))
    path = tmp_path / 'bare.yaml'
    path.write_text('based_on: fork\nmount: {kind: german}\n'
                    'incremental: {hour_angle: {mark_angle_deg: 90}}\n')
    bare = load_scenario(path)
    assert bare.mount == MountErrors(kind='german')
    assert bare.axes.elevation.travel_max == pytest.approx(270 * DEG)
    path.write_text('based_on: fork\nmount: {kind: alt-az, ia_arcsec: 2}\n')
    upright = load_scenario(path)
    assert upright.mount == MountErrors(ia=2 * ARCSEC)
    assert upright.axes.elevation.travel_max == pytest.approx(91 * DEG)
    # the same kind again changes nothing
    path.write_text('based_on: fork\nmount: {kind: horseshoe, ih_arcsec: 1}\n')
    assert load_scenario(path).mount.ie == fork.mount.ie
    assert wrap(load_scenario(path).mount.ia - ARCSEC) == 0.0


# ------------------------------------------------------- what bends and leans on such mounts

def german(latitude, n=600):
    """A German mount and stars above 20 degrees on the side that each is observed on."""
    mount = parse_mount('german', latitude)
    az, el, _ = sky(n, seed=3, lowest=20 * DEG)
    h, _ = mount.axes_of(az, el)
    return mount, h, *mount.on_travel(*mount.axes_of(az, el, h < 0.0))


def left(mount, latitude, first, second, kind='german', base=None, **parts):
    """Encoder - catalogue beyond what `base` has (x, y), arcsec, as the tube sees it."""
    both = []
    for more in (parts, {}):
        made = replace(base or MountErrors(kind=kind), **{k: v * ARCSEC for k, v in more.items()})
        frames = MountGeometry(made, latitude=latitude).frames(first, second)
        seen = np.einsum('nij,nj->ni', frames, mount.direction(first, second).T)
        both.append(seen[:, [0, 2]].T / ARCSEC)
    return both[0] - both[1]


def column(name, mount, first, second):
    from pointing_model.pointing_terms import Trig, terms_of
    return np.array([np.broadcast_to(v, first.shape) for v in terms_of(mount)[name].of(
        Trig(first, second, mount=mount))])


@pytest.mark.parametrize('latitude', LATITUDES)
@pytest.mark.parametrize('base', [None, 'german'])
def test_what_bends_by_its_weight_is_a_term_of_the_field(latitude, base):
    mount, _, first, second = german(latitude)
    base = base and load_scenario(base).mount
    where = (mount, latitude, first, second)
    # the arms point to the pole that is up: in the south that at -90 degrees
    across = np.cos(latitude) * np.sign(latitude)
    for name, size, sag in (('FO', -20.0 * across, {'fork_sag': 20.0}),
                            ('DAF', -20.0, {'declination_axis_sag': 20.0})):
        expected = size * column(name, mount, first, second)
        error = left(*where, base=base, **sag) - expected
        assert np.abs(error).max() < (0.02 if base else 0.001) * np.abs(expected).max()


def test_bending_by_hand():
    latitude = LATITUDES[0]
    mount = parse_mount('german', latitude)

    def up(first, second, **sag):
        """By how much the boresight is higher than its axes say, and farther west, arcsec."""
        made = MountErrors(kind='german', **{k: v * ARCSEC for k, v in sag.items()})
        step = (MountGeometry(made, latitude=latitude).boresight(first, second)[0]
                - mount.direction(first, second)) / ARCSEC
        return step[2], -step[0]

    # towards the meridian on the equator: the ends of the arms droop, so the tube between them
    # looks higher; six hours west the pull is in the plane of the fork
    assert up(0.0, 0.0, fork_sag=10.0)[0] == pytest.approx(
        10.0 * np.cos(latitude) * np.sin(latitude), abs=1e-3)
    assert np.hypot(*up(90 * DEG, 20 * DEG, fork_sag=10.0)) < 1e-9
    # the tube hangs in the east of its axis and droops: what looks up then looks east
    assert up(0.0, latitude, declination_axis_sag=10.0)[1] == pytest.approx(-10.0, abs=1e-3)
    # and in the west on the other side
    assert up(180 * DEG, 180 * DEG - latitude, declination_axis_sag=10.0)[1] == pytest.approx(
        10.0, abs=1e-3)
    # the axis upright: the pull is along it, and bends nothing
    mount = parse_mount('german', 0.0)
    bent = MountGeometry(MountErrors(kind='german', declination_axis_sag=10 * ARCSEC), latitude=0.0)
    apart = bent.boresight(90 * DEG, 30 * DEG)[0] - mount.direction(90 * DEG, 30 * DEG)
    assert np.linalg.norm(apart) < 1e-12


@pytest.mark.parametrize('latitude', LATITUDES)
@pytest.mark.parametrize('base', [None, 'german'])
@pytest.mark.parametrize('part, name', [('west', 'MA'), ('meridian', 'ME')])
@pytest.mark.parametrize('by', ['play', 'bending', 'flip'])
def test_the_counterweight_leans_the_axis_to_its_side(latitude, base, part, name, by):
    mount, h, first, second = german(latitude)
    side = np.where(np.cos(second) < 0.0, -1.0, 1.0)
    amount = {'flip': side, 'bending': np.cos(first), 'play': np.sign(np.cos(first))}[by]
    # less than six hours from the meridian the pull is by the side of the pier
    assert np.array_equal(amount[np.abs(h) < 90 * DEG] > 0.0, side[np.abs(h) < 90 * DEG] > 0.0)
    made = load_scenario(base).mount if base else MountErrors(kind='german')
    found = left(mount, latitude, first, second, base=replace(made, counterweight_by=by),
                 **{f'counterweight_{part}': 20.0})
    # where the pull turns over, the index moves the place
    clear = np.abs(np.cos(first)) > 0.005
    error = found - 20.0 * amount * column(name, mount, first, second)
    assert np.abs(error)[:, clear].max() < (0.4 if base else 0.01)


def test_a_level_fork_and_one_on_the_pole_of_the_earth():
    """Of an upright polar axis nothing pulls across; a level one feels all of it."""
    for latitude, factor in ((90 * DEG, 0.0), (0.0, 1.0)):
        mount = parse_mount('equatorial', latitude)
        first, second = np.array([0.3, -1.0]), np.array([0.5, 0.2])
        found = left(mount, latitude, first, second, kind='equatorial', fork_sag=10.0)
        np.testing.assert_allclose(found, [[0.0, 0.0], -10.0 * factor * np.cos(first)], atol=1e-3)


@pytest.mark.parametrize('kind', ['altaz', 'free:0,0'])
def test_a_mount_without_a_polar_axis_has_none_of_it(tmp_path, kind):
    path = tmp_path / 'bad.yaml'
    path.write_text(f'mount: {{kind: "{kind}", fork_sag_arcsec: 3}}\n')
    with pytest.raises(ValueError, match="'fork_sag_arcsec' is of another mount than this one"):
        load_scenario(path)


def test_an_encoder_on_the_worm_has_its_periodic_error():
    from encoder_sim.incremental import Incremental, IncrementalEncoder
    params = Incremental(worm_teeth=180, worm_1=8 * ARCSEC, worm_2=3 * ARCSEC, worm_phase=0.5,
                         mark_angle=0.0)
    angles = np.linspace(-0.1, 0.2, 4000)
    stamps = NIGHT * 10**9 + np.arange(len(angles)) * 10**7
    encoder = IncrementalEncoder(params, 1, 'hour_angle')
    error = encoder.feed(stamps, angles) - angles
    phase = 180 * angles
    expected = 8 * np.cos(phase - 0.5) + 3 * np.cos(2 * phase - 0.5)
    known = np.isfinite(error)
    assert known.mean() > 0.6
    # the mark zeroes what the worm shows there
    np.testing.assert_allclose(
        error[known] / ARCSEC, (expected - (8 + 3) * np.cos(0.5))[known], atol=0.15)
