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

"""Checks recorded data of a real mount's drivers against their contract."""

import numpy as np

from calibration.analysis.camera_faults import SAME_FRAMES
from msg_tools import convert, topics
from msg_tools.older_frames import is_y_up
from msg_tools.units import ARCSEC, DEG, wrap
from telescope_mount.observing.instruments import STILL

from .samples import NOTE, OK, WRONG, Remark, Remarks, wrong_unit

#: earlier stamps (before 2001) are not of the present, s
EPOCH = 1e9
#: least error of a clock ahead that is not a sample's jitter, s
AHEAD = 0.02
#: the same for simulated time, whose ticks are delayed, in seconds of this machine
AHEAD_CLOCK = 1.0
#: delay from which an encoder's sample, or an exposure, is stamped wrongly or useless, s
LATE, LATE_FRAME = 0.5, 30.0
#: rates in readings per second below which an encoder is slow, and useless
SLOW, USELESS = 5.0, 1.0
#: least silence that is a gap, s, and in units of the usual period
GAP, PERIODS = 0.5, 5.0
#: rate that no telescope exceeds, rad/s
FASTEST = 60.0 * DEG
#: miss distances that no camera measures, and that few do, rad
BEYOND_FIELD, WIDE_FIELD = 0.1, 0.02
#: distance needed to judge velocities, and encoder step that is reported, rad
SOME_WAY, COARSE = 60.0 * ARCSEC, 5.0 * ARCSEC
#: delay of exposures in units of their interval that is reported, and shortest possible delay, s
PIPELINE, FASTEST_IMAGE = 1.5, 0.005
#: motion needed to compare two encoders, rad
MOVED = 0.2 * DEG


def check_contract(samples):
    """Remarks on what is right and what is wrong.

    Parameters
    ----------
    samples : DriverSamples

    Returns
    -------
    list of Remark
    """
    out = []
    if samples.nowhere:
        out.append(Remark(WRONG, 'graph', f'no driver was found{samples.nowhere}'))
    if samples.clock:
        out.append(Remark(NOTE, '/clock', 'is published: the graph runs on simulated time; with a '
                          'real mount nobody may publish it'))
    incremental = Remarks(samples.incremental.topic)
    if counts := _stream(incremental, samples, samples.incremental, slow=SLOW, late=LATE):
        _encoder(incremental, samples, samples.incremental)
    absolute = Remarks(samples.absolute.topic)
    if not samples.absolute.endpoints:
        absolute.note('nobody publishes it: for a mount without an absolute encoder '
                      '(absolute_encoder: false of star_observer)')
    elif _stream(absolute, samples, samples.absolute, slow=SLOW, late=LATE):
        _encoder(absolute, samples, samples.absolute)
        if counts:
            _together(absolute, samples)
    camera = Remarks(samples.camera.topic)
    if _stream(camera, samples, samples.camera, slow=0.0, late=LATE_FRAME):
        _camera(camera, samples.camera, samples.clock)
    home = Remark(OK, 'home', 'is offered') if 'home' in samples.services else (
        Remark(NOTE, 'home', 'no such service: leave the step home out of plans'))
    return [*out, *incremental, *absolute, *camera, *_commands(samples), home]


# --- any topic ------------------------------------------------------------------------------------


def _stream(out, samples, stream, slow, late):
    """Check publishers, rate, gaps and stamps; return whether there are messages to check."""
    ends = stream.endpoints
    if not ends:
        tail = '/' + stream.topic.rsplit('/', 1)[-1]
        near = [name for name in samples.elsewhere if name.endswith(tail)]
        out.wrong('nobody publishes it' + (
            f'; there is {", ".join(near)}: another name or namespace (-r __ns:=/mount)' if near
            else ': start its driver, in the namespace and ROS domain of this command'))
        return False
    names = ' and '.join(sorted(end.node for end in ends))
    if len(ends) > 1:
        out.wrong(f'published by {names}: end all but one')
    usable = True
    for end in ends:
        if end.type != stream.type:
            out.wrong(f'{end.node} publishes {end.type}: it must be {stream.type}')
            usable = False
        elif not end.reliable:
            out.wrong(f'{end.node} publishes best effort: nothing passes; publish reliable (a '
                      'queue depth in place of qos_profile_sensor_data)')
            usable = False
    for reason in sorted(set(stream.refused)):
        out.wrong(f'{stream.refused.count(reason)} messages cannot be read: {reason}')
    if not stream.stamps:
        if usable and not stream.refused:
            out.wrong(f'{names} has sent nothing in {samples.seconds:.0f} s')
        return False
    if usable and len(ends) == 1:
        out.ok(f'one publisher, {names}; type and quality of service fit')
    _rate(out, samples, stream, slow)
    _stamps(out, stream, late,
            AHEAD_CLOCK * max(samples.clock_speed, 1.0) if samples.clock else AHEAD)
    return True


def _rate(out, samples, stream, slow):
    arrived, grave = np.array(stream.arrived), WRONG if slow else NOTE
    if len(arrived) < 3:
        out.add(grave, f'{len(arrived)} messages in {samples.seconds:.0f} s')
        return
    steps = np.diff(arrived)
    rate = (len(arrived) - 1) / (arrived[-1] - arrived[0])
    if rate < slow:
        out.add(WRONG if rate < USELESS else NOTE, f'{rate:.2f} messages a second: slow; 10 or '
                'more keep readings close to each exposure')
    else:
        out.ok(f'{rate:.4g} messages a second')
    usual, longest = float(np.median(steps)), float(steps.max())
    if longest > max(GAP, PERIODS * usual):
        out.add(grave, f'silent for {longest:.1f} s, usually one every {usual:.3g} s')


def _stamps(out, stream, late, ahead):
    stamps = np.array(stream.stamps)
    zero = np.count_nonzero(stamps < EPOCH)
    if zero:
        out.wrong(f'{zero} of {len(stamps)} stamps are not of this century: fill header.stamp '
                  'with the time of the measurement, UTC')
        return
    back = np.count_nonzero(np.diff(stamps) <= 0.0)
    if back:
        out.wrong(f'{back} of {len(stamps)} stamps are not after the one before: two sources, or '
                  'the stamp is not the time of the measurement')
    age = np.array(stream.ages)
    youngest, usual = float(age.min()), float(np.median(age))
    if youngest < -ahead:
        out.wrong(f"stamps are up to {-youngest:.3f} s ahead of this machine's clock: set both "
                  'by NTP; 1 s is 15 arcsec of hour angle')
    elif usual > late:
        out.wrong(f"stamps are {usual:.2f} s behind this machine's clock: another clock, or the "
                  'driver stamps or sends late')
    else:
        out.ok(f'stamps are {1e3 * usual:.0f} ms before they arrive (at least '
               f'{1e3 * youngest:.0f} ms)')


# --- encoders -------------------------------------------------------------------------------------


def _encoder(out, samples, stream):
    wanted = samples.mount.names.keys
    for found in sorted(set(stream.names)):
        if set(wanted) <= set(found):
            continue
        other = any(set(pair) <= set(found) for pair in convert.JOINTS.values())
        out.wrong(f'joints {", ".join(found) or "without names"}, and the mount has '
                  f'{" and ".join(wanted)}: ' + (
                      'another kind of mount? (--mount here, parameter mount of star_observer)'
                      if other else 'name them so'))
        return
    stamps, values, rates = stream.arrays()
    known = np.isfinite(values).all(axis=1)
    if not known.any():
        without = [name for name, axis in zip(samples.mount.names.axes, values.T)
                   if not np.isfinite(axis).any()]
        out.note(f'no number of {" and ".join(without) or "both axes"} in any reading: not homed '
                 'yet? (call home)')
        return
    later = known[int(np.argmax(known)):]
    if not later.all():
        out.wrong(f'no number in {np.count_nonzero(~later)} of {len(known)} readings, after it '
                  'was homed')
    if not _units(out, samples, values[known]):
        return
    pointed = stream is samples.incremental
    _motion(out, stamps[known], values[known], rates[known], pointed)
    if pointed:
        powered = None not in stream.power_ons
        power = 'the power-on is known' if powered else (
            'no incremental/power_on: each homing counts as one')
        homing = 'incremental/homing is published' if samples.homing else (
            'no incremental/homing: its marks cannot be judged')
        out.add(OK if powered and samples.homing else NOTE, f'{power}; {homing}')


def _units(out, samples, values):
    first, second = np.abs(values).max(axis=0)
    # a German mount points through the pole; any mount may count several turns, but not many
    highest = (np.pi / 2 if samples.mount.vertical else 1.5 * np.pi) + 5.0 * DEG
    if second <= highest and first <= 6.0 * np.pi:
        middle = np.degrees(values[-1])
        out.ok(f'reads {middle[0]:.2f} and {middle[1]:.2f} deg: can be')
        for name, axis in zip(samples.mount.names.axes, values.T):
            codes = np.unique(axis)
            step = np.diff(codes).min() if 1 < len(codes) < len(axis) / 3 else 0.0
            if step > COARSE:
                out.note(f'{name} is read in steps of {step / ARCSEC:.0f} arcsec: a coarse '
                         'encoder, or one read less often than it is published')
        return True
    why = 'axes exchanged, or a zenith distance?'
    if first > highest or second > 2.0 * np.pi:
        why = 'these are no radians: ' + (
            'degrees? (multiply by pi/180)' if second <= 280.0 and first <= 1100.0 else
            'counts or arcsec?')
    out.wrong(f'reads {values[-1][0]:.6g} and {values[-1][1]:.6g}: {why}')
    return False


def _motion(out, stamps, values, rates, pointed):
    """Check jumps, wrapping, velocities, rest (of the `pointed` encoder), and frozen readings."""
    if len(stamps) < 3:
        return
    step, passed = np.diff(values, axis=0), np.diff(stamps)[:, None]
    turn = (np.abs(np.abs(step) - 2.0 * np.pi) < 10.0 * DEG) & np.array([True, False])
    way = np.where(turn, wrap(step), step)
    if (np.abs(way) > FASTEST * passed + 5.0 * DEG).any():
        worst = np.degrees(np.abs(way).max())
        out.wrong(f'jumped by up to {worst:.1f} deg between two readings: two sources, counts '
                  'lost, or a wrong unit now and then')
        return
    if turn.any():
        out.note('wraps: it jumped by a turn; where a cable counts, count turns on, and commands '
                 'do too')
    _velocity(out, way, passed, rates)
    speed = np.abs(way / passed).max(axis=1)
    rest = speed[speed <= 10.0 * STILL]
    if pointed and not np.isfinite(rates[1:]).any() and len(rest) > 20 and (
            np.mean(rest > STILL) > 0.5):
        out.wrong(f'no velocity, and its noise over {float(np.median(passed)):.3g} s '
                  'looks like motion: home never sees it at rest; fill velocity')
    if not way.any():
        out.note('exactly constant: at rest, or frozen (move the mount, or use --nudge)')


def _velocity(out, way, passed, rates):
    """Compare the integral of the velocities with the angle over all readings."""
    between = 0.5 * (rates[1:] + rates[:-1])
    known = np.isfinite(between)
    angle, added = (np.cumsum(np.where(known, of, 0.0), axis=0) for of in (way, between * passed))
    for a, v in zip((angle - angle.mean(axis=0)).T, added.T):
        slow, moved = STILL * passed.sum(), np.ptp(a)
        if moved < SOME_WAY:
            if np.ptp(v) > slow + MOVED:
                out.wrong('velocity not zero, but the angle does not change: frozen?')
            continue
        ratio = float(a @ v / (a @ a))
        if not 0.5 < ratio < 2.0:
            out.add(NOTE if abs(ratio) < 0.5 and moved < slow else WRONG,
                    'velocity has the other sign than the angle' if ratio < -0.5 else
                    f'velocity is {ratio:.3g} times what the angle does: '
                    f'{wrong_unit(ratio, "{}/s? ")}it must be rad/s')
            return


def _together(out, samples):
    """Compare the absolute encoder with the incremental one."""
    stamps, values, _ = samples.absolute.arrays()
    at, first, _ = samples.incremental.arrays()
    good = np.isfinite(first).all(axis=1)
    at, first = at[good], first[good]
    inside = (stamps >= at[0]) & (stamps <= at[-1]) if len(at) > 1 else np.zeros(len(stamps), bool)
    inside &= np.isfinite(values).all(axis=1)
    if inside.sum() < 3:
        return
    stamps, second = stamps[inside], values[inside]
    turned = np.unwrap(first[:, 0])
    a = np.column_stack([np.interp(stamps, at, turned), np.interp(stamps, at, first[:, 1])])
    b = np.column_stack([np.unwrap(second[:, 0]), second[:, 1]])
    moved = np.ptp(a, axis=0)
    names = samples.mount.names.axes
    before = len(out)
    for axis in (0, 1):
        if moved[axis] < MOVED:
            continue
        # use only changes of that axis, while the other moves less
        x = a[:, axis] - a[:, axis].mean()
        slope = [float(x @ (b[:, k] - b[:, k].mean()) / (x @ x)) for k in (0, 1)]
        own, other = slope[axis], slope[1 - axis]
        lone = moved[1 - axis] < 0.3 * moved[axis]
        if lone and abs(own) < 0.2 and abs(other) > 0.5:
            out.wrong(f'exchanged axes: it follows {names[axis]} with its {names[1 - axis]}')
        elif abs(own + 1.0) < 0.2:
            out.wrong(f'{names[axis]} runs the other way than the incremental encoder')
        elif abs(own) < 0.05 and np.ptp(b[:, axis]) < 0.05 * moved[axis]:
            out.wrong(f'{names[axis]} is frozen: the incremental encoder moved by '
                      f'{moved[axis] / DEG:.2f} deg')
        elif abs(own - 1.0) > 0.1:
            out.wrong(f'{names[axis]} moves {own:.3g} times as far as the incremental encoder')
    if len(out) > before:
        return
    difference = np.column_stack([wrap(a[:, 0] - b[:, 0]), a[:, 1] - b[:, 1]])
    middle, scatter = np.median(difference, axis=0), difference.std(axis=0)
    both = ', '.join(f'{names[k]} {middle[k] / ARCSEC:+.1f} +- {scatter[k] / ARCSEC:.1f} arcsec'
                     for k in (0, 1))
    out.add(NOTE if np.abs(middle).max() > 5.0 * DEG else OK, f'incremental - absolute: {both}')


# --- camera and mount -----------------------------------------------------------------------------


def _camera(out, stream, simulated):
    for frame in sorted(filter(is_y_up, stream.frames)):
        out.note(f'frame_id {frame!r}: y is taken as up, as of older drivers; y down has '
                 f'{convert.OPTICAL_FRAME}')
    age = float(np.median(stream.ages))
    interval = float(np.median(np.diff(stream.stamps or [0, 0])))
    at_once = age < FASTEST_IMAGE < 0.05 * interval and not simulated
    if age > PIPELINE * interval > 0.0 or at_once:
        out.note(f'stamps are {age:.3g} s before they arrive, exposures {interval:.3g} s apart: is '
                 'each stamp the middle of its exposure? The step clocks measures it')
    values = np.array(stream.values, float).reshape(-1, 2)
    stars = values[np.isfinite(values).all(axis=1)]
    if not len(stars):
        out.note(f'no star in any of {len(values)} exposures: point at one to have the camera '
                 'judged')
        return
    far = float(np.median(np.hypot(*stars.T)))
    if far > BEYOND_FIELD:
        out.wrong(f'stars {far:.3g} rad beside the boresight: arcsec or pixels for radians?')
    elif far > WIDE_FIELD:
        out.note(f'stars {far / DEG:.2f} deg beside the boresight: is that in radians?')
    else:
        out.ok(f'a star in {len(stars)} of {len(values)} exposures, {far / ARCSEC:.1f} arcsec '
               'beside the boresight')
    same = longest = 1
    for before, now in zip(stars, stars[1:]):
        same = same + 1 if (before == now).all() else 1
        longest = max(longest, same)
    if longest >= SAME_FRAMES:
        out.wrong(f'the same miss distance in {longest} exposures in a row: it measures nothing')


def _commands(samples):
    out = Remarks('command')
    if not samples.followers:
        out.wrong('nobody follows it: start the driver of the mount, in the namespace and ROS '
                  'domain of this command')
    names = sorted({end.node for end in samples.followers})
    if len(names) > 1:
        out.wrong(f'{" and ".join(names)} follow it: a mount has one driver; end all but one')
    for end in samples.followers:
        if end.type != topics.COMMAND.type:
            out.wrong(f'{end.node} expects {end.type}: it must be {topics.COMMAND.type}')
        elif end.latched:
            out.wrong(f'{end.node} asks for transient local: nothing passes; subscribe volatile')
        else:
            out.ok(f'{end.node} follows it')
    return out
