"""What drivers of a real mount do right and wrong, judged by what was heard of them."""

import numpy as np

from msg_tools import convert
from msg_tools.power_on import read_frame
from msg_tools.units import ARCSEC, DEG, wrap
from telescope_mount.observing.instrument_health import SAME_FRAMES
from telescope_mount.observing.instruments import STILL

from .samples import NOTE, OK, WRONG, Remark

#: a stamp before that (2001) is none of now, s
EPOCH = 1e9
#: a clock ahead by more is wrong by more than a sample's jitter, s
AHEAD = 0.02
#: of simulated time, whose ticks come late: so many seconds of this machine, s
AHEAD_CLOCK = 1.0
#: an encoder's sample that comes so late is stamped wrongly or useless, an exposure's, s
LATE, LATE_FRAME = 0.5, 30.0
#: readings a second below which an encoder is slow, and useless
SLOW, USELESS = 5.0, 1.0
#: silence that is a gap: so long, and so many of its own periods, s
GAP, PERIODS = 0.5, 5.0
#: faster than that no telescope turns, rad/s
FASTEST = 60.0 * DEG
#: a miss distance that no camera measures, and one that few do, rad
BEYOND_FIELD, WIDE_FIELD = 0.1, 0.02
#: a move that shows how two encoders go together, rad
MOVED = 0.2 * DEG


def judge(heard):
    """What is right and what is wrong.

    Parameters
    ----------
    heard : Heard

    Returns
    -------
    list of Remark
    """
    out = []
    if heard.nowhere:
        out.append(Remark(WRONG, 'graph', f'no driver was found{heard.nowhere}'))
    if heard.clock:
        out.append(Remark(NOTE, '/clock', 'is published: the graph runs on simulated time; with '
                           'a real mount nobody may publish it'))
    encoder = _stream(out, heard, heard.incremental, slow=SLOW, late=LATE)
    if encoder:
        _encoder(out, heard, heard.incremental)
    if heard.absolute.endpoints:
        if _stream(out, heard, heard.absolute, slow=SLOW, late=LATE):
            _encoder(out, heard, heard.absolute)
            if encoder:
                _together(out, heard)
    else:
        out.append(Remark(NOTE, heard.absolute.topic, 'nobody publishes it: for a mount without '
                           'an absolute encoder (absolute_encoder: false of star_observer)'))
    if _stream(out, heard, heard.camera, slow=0.0, late=LATE_FRAME):
        _camera(out, heard.camera)
    _commands(out, heard)
    return out


# --- any topic ------------------------------------------------------------------------------------


def _stream(out, heard, stream, slow, late):
    """Publishers, rate, gaps, stamps; whether there are messages to look at further."""
    of, ends = stream.topic, stream.endpoints
    if not ends:
        near = [name for name in heard.elsewhere if name.endswith('/' + of.rsplit('/', 1)[-1])]
        out.append(Remark(WRONG, of, 'nobody publishes it' + (
            f'; there is {", ".join(near)}: another name or namespace (-r __ns:=/mount)' if near
            else ': start its driver, in the namespace and ROS domain of this command')))
        return False
    names = ' and '.join(sorted(end.node for end in ends))
    if len(ends) > 1:
        out.append(Remark(WRONG, of, f'published by {names}: end all but one'))
    usable = True
    for end in ends:
        if end.type != stream.type:
            out.append(Remark(WRONG, of, f'{end.node} publishes {end.type}: it must be '
                               f'{stream.type}'))
            usable = False
        elif not end.reliable:
            out.append(Remark(WRONG, of, f'{end.node} publishes best effort: nothing passes; '
                               'publish reliable (a queue depth in place of '
                               'qos_profile_sensor_data)'))
            usable = False
    for reason in sorted(set(stream.refused)):
        out.append(Remark(WRONG, of, f'{stream.refused.count(reason)} messages cannot be read: '
                           f'{reason}'))
    count = len(stream.stamps)
    if not count:
        if usable and not stream.refused:
            out.append(Remark(WRONG, of, f'{names} has sent nothing in {heard.seconds:.0f} s'))
        return False
    if usable and len(ends) == 1:
        out.append(Remark(OK, of, f'one publisher, {names}; type and quality of service fit'))
    _rate(out, heard, stream, slow)
    _stamps(out, stream, late,
            AHEAD_CLOCK * max(heard.clock_speed, 1.0) if heard.clock else AHEAD)
    return True


def _rate(out, heard, stream, slow):
    of, arrived = stream.topic, np.array(stream.arrived)
    if len(arrived) < 3:
        out.append(Remark(WRONG if slow else NOTE, of, f'{len(arrived)} messages in '
                           f'{heard.seconds:.0f} s'))
        return
    steps = np.diff(arrived)
    rate = (len(arrived) - 1) / (arrived[-1] - arrived[0])
    if rate < slow:
        out.append(Remark(WRONG if rate < USELESS else NOTE, of, f'{rate:.2f} messages a second: '
                           'slow; 10 or more keep readings close to each exposure'))
    else:
        out.append(Remark(OK, of, f'{rate:.4g} messages a second'))
    usual = float(np.median(steps))
    longest = float(steps.max())
    if longest > max(GAP, PERIODS * usual):
        out.append(Remark(WRONG if slow else NOTE, of, f'silent for {longest:.1f} s, and usually '
                           f'every {usual:.3g} s'))


def _stamps(out, stream, late, ahead):
    of, stamps = stream.topic, np.array(stream.stamps)
    zero = np.count_nonzero(stamps < EPOCH)
    if zero:
        out.append(Remark(WRONG, of, f'{zero} of {len(stamps)} stamps are not of this century: '
                           'fill header.stamp with the time of the measurement, UTC'))
        return
    back = np.count_nonzero(np.diff(stamps) <= 0.0)
    if back:
        out.append(Remark(WRONG, of, f'{back} of {len(stamps)} stamps are not after the one '
                           'before: two sources, or the stamp is not the time of the measurement'))
    age = np.array(stream.ages)
    youngest, usual = float(age.min()), float(np.median(age))
    if youngest < -ahead:
        out.append(Remark(WRONG, of, f'stamps are up to {-youngest:.3f} s ahead of this '
                           "machine's clock: set both by NTP; 1 s is 15 arcsec of hour angle"))
    elif usual > late:
        out.append(Remark(WRONG, of, f'stamps are {usual:.2f} s behind this machine\'s clock: '
                           'another clock, or the driver stamps or sends late'))
    else:
        out.append(Remark(OK, of, f'stamps increase, {1e3 * usual:.0f} ms before they arrive '
                           f'(at least {1e3 * youngest:.0f} ms)' if not back else
                           f'stamps are {1e3 * usual:.0f} ms before they arrive'))


# --- encoders -------------------------------------------------------------------------------------


def _encoder(out, heard, stream):
    of, wanted = stream.topic, heard.mount.names.keys
    for found in sorted(set(stream.names)):
        if set(wanted) <= set(found):
            continue
        other = next((pair for pair in convert.JOINTS if set(pair) <= set(found)), None)
        told = f'joints {", ".join(found) or "without names"}, and the mount has ' \
            f'{" and ".join(wanted)}: '
        out.append(Remark(WRONG, of, told + (
            'another kind of mount? (--mount here, parameter mount of star_observer)' if other
            else 'name them so')))
        return
    stamps, values, rates = stream.arrays()
    known = np.isfinite(values).all(axis=1)
    if not known.any():
        out.append(Remark(NOTE, of, 'no number in any reading: not homed yet? (call home)'))
        return
    first = int(np.argmax(known))
    if not known[first:].all():
        out.append(Remark(WRONG, of, f'no number in {np.count_nonzero(~known[first:])} of '
                           f'{len(known)} readings, after it was homed'))
    if not _units(out, heard, of, values[known]):
        return
    _motion(out, stream, stamps[known], values[known], rates[known],
            pointed=stream is heard.incremental)
    told = {read_frame(frame) is not None for frame in stream.frames}
    if stream is heard.incremental:
        power = 'tells its power-on in frame_id' if told == {True} else (
            'tells no power-on in frame_id: each homing counts as one')
        homing = 'incremental/homing is published' if heard.homing else (
            'no incremental/homing: its marks cannot be judged')
        out.append(Remark(OK if told == {True} and heard.homing else NOTE, of,
                           f'{power}; {homing}'))


def _units(out, heard, of, values):
    first, second = np.abs(values).max(axis=0)
    # a German mount looks through the pole; any may count on over turns, but not over many
    highest = (np.pi / 2 if heard.mount.vertical else 1.5 * np.pi) + 5.0 * DEG
    if second <= highest and first <= 6.0 * np.pi:
        middle = np.degrees(values[-1])
        out.append(Remark(OK, of, f'reads {middle[0]:.2f} and {middle[1]:.2f} deg: can be'))
        return True
    where = f'reads {values[-1][0]:.6g} and {values[-1][1]:.6g}, which cannot be radians: '
    if first <= highest and second <= 2.0 * np.pi:
        where, why = where.split(',')[0] + ': ', 'axes exchanged, or a zenith distance?'
    elif second <= 280.0 and first <= 1100.0:
        why = 'degrees? (multiply by pi/180)'
    else:
        why = 'counts or arcsec?'
    out.append(Remark(WRONG, of, where + why))
    return False


def _motion(out, stream, stamps, values, rates, pointed):
    """Jumps, wrapping, velocities, rest of the encoder that is `pointed`, frozen readings."""
    of = stream.topic
    if len(stamps) < 3:
        return
    step = np.diff(values, axis=0)
    apart = np.diff(stamps)[:, None]
    turn = np.column_stack([np.abs(np.abs(step[:, 0]) - 2.0 * np.pi) < 10.0 * DEG,
                            np.zeros(len(step), bool)])
    way = np.where(turn, wrap(step), step)
    jumps = np.abs(way) > FASTEST * apart + 5.0 * DEG
    if jumps.any():
        worst = np.degrees(np.abs(way).max())
        out.append(Remark(WRONG, of, f'jumped by up to {worst:.1f} deg between two readings: two '
                           'sources, counts lost, or a wrong unit now and then'))
        return
    if turn.any():
        out.append(Remark(NOTE, of, 'wraps: it jumped by a turn; where a cable counts, count '
                           'turns on, and commands do too'))
    own = way / apart
    moving = np.abs(own) > 10.0 * STILL
    told = np.isfinite(rates[1:])
    both = moving & told
    if both.sum() >= 5:
        between = 0.5 * (rates[1:] + rates[:-1])
        ratio = float(np.nanmedian(between[both] / own[both]))
        if ratio < 0.0:
            out.append(Remark(WRONG, of, 'velocity has the other sign than the angle'))
        elif not 0.5 < ratio < 2.0:
            unit = 'deg/s? ' if 30.0 < ratio < 110.0 else ''
            out.append(Remark(WRONG, of, f'velocity is {ratio:.3g} times what the angle does: '
                               f'{unit}it must be rad/s'))
    elif (told & ~moving & (np.abs(rates[1:]) > 10.0 * STILL)).sum() > 5:
        out.append(Remark(WRONG, of, 'tells a velocity, and its angle does not change: frozen?'))
    rest = ~moving.any(axis=1)
    if pointed and not told.any() and rest.sum() > 20:
        restless = float(np.mean(np.abs(own[rest]).max(axis=1) > STILL))
        if restless > 0.5:
            out.append(Remark(WRONG, of, 'tells no velocity, and its noise over '
                               f'{float(np.median(apart)):.3g} s looks like motion: home never '
                               'sees it at rest; fill velocity'))
    if not way.any():
        out.append(Remark(NOTE, of, 'not one bit has changed: it stands, or it is frozen (move '
                           'the mount, or --nudge)'))


def _together(out, heard):
    """The absolute encoder against the other one."""
    of = heard.absolute.topic
    stamps, values, _ = heard.absolute.arrays()
    at, first, _ = heard.incremental.arrays()
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
    names = heard.mount.names.axes
    bad = False
    for axis in (0, 1):
        if moved[axis] < MOVED:
            continue
        # by the changes of that axis alone, where the other one moves less
        x = a[:, axis] - a[:, axis].mean()
        slope = [float(x @ (b[:, k] - b[:, k].mean()) / (x @ x)) for k in (0, 1)]
        own, other = slope[axis], slope[1 - axis]
        lone = moved[1 - axis] < 0.3 * moved[axis]
        if lone and abs(own) < 0.2 and abs(other) > 0.5:
            text = f'exchanged axes: it follows {names[axis]} with its {names[1 - axis]}'
        elif abs(own + 1.0) < 0.2:
            text = f'{names[axis]} runs the other way than the incremental encoder'
        elif abs(own) < 0.05 and np.ptp(b[:, axis]) < 0.05 * moved[axis]:
            text = f'{names[axis]} is frozen: the incremental encoder moved by ' \
                f'{moved[axis] / DEG:.2f} deg'
        elif abs(own - 1.0) > 0.1:
            text = f'{names[axis]} moves {own:.3g} times as far as the incremental encoder'
        else:
            continue
        bad = True
        out.append(Remark(WRONG, of, text))
    if bad:
        return
    apart = np.column_stack([wrap(a[:, 0] - b[:, 0]), a[:, 1] - b[:, 1]])
    middle, scatter = np.median(apart, axis=0), apart.std(axis=0)
    level = NOTE if np.abs(middle).max() > 5.0 * DEG else OK
    out.append(Remark(level, of, 'incremental - absolute: '
                       + ', '.join(f'{names[k]} {middle[k] / ARCSEC:+.1f} +- '
                                   f'{scatter[k] / ARCSEC:.1f} arcsec' for k in (0, 1))))


# --- camera and mount -----------------------------------------------------------------------------


def _camera(out, stream):
    of = stream.topic
    values = np.array(stream.values, float).reshape(-1, 2)
    known = np.isfinite(values).all(axis=1)
    if not known.any():
        out.append(Remark(NOTE, of, f'no star in any of {len(values)} exposures: point at one to '
                           'have the camera judged'))
        return
    seen = values[known]
    far = float(np.median(np.hypot(*seen.T)))
    if far > BEYOND_FIELD:
        out.append(Remark(WRONG, of, f'stars {far:.3g} rad beside the boresight: arcsec or pixels '
                           'for radians?'))
    elif far > WIDE_FIELD:
        out.append(Remark(NOTE, of, f'stars {far / DEG:.2f} deg beside the boresight: is that in '
                           'radians?'))
    else:
        out.append(Remark(OK, of, f'a star in {known.sum()} of {len(values)} exposures, '
                           f'{far / ARCSEC:.1f} arcsec beside the boresight'))
    same = longest = 1
    for before, now in zip(seen, seen[1:]):
        same = same + 1 if (before == now).all() else 1
        longest = max(longest, same)
    if longest >= SAME_FRAMES:
        out.append(Remark(WRONG, of, f'the same miss distance in {longest} exposures in a row: '
                           'it measures nothing'))


def _commands(out, heard):
    if not heard.followers:
        out.append(Remark(WRONG, 'command', 'nobody follows it: start the driver of the mount, '
                           'in the namespace and ROS domain of this command'))
    names = sorted({end.node for end in heard.followers})
    if len(names) > 1:
        out.append(Remark(WRONG, 'command', f'{" and ".join(names)} follow it: a mount has one '
                           'driver; end all but one'))
    for end in heard.followers:
        if end.type != 'trajectory_msgs/msg/JointTrajectory':
            out.append(Remark(WRONG, 'command', f'{end.node} expects {end.type}: it must be '
                               'trajectory_msgs/msg/JointTrajectory'))
        elif end.latched:
            out.append(Remark(WRONG, 'command', f'{end.node} asks for transient local: nothing '
                               'passes; subscribe volatile'))
        else:
            out.append(Remark(OK, 'command', f'{end.node} follows it'))
    out.append(Remark(OK, 'home', 'is offered') if 'home' in heard.services else Remark(
        NOTE, 'home', 'no such service: leave the step home out of plans'))
