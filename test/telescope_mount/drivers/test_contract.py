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

"""Drivers checked by what was recorded: all well, and one fault each."""

from dataclasses import replace

import numpy as np
import pytest

from msg_tools.power_on import PowerOn
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import ALTAZ, parse_mount
from telescope_mount.drivers.contract import check_contract
from telescope_mount.drivers.nudge import check_nudge, went_elsewhere
from telescope_mount.drivers.samples import NOTE, OK, WRONG, DriverSamples, Endpoint, Rest, Stream

NOW = 1_795_000_000.0
JOINTS = 'sensor_msgs/msg/JointState'
VECTOR = 'geometry_msgs/msg/Vector3Stamped'
TRAJECTORY = 'trajectory_msgs/msg/JointTrajectory'
KEYS = ('azimuth', 'elevation')
POWER_ON = PowerOn(2, 1_768_482_000.5)


def swings(t):
    """Both axes move, not together."""
    return np.array([3.0 + 0.1 * np.sin(0.4 * t), 0.7 + 0.08 * np.sin(0.23 * t)])


def velocity(t):
    return np.array([0.04 * np.cos(0.4 * t), 0.0184 * np.cos(0.23 * t)])


def recorded(seconds=20.0, rate=20.0, *, seed=1, inc=lambda t, v, r: (v, r), absolute=None,
          stamp=lambda name, t: NOW + t, keep=lambda name, t: True,
          miss=lambda number, m: m, names=KEYS, power_on=POWER_ON, where=swings, mount=ALTAZ,
          exposure=1.0):
    """A graph in which all is well, but for what is asked for."""
    rng = np.random.default_rng(seed)
    streams = [Stream('incremental/joint_states', JOINTS, [Endpoint('/mount/encoder', JOINTS)]),
               Stream('absolute/joint_states', JOINTS,
                      [Endpoint('/mount/absolute', JOINTS)] if absolute else []),
               Stream('camera/miss_distance', VECTOR, [Endpoint('/mount/camera', VECTOR)])]
    for i in range(int(seconds * rate)):
        t = i / rate
        late = 0.003 + 0.002 * rng.random()
        noisy = where(t) + rng.normal(0.0, 0.3 * ARCSEC, 2)
        if keep('inc', t):
            values, rates = inc(t, noisy, velocity(t) if where is swings else np.zeros(2))
            streams[0].take(NOW + t + late, stamp('inc', t), values, rates, names, power_on)
        if absolute:
            streams[1].take(NOW + t + late, stamp('abs', t),
                            absolute(where(t) + rng.normal(0.0, 0.3 * ARCSEC, 2)),
                            (np.nan, np.nan), names, power_on)
    for number in range(int(seconds / exposure)):
        t = (number + 0.5) * exposure
        if keep('cam', t):
            streams[2].take(NOW + t + exposure, stamp('cam', t),
                            miss(number, rng.normal(20.0, 2.0, 2) * ARCSEC))
    return DriverSamples(mount, seconds, *streams, services={'home'}, homing=True,
                 followers=[Endpoint('/mount/driver', TRAJECTORY)])


def wrong(found):
    return [f'{finding.of}: {finding.text}' for finding in found if finding.level == WRONG]


def only(found):
    text, = wrong(found)
    return text


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('rate', [8.0, 20.0, 100.0])
def test_where_all_is_well_nothing_is_wrong(seed, rate):
    good = recorded(seed=seed, rate=rate, absolute=lambda a: a - 0.001)
    assert {finding.level for finding in check_contract(good)} == {OK}


def test_what_is_optional_is_no_fault():
    bare = recorded(power_on=None, where=lambda t: np.array([3.0, 0.7]),
                 miss=lambda number, m: (np.nan, np.nan))
    assert wrong(check_contract(replace(bare, homing=False, services=set()))) == []


def test_readings_at_a_standstill_to_the_last_bit_are_no_fault():
    stands = recorded(inc=lambda t, v, r: ((3.0, 0.7), (0.0, 0.0)),
                   where=lambda t: np.array([3.0, 0.7]))
    assert wrong(check_contract(stands)) == []
    assert any('frozen' in finding.text for finding in check_contract(stands))


def test_an_azimuth_that_wraps_and_one_that_counts_turns_are_no_fault():
    through_north = recorded(inc=lambda t, v, r: ((wrap(v[0] + 0.14), v[1]), r))
    assert wrong(check_contract(through_north)) == []
    assert any('wraps' in finding.text for finding in check_contract(through_north))
    assert wrong(check_contract(recorded(inc=lambda t, v, r: ((v[0] + 2 * np.pi, v[1]), r)))) == []


def test_a_german_mount_reads_beyond_the_pole():
    mount = parse_mount('german', 0.6)
    beyond = recorded(mount=mount, names=mount.names.keys,
                   inc=lambda t, v, r: ((v[0], v[1] + 100.0 * DEG), r))
    assert wrong(check_contract(beyond)) == []


def test_simulated_time_may_tick_late():
    ticks = replace(recorded(), clock=True)
    for stream in (ticks.incremental, ticks.camera):
        stream.ages = [-0.1] * len(stream.stamps)
    assert wrong(check_contract(ticks)) == []
    # 0.3 s of a loaded machine are 1.5 s of a clock that goes five times as fast
    ticks.incremental.ages = [-1.5] * len(ticks.incremental.stamps)
    assert 'up to 1.500 s ahead' in wrong(check_contract(ticks))[0]
    assert wrong(check_contract(replace(ticks, clock_speed=5.0))) == []


# --- one fault each -------------------------------------------------------------------------------

ENC, ABS, CAM = 'incremental/joint_states', 'absolute/joint_states', 'camera/miss_distance'


def ends(name, *endpoints):
    def change(good):
        getattr(good, name).endpoints = list(endpoints)
        return good
    return change


def silent(good):
    good.incremental = Stream(ENC, JOINTS, good.incremental.endpoints)
    return good


def tracked(t):
    """At the rate of the sky."""
    return np.array([3.0, 0.7]) + 0.004 * DEG * t


def unreadable(good):
    good.incremental.refused = ['1 positions for 2 joints'] * 3
    return good


@pytest.mark.parametrize('change, words', [
    (ends('incremental'), f'{ENC}: nobody publishes it: start its driver'),
    (ends('camera'), f'{CAM}: nobody publishes it'),
    (ends('incremental', Endpoint('/mount/a', JOINTS), Endpoint('/mount/b', JOINTS)),
     f'{ENC}: published by /mount/a and /mount/b: end all but one'),
    (ends('camera', Endpoint('/mount/c', 'geometry_msgs/msg/Vector3')),
     f'{CAM}: /mount/c publishes geometry_msgs/msg/Vector3: it must be {VECTOR}'),
    (ends('incremental', Endpoint('/mount/e', JOINTS, reliable=False)),
     f'{ENC}: /mount/e publishes best effort: nothing passes'),
    (silent, f'{ENC}: /mount/encoder has sent nothing in 20 s'),
    (unreadable, f'{ENC}: 3 messages cannot be read: 1 positions for 2 joints'),
    (lambda good: replace(good, followers=[]), 'command: nobody follows it'),
    (lambda good: replace(good, nowhere='; there is no node at all in domain 3'),
     'graph: no driver was found; there is no node at all in domain 3'),
    (lambda good: replace(good, followers=[Endpoint('/mount/d', TRAJECTORY),
                                           Endpoint('/mount/other', TRAJECTORY)]),
     'command: /mount/d and /mount/other follow it: a mount has one driver'),
    (lambda good: replace(good, followers=[Endpoint('/mount/d', 'std_msgs/msg/String')]),
     f'command: /mount/d expects std_msgs/msg/String: it must be {TRAJECTORY}'),
    (lambda good: replace(good, followers=[Endpoint('/mount/d', TRAJECTORY, latched=True)]),
     'command: /mount/d asks for transient local'),
])
def test_a_fault_of_the_graph_is_named(change, words):
    assert only(check_contract(change(recorded()))).startswith(words)


def test_a_topic_of_another_namespace_is_named():
    lost = ends('incremental')(recorded())
    lost.elsewhere = ['/incremental/joint_states']
    assert 'there is /incremental/joint_states: another name or namespace' in only(
        check_contract(lost))


@pytest.mark.parametrize('changes, words', [
    ({'rate': 0.5}, f'{ENC}: 0.50 messages a second: slow'),
    ({'keep': lambda name, t: name == 'cam' or not 8.0 < t < 11.0},
     f'{ENC}: silent for 3.0 s, usually one every 0.05'),
    ({'stamp': lambda name, t: 0.0 if name == 'inc' else NOW + t},
     f'{ENC}: 400 of 400 stamps are not of this century'),
    ({'stamp': lambda name, t: t if name == 'cam' else NOW + t},
     f'{CAM}: 20 of 20 stamps are not of this century'),
    ({'stamp': lambda name, t: NOW + t + 2.0 * (name == 'inc')},
     f"{ENC}: stamps are up to 1.997 s ahead of this machine's clock"),
    ({'stamp': lambda name, t: NOW + t - 7.0 * (name == 'inc')},
     f"{ENC}: stamps are 7.00 s behind this machine's clock"),
    ({'stamp': lambda name, t: NOW + t - 3600.0 * (name == 'cam')},
     f"{CAM}: stamps are 3601.00 s behind this machine's clock"),
    ({'stamp': lambda name, t: NOW + (t - 0.3 * (round(20 * t) % 20 == 7) * (name == 'inc'))},
     f'{ENC}: 20 of 400 stamps are not after the one before'),
    ({'names': ('hour_angle', 'declination')},
     f'{ENC}: joints hour_angle, declination, and the mount has azimuth and elevation: another '
     'kind of mount?'),
    ({'names': ('az', 'alt')},
     f'{ENC}: joints az, alt, and the mount has azimuth and elevation: name them so'),
    ({'inc': lambda t, v, r: (v / DEG, r / DEG)}, 'these are no radians: degrees?'),
    ({'inc': lambda t, v, r: (v[::-1], r[::-1])},
     'axes exchanged, or a zenith distance?'),
    ({'inc': lambda t, v, r: (v / ARCSEC, r)}, 'these are no radians: counts or arcsec?'),
    ({'inc': lambda t, v, r: (v, r / DEG)},
     f'{ENC}: velocity is 57.3 times what the angle does: deg/s?'),
    ({'where': tracked, 'inc': lambda t, v, r: (v, (0.004, 0.004))},
     f'{ENC}: velocity is 57.3 times what the angle does: deg/s?'),
    ({'inc': lambda t, v, r: (v, -r)}, f'{ENC}: velocity has the other sign than the angle'),
    ({'where': tracked, 'inc': lambda t, v, r: (v, (-7e-5, -7e-5))},
     f'{ENC}: velocity has the other sign than the angle'),
    ({'where': tracked, 'inc': lambda t, v, r: (v, (14.4, 14.4))},
     f'{ENC}: velocity is 2.06e+05 times what the angle does: arcsec/s?'),
    ({'inc': lambda t, v, r: ((3.0, 0.7), r)},
     f'{ENC}: velocity not zero, but the angle does not change: frozen?'),
    ({'inc': lambda t, v, r: (v + 0.5 * (8.0 < t < 8.2), r)}, f'{ENC}: jumped by up to'),
    ({'inc': lambda t, v, r: ((np.nan, v[1]) if 8.0 < t < 9.02 else v, r)},
     f'{ENC}: no number in 20 of 400 readings, after it was homed'),
    ({'where': lambda t: np.array([3.0, 0.7]), 'rate': 50.0,
      'inc': lambda t, v, r: (np.round((v + 40 * (v - (3.0, 0.7))) / 5e-6) * 5e-6,
                              (np.nan, np.nan))},
     f'{ENC}: no velocity, and its noise over 0.02 s looks like motion'),
    ({'miss': lambda number, m: m / ARCSEC}, 'rad beside the boresight: arcsec or pixels'),
    ({'miss': lambda number, m: (1e-4, 2e-4)},
     f'{CAM}: the same miss distance in 20 exposures in a row'),
    ({'absolute': lambda a: a[::-1]}, f'{ABS}: '),
    ({'absolute': lambda a: a * (-1.0, 1.0)},
     f'{ABS}: azimuth runs the other way than the incremental encoder'),
    ({'absolute': lambda a: (a[0], 0.7)},
     f'{ABS}: elevation is frozen: the incremental encoder moved by'),
    ({'absolute': lambda a: (a[0], 0.5 * a[1])},
     f'{ABS}: elevation moves 0.5 times as far as the incremental encoder'),
])
def test_a_fault_of_an_instrument_is_named(changes, words):
    text = wrong(check_contract(recorded(**changes)))
    assert any(words in line for line in text), text
    # and one fault is no reason to complain of another instrument
    assert len({line.split(':')[0] for line in text}) == 1


def test_exchanged_axes_of_the_absolute_encoder_are_named():
    one = recorded(where=lambda t: np.array([1.0 + 0.1 * np.sin(0.4 * t), 0.7]),
                inc=lambda t, v, r: (v, (np.nan, np.nan)),
                absolute=lambda a: a[::-1])
    assert only(check_contract(one)) == (
        f'{ABS}: exchanged axes: it follows azimuth with its elevation')


def test_the_offset_of_the_absolute_encoder_is_told():
    found = check_contract(recorded(absolute=lambda a: a - np.array([100.0, -50.0]) * ARCSEC))
    text = next(f.text for f in found if f.text.startswith('incremental - absolute'))
    assert 'azimuth +100.' in text and 'elevation -50.' in text


def asked(found):
    return ' '.join(f'{f.of}: {f.text}' for f in found if f.level == NOTE)


def late(seconds, exposure=1.0):
    made = recorded(exposure=exposure)
    made.camera.ages = [seconds] * len(made.camera.stamps)
    return made


def test_exposures_that_come_late_or_at_once_are_asked_about():
    for seconds in (2.4, 0.001):
        assert 'is each stamp the middle of its exposure?' in asked(check_contract(late(seconds)))
    for good in (late(0.3), late(2.4, 2.0), replace(late(0.001), clock=True)):
        assert 'middle' not in asked(check_contract(good))


def test_a_frame_in_which_y_is_up_is_told():
    old = recorded()
    old.camera.frames = {''}
    assert "camera/miss_distance: frame_id '': y is taken as up" in asked(check_contract(old))
    old.camera.frames = {'boresight_optical'}
    assert 'frame_id' not in asked(check_contract(old))


def test_a_coarse_encoder_is_told():
    coarse = recorded(where=tracked, rate=50.0, inc=lambda t, v, r: (
        np.round(v / (20.0 * ARCSEC)) * 20.0 * ARCSEC, r))
    assert f'{ENC}: azimuth is read in steps of 20 arcsec' in asked(check_contract(coarse))
    assert wrong(check_contract(recorded(where=tracked))) == []


def test_an_axis_that_never_has_a_number_is_told():
    half = recorded(inc=lambda t, v, r: ((v[0], np.nan), r))
    assert f'{ENC}: no number of elevation in any reading' in asked(check_contract(half))


def test_a_wide_offset_in_degrees_is_asked_about():
    wide = recorded(miss=lambda number, m: m / DEG * 5)
    assert 'is that in radians?' in asked(check_contract(wide))


# --- nudged ---------------------------------------------------------------------------------------

STEP = 0.05 * DEG
HOME = np.array([3.0, 0.7])


def nudged(mount=lambda demand: demand, camera=lambda m: m, drift=(11.0, -6.0), seed=1,
           star=True, wanted=False):
    """Five rests; the star goes on with the sky while the mount stands."""
    rng = np.random.default_rng(seed)
    demands = [HOME + np.array(step) for step in (
        (0, 0), (STEP, 0), (0, 0), (0, STEP), (0, 0))]
    out = recorded(seconds=0.0)
    rests = []
    for number, demand in enumerate(demands):
        begin = NOW + 12.0 * number + 5.0
        here = HOME + mount(demand - HOME)
        for t in np.arange(0.0, 6.0, 0.1):
            out.incremental.take(begin + t, begin + t, here + rng.normal(0, 0.3 * ARCSEC, 2),
                                 (0.0, 0.0), KEYS)
        for t in np.arange(0.5, 6.0, 1.0):
            away = (here - HOME) * (np.cos(HOME[1]), 1.0)
            miss = (30.0, 20.0) * np.full(2, ARCSEC) - away + (
                np.array(drift) * ARCSEC * (begin + t - NOW)) + rng.normal(0, ARCSEC, 2)
            out.camera.take(begin + t, begin + t, camera(miss) if star else (np.nan, np.nan))
        rests.append(Rest(begin, begin + 6.0, demand))
    return check_nudge(out, rests, wanted)


@pytest.mark.parametrize('seed', range(5))
def test_a_mount_and_a_camera_as_they_should_be(seed):
    found = nudged(seed=seed)
    assert [finding.level for finding in found] == [OK] * 4


def turned(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


@pytest.mark.parametrize('changes, words', [
    ({'mount': lambda d: d[::-1]}, 'command: axes exchanged: elevation moved for azimuth'),
    ({'mount': lambda d: d * (-1, 1)}, 'command: azimuth went the other way'),
    ({'mount': lambda d: d * (1, 0)}, 'command: elevation did not move for a command of 0.05 deg'),
    ({'mount': lambda d: d * (1, 0.5)}, 'command: elevation moved 0.5 times as far as commanded'),
    ({'mount': lambda d: d + 60 * ARCSEC}, 'command: azimuth ended 60 arcsec from the demand'),
    ({'camera': lambda m: -m}, f'{CAM}: both signs are reversed: it must be star - boresight'),
    ({'camera': lambda m: m * (-1, 1)}, f'{CAM}: x has the other sign'),
    ({'camera': lambda m: m * (1, -1)}, f'{CAM}: y has the other sign'),
    ({'camera': lambda m: m[::-1]}, f'{CAM}: x and y are exchanged'),
    ({'camera': lambda m: turned(20 * DEG) @ m}, f'{CAM}: turned by 20.'),
    ({'camera': lambda m: m / ARCSEC}, 'arcsec for radians?'),
    ({'camera': lambda m: m / DEG}, 'deg for radians?'),
    ({'camera': lambda m: 1.2 * m}, f'{CAM}: scale 1.'),
    ({'camera': lambda m: 0 * m + 1e-5}, f'{CAM}: the star does not move with the mount'),
])
def test_what_a_nudge_shows(changes, words):
    text = wrong(nudged(**changes))
    assert any(words in line for line in text), text


def test_without_a_star_a_nudge_says_nothing_of_the_camera():
    found = nudged(star=False)
    assert wrong(found) == [] and 'camera not judged' in found[-1].text


def test_a_star_that_was_slewed_to_must_be_seen():
    text = only(nudged(star=False, wanted=True))
    assert 'the star is not in the field: check the site' in text
    assert wrong(nudged(wanted=True)) == []


def test_where_a_mount_went_that_was_stopped_while_it_was_nudged():
    begin = np.array([40.0, 60.0]) * DEG
    assert went_elsewhere(begin, begin + 0.05 * DEG, ALTAZ) == ''
    toward = went_elsewhere(begin, begin + np.array([4.0, -3.9]) * DEG, ALTAZ)
    assert 'azimuth by +4.0, elevation by -3.9 deg: toward where it is with the axes exch' in toward
    assert 'exchanged' not in went_elsewhere(begin, begin + np.array([3.0, 0.0]) * DEG, ALTAZ)
