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

"""The rotations of every mount against another geometry: quaternions about axes in the horizon."""

import numpy as np
import pytest
from exact_rotations import offsets_and_jacobian
from scipy.spatial.transform import Rotation

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model import geometry
from pointing_model.mount_kinds import KINDS
from pointing_model.mounts import (
    ALTAZ,
    Mount,
    is_beyond,
    mount_text,
    parse_mount,
    through_pole,
)

MOUNTS = {
    'altaz': ALTAZ, 'fork': Mount.equatorial(33.36 * DEG),
    'german': Mount.equatorial(31.05 * DEG, 'german'), 'south': Mount.equatorial(-30.2 * DEG),
    'equator': Mount.equatorial(0.0), 'alt-alt': Mount.free(0.0, 0.0),
    'free': Mount.free(123.0 * DEG, 40.0 * DEG, 200.0 * DEG)}
#: a tenth of a degree from the pole the mount can look where its own pole is nearer than 150"
SIZES = np.array([150, -90, 60, -80, 70, -60, 120]) * ARCSEC


def large(mount):
    return dict(zip(mount.names.physical, SIZES))


def places(n, nearest, seed=1, beyond=True):
    """Axis angles on both sides, a third of them within 1 deg of `nearest` to the pole."""
    rng = np.random.default_rng(seed)
    first, distance = rng.uniform(-3.1, 3.1, n), rng.uniform(0.02, 2.0, n)
    distance[::3] = rng.uniform(nearest, nearest + DEG, len(distance[::3]))
    return through_pole(first, np.pi / 2 - distance, beyond & (rng.random(n) < 0.5))


def looks_at(mount, first, second, terms):
    """Where a mount with errors looks, east north up: by turning each part about its axis.

    Parameters
    ----------
    first, second : float
        Readings of its axes less their zeros.
    terms : dict of str to float
        By the names of an alt-azimuth mount.
    """
    x, y, z = np.array(mount.frame)
    # a lean of the pole toward y by AN, away from x by AW
    lean = Rotation.from_rotvec(-terms['AN'] * x - terms['AW'] * y)
    skew = Rotation.from_rotvec(-terms['NPAE'] * y)
    turn = lean * Rotation.from_rotvec(-first * z) * skew * Rotation.from_rotvec(second * x)
    return turn.apply(Rotation.from_rotvec(terms['CA'] * z).apply(y))


def arcsec_between(one, other):
    return np.linalg.norm(np.asarray(one) - other, axis=0) / ARCSEC


@pytest.mark.parametrize('name', MOUNTS)
def test_the_mount_looks_at_the_star_by_quaternions(name):
    mount = MOUNTS[name]
    names = mount.names
    first, second = places(300, 0.1 * DEG, beyond=not mount.vertical)
    terms = {**large(mount), 'TF': 0.0}
    reading = geometry.sky_to_encoder(first, second, terms, mount)
    own = {of: sign * terms[n] for n, (of, sign) in names.terms.items()}
    star = mount.direction(first, second).T
    for i in range(len(first)):
        seen = looks_at(mount, reading[0][i] - own['IA'], reading[1][i] - own['IE'], own)
        assert arcsec_between(seen, star[i]) < 1e-6
    # on the side that was asked for: on the way to the pole or past it
    assert (is_beyond(reading[1] - own['IE']) == is_beyond(second)).all()


@pytest.mark.parametrize('name', [n for n in MOUNTS if n != 'altaz'])
def test_flexure_lifts_the_star_toward_the_zenith_by_quaternions(name):
    mount = MOUNTS[name]
    first, second = places(300, 0.1 * DEG)
    size = 200 * ARCSEC
    reading = geometry.sky_to_encoder(first, second, {'TF': size}, mount)
    star, tube = mount.direction(first, second).T, mount.direction(*reading).T
    for s, t in zip(star, tube):
        axis = np.cross(s, [0.0, 0.0, 1.0])  # its length is cos E
        assert arcsec_between(Rotation.from_rotvec(size * axis).apply(s), t) < 1e-6


@pytest.mark.parametrize('name', MOUNTS)
def test_both_ways_to_a_tenth_of_a_degree_from_the_pole(name):
    mount = MOUNTS[name]
    first, second = places(2000, 0.1 * DEG, seed=2, beyond=not mount.vertical)
    back = geometry.encoder_to_sky(
        *geometry.sky_to_encoder(first, second, large(mount), mount), large(mount), mount=mount)
    assert np.hypot(wrap(back[0] - first) * np.cos(second),
                    wrap(back[1] - second)).max() / ARCSEC < 1e-6


@pytest.mark.parametrize('name', MOUNTS)
def test_horizon_and_axes_both_ways(name):
    mount = MOUNTS[name]
    first, second = places(200, 0.1 * DEG, seed=3, beyond=not mount.vertical)
    az, el = mount.horizon_of(first, second)
    east, north, up = mount.direction(first, second)
    assert arcsec_between([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)],
                          [east, north, up]).max() < 1e-6
    again = mount.axes_of(az, el, is_beyond(second))
    assert np.hypot(wrap(again[0] - first) * np.cos(second),
                    wrap(again[1] - second)).max() / ARCSEC < 1e-6


def test_hour_angle_and_declination_are_what_astronomers_say():
    mount = Mount.equatorial(40.0 * DEG)
    # the meridian at the equator is south, 50 degrees high; hour angle +6 h is due west
    az, el = mount.horizon_of(np.array([0.0, np.pi / 2]), np.zeros(2))
    np.testing.assert_allclose(az / DEG, [180.0, 270.0], atol=1e-9)
    np.testing.assert_allclose(el / DEG, [50.0, 0.0], atol=1e-9)
    # a star that culminates north of the zenith is at hour angle 0, and the pole due north
    first, second = mount.axes_of(0.0, 80.0 * DEG)
    assert abs(first) < 1e-12 and second / DEG == pytest.approx(50.0)
    assert mount.horizon_of(1.0, np.pi / 2)[1] / DEG == pytest.approx(40.0)
    assert mount.latitude / DEG == pytest.approx(40.0)


@pytest.mark.parametrize('kind', ['equatorial', 'german'])
def test_what_changes_sign_with_the_side_of_the_pier(kind):
    """On the sky ID, CH and NP do, IH, MA, ME and TF do not (TPOINT; Wallace)."""
    mount = Mount.equatorial(31.0 * DEG, kind)
    rng = np.random.default_rng(4)
    first, second = rng.uniform(-3.0, 3.0, 50), rng.uniform(-0.9, 1.4, 50)
    beyond = through_pole(first, second, True)
    for name in mount.names.physical:
        one = np.array(geometry.offsets(first, second, {name: ARCSEC}, mount))
        # the tangents are reversed there
        other = -np.array(geometry.offsets(*beyond, {name: ARCSEC}, mount))
        sign = -1.0 if name in ('ID', 'CH', 'NP') else 1.0
        np.testing.assert_allclose(other, sign * one, atol=1e-4 * ARCSEC)


def test_an_alt_alt_mount_has_its_pole_on_the_horizon():
    mount = Mount.free(0.0, 0.0)
    # angles 0, 0 at the zenith; the first axis lies north to south and turns it to the west
    assert mount.horizon_of(0.0, 0.0)[1] / DEG == pytest.approx(90.0)
    az, el = mount.horizon_of(0.3, 0.0)
    assert el == pytest.approx(np.pi / 2 - 0.3)
    assert az / DEG == pytest.approx(270.0)
    az, el = mount.horizon_of(0.0, 0.3)
    assert el == pytest.approx(np.pi / 2 - 0.3) and np.cos(az) == pytest.approx(1.0)


def test_an_xy_mount_lies_to_the_north_or_as_it_is_told():
    mount = parse_mount('xy')
    assert parse_mount('alt-alt').agrees(mount) and mount_text(mount) == 'xy'
    assert Mount.free(0.0, 0.0).frame == mount.frame
    first, second = mount.axes_of(0.0, 5.0 * DEG)  # its keyhole: low in the north
    assert second / DEG == pytest.approx(85.0)
    east = parse_mount('xy:90')
    assert parse_mount(mount_text(east)).agrees(east) and not east.agrees(mount)
    assert east.axes_of(90.0 * DEG, 5.0 * DEG)[1] / DEG == pytest.approx(85.0)
    with pytest.raises(ValueError, match='give the azimuth of its first axis as xy:AZ'):
        parse_mount('xy:north')


def test_terms_of_an_xy_mount_lean_its_axis_as_they_say():
    """XE lifts the north end of the X axis, XA turns it to the east."""
    mount, size = parse_mount('xy'), 100.0 * ARCSEC
    for name, pole in (('XE', (0.0, size)), ('XA', (size, 0.0))):
        leaning = Mount._with_pole('xy', *pole)
        places = np.array([0.3, 2.0, 4.0]), np.array([0.5, 0.9, 0.7])
        true = np.array(leaning.axes_of(*places))
        first, second = mount.axes_of(*places)
        x, y = geometry.offsets(first, second, {name: size}, mount)
        np.testing.assert_allclose(true[1] - second, y, atol=0.2 * ARCSEC)
        np.testing.assert_allclose((true[0] - first) * np.cos(second), x, atol=0.2 * ARCSEC)


@pytest.mark.parametrize('name', [n for n in MOUNTS if n != 'altaz'])
def test_jacobian_by_differences(name):
    mount = MOUNTS[name]
    first, second = places(200, 5.0 * DEG, seed=5)
    terms = large(mount)
    x, y, jacobian = offsets_and_jacobian(first, second, terms, list(terms), mount)
    np.testing.assert_allclose(geometry.offsets(first, second, terms, mount), (x, y), atol=1e-13)
    far = np.abs(np.cos(second)) > np.sin(10.0 * DEG)
    for term in terms:
        plus, minus = (geometry.offsets(first, second, {**terms, term: terms[term] + s * 1e-6},
                                        mount) for s in (1, -1))
        for axis in (0, 1):
            difference = (plus[axis] - minus[axis]) / 2e-6
            found = np.broadcast_to(jacobian[term][axis], first.shape)
            # that of the flexure is of first order
            atol = 2e-2 if term == 'TF' else 5e-6
            np.testing.assert_allclose(found[far], difference[far], atol=atol)


def test_kinds_by_name():
    assert parse_mount('fork', 0.5).kind == 'equatorial'
    assert parse_mount('gem', 0.5).two_sided
    assert parse_mount('free:0,0') == Mount.free(0.0, 0.0)
    assert parse_mount('AltAz') is ALTAZ
    with pytest.raises(ValueError, match='latitude'):
        parse_mount('german')
    for text in ('dobson', 'free', 'free:1', 'free:0,nan'):
        with pytest.raises(ValueError, match='mount'):
            parse_mount(text)


def test_a_frame_must_be_a_rotation():
    with pytest.raises(ValueError, match='no rotation'):
        Mount('free', ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)))
    with pytest.raises(ValueError, match='dobson'):
        Mount('dobson')


def test_every_kind_names_seven_rotations():
    for names in KINDS.values():
        assert len(names.physical) == 7 and len(names.standard6) == 6
        assert {names.named(own) for own, _ in names.terms.values()} == set(names.physical)


def test_the_numbers_of_kinds_in_messages_stay():
    # logs have them: one more stands last
    assert list(KINDS)[:5] == ['altaz', 'equatorial', 'german', 'free', 'xy']


def test_the_axes_of_a_german_mount_turn_about_the_pole():
    mount = Mount.equatorial(0.6, 'german')
    first, second = mount.axes_of(*mount.horizon_of(-1.0, -0.3), beyond=True)
    first, second = mount.on_travel(first, second)
    # through the pole: half a turn on, and beyond it; nothing jumps at 180 degrees
    np.testing.assert_allclose([first, second], [np.pi - 1.0, np.pi + 0.3])
    np.testing.assert_allclose(Mount.equatorial(0.6).on_travel(3.5, -0.3), [3.5 - 2 * np.pi, -0.3])


def test_the_joints_of_every_mount_have_names():
    pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)
    from msg_tools.convert import JOINTS
    assert {name: kind.keys for name, kind in KINDS.items()} == JOINTS


def test_a_latitude_that_was_rounded_is_the_same_mount():
    one = Mount.equatorial(31.05 * DEG, 'german')
    other = Mount.equatorial(one.latitude + 1e-15, 'german')
    assert other != one and other.agrees(one) and one.agrees(other)
    assert not Mount.equatorial(31.05001 * DEG, 'german').agrees(one)
    assert not Mount.equatorial(31.05 * DEG).agrees(one)
