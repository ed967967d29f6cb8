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

"""Detects impossible data from instruments, from their messages alone.

It does not know what an instrument should read. It uses that stamps increase with time, that two
instruments on one topic cannot both be right, that a measurement has noise, and that a mount that
was commanded to move has moved.
"""

import numpy as np

from calibration.analysis.camera_faults import SAME_FRAMES
from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.places import SIDEREAL

MOUNT, ABSOLUTE, CAMERA = 'mount and incremental encoder', 'absolute encoder', 'camera'
CLOCK = 'clock of this machine'
#: beginning of the sentences of `InstrumentHealth`
ALARM = 'instrument '
#: largest lead of a reading's stamp over graph time, ns: more than for a slew and a homing
AHEAD = 600 * 10**9
#: on wall time: largest lead and lag of stamps relative to this machine's clock; lag of a frame, ns
AHEAD_LIVE, BEHIND_LIVE, BEHIND_FRAME = 2 * 10**9, 5 * 10**9, 600 * 10**9
#: no camera measures a larger miss distance, rad
BEYOND_FIELD = 0.1
#: stamps that go back by less are out of order; by more the clock was set back, ns
CLOCK_JUMP = 10**9
#: messages without a fault after which the fault is over
RECOVERED = 5
#: an encoder farther than this from its demand did not follow the command, rad
OFF_TARGET = 60.0 * ARCSEC

#: largest relative error of a motion seen by a camera
MOST_AMISS = 0.25

#: what to do, by the kind of fault
REMEDIES = {
    'silent': 'look at its driver, power and cable',
    'never': 'look at its driver: it is connected, but sends nothing',
    'message': 'fix its driver (docs/real_mount.md)',
    'stamps': 'stamp with the time of the measurement, from a clock set by NTP',
    'frozen': 'look at the instrument',
    'step': 'synchronise it by NTP, and set the zero again',
    'number': 'home it again',
    'zero': 'home it, or power it off and on, and set the zero anew: it has changed. '
            'Look at its head, disc and cable',
    'motion': 'look at brakes, limits, joint names and signs (telescope-mount check-drivers)',
    'sign': 'its signs, rotation or scale are wrong, or its images are old: '
            'telescope-mount check-drivers --nudge',
    'slow': 'nothing to do, or shorten the exposure',
    'blank': 'look at clouds, cover, focus, exposure, the size of the field, site and clock',
}


class InstrumentHealth:
    """Receives the messages of the instruments, and reports impossible ones.

    Parameters
    ----------
    live : bool
        Whether graph time is wall time, not simulated time.
    """

    def __init__(self, live=False):
        self._live = live
        self.field = BEYOND_FIELD  # largest distance of a star from the boresight, rad
        self._faults = {}  # (instrument, kind) -> [sentence, good messages since]
        self._stamps = {}  # instrument -> (stamp, graph time) of its last good message
        self._frame, self._same = None, 0
        self._pair = None
        self._unnamed = set()  # instruments with an unidentified publisher
        self._others = {}  # instrument -> publishing nodes, if several

    @property
    def sentences(self):
        """Present faults and what to do: (instrument, kind) -> sentence."""
        return {(name, kind): f'{ALARM}{name}: {text}; {REMEDIES[kind]}'
                for (name, kind), (text, _) in self._faults.items()} | {
            (name, 'publishers'): f'{ALARM}{name}: {self._published_by(name)}'
            for name in self._others}

    def is_silent(self, *names):
        """Whether one of `names`, or any instrument, has fallen silent after publishing."""
        return any(kind == 'silent' and (not names or name in names)
                   for name, kind in self._faults)

    @property
    def blocked(self):
        """Why nothing can be observed now, '' if it can."""
        return next((f'{name}: {self._published_by(name)}' for name in self._others), '')

    @property
    def suspect(self):
        """Whether an exposure made now may be from another instrument."""
        return bool(self._others or self._unnamed) or any(
            kind == 'stamps' for _, kind in self._faults)

    def _published_by(self, name):
        return f'published by {" and ".join(self._others[name])}; end all but one'

    def _fault(self, name, kind, text):
        """Store a fault; with '' it is over at once. Returns the text."""
        if text:
            self._faults[name, kind] = [text, 0]
        else:
            self._faults.pop((name, kind), None)
        return text

    def _good(self, name, kind):
        fault = self._faults.get((name, kind))
        if fault is not None:
            fault[1] += 1
            if fault[1] >= RECOVERED:
                del self._faults[name, kind]

    def message_came(self, name):
        """The instrument is no longer silent."""
        for kind in ('silent', 'never'):
            self._fault(name, kind, '')

    def silent(self, name, usual):
        """No message for a long time; `usual` is the usual interval, wall s."""
        if np.isfinite(usual):
            self._fault(name, 'silent', f'silent; it sent something every {usual:.2g} s')
        else:
            self._fault(name, 'never', 'has sent nothing yet')

    def slow(self, name, usual, limit):
        """Check the interval of messages, wall s, against the time allowed for an answer."""
        self._fault(name, 'slow', '' if not usual > limit else
                    f'a message every {usual:.0f} s, slower than answer_timeout_s = {limit:g}: '
                    'three of them are waited for')

    def unreadable(self, name, reason):
        """A message could not be read; returns the reason."""
        return self._fault(name, 'message', reason)

    def blanks(self, name, count):
        """Number of consecutive targets without a star; 0 after a star."""
        self._fault(name, 'blank',
                    f'no star in the field of {count} targets in a row' if count else '')

    def zero(self, name, axis='', jump=0.0):
        """The zero of an axis' encoder jumped by `jump` (rad); without arguments: a new zero."""
        if jump:
            self._fault(name, 'motion', '')
        self._fault(name, 'zero', '' if not jump else f'zero of the {axis} encoder jumped by '
                    f'{jump / ARCSEC:+.0f} arcsec without a power-on')

    def axes(self, name, text):
        """How the axes fail to follow the command, in words; '' if they follow."""
        # after a jump of the zero, deviations from the track mean nothing more
        self._fault(name, 'motion', '' if (name, 'zero') in self._faults else text)

    def clock(self, step=0.0, now=0):
        """The clock of all stamps was set ahead by `step` (s) at `now` (ns); 0: over."""
        time = np.datetime64(now, 'ns').astype('datetime64[s]').item()
        self._fault(CLOCK, 'step', '' if not step else
                    f'set {"ahead" if step > 0.0 else "back"} by {abs(step):.2f} s at '
                    f'{time:%H:%M:%S} UTC: places of stars moved by up to '
                    f'{abs(step) * SIDEREAL / ARCSEC:.1f} arcsec')

    def publishers(self, name, nodes, unnamed=False):
        """Take the publishers of an instrument's messages.

        Parameters
        ----------
        name : str
        nodes : iterable of str
            Names of nodes; one that was killed and restarted may be listed twice for a while.
        unnamed : bool
            Whether there is another publisher that is not identified yet.
        """
        (self._unnamed.add if unnamed else self._unnamed.discard)(name)
        nodes = sorted(set(nodes))
        if len(nodes) > 1:
            self._others[name] = nodes
        else:
            self._others.pop(name, None)

    def forget_stamps(self):
        """The graph clock was restarted."""
        self._stamps.clear()

    def stamp(self, name, stamp, now):
        """Check the stamp of a message.

        Parameters
        ----------
        name : str
            Name of the instrument.
        stamp, now : int
            Stamp of the message, and graph time; ns, `now` is 0 if unknown.

        Returns
        -------
        str
            Why the message is unusable; '' if it is usable.
        """
        last, then = self._stamps.get(name, (None, 0))
        if stamp == 0:
            return self._fault(name, 'stamps', 'stamps are 0')
        if last is not None and 0 <= last - stamp < CLOCK_JUMP:
            return self._fault(name, 'stamps', 'a stamp not after the one before: two of them on '
                               'one topic, or its clock has stopped')
        if self._live and now:
            behind = BEHIND_FRAME if name == CAMERA else BEHIND_LIVE
            if not -behind <= stamp - now <= AHEAD_LIVE:
                how = 'ahead of' if stamp > now else 'behind'
                return self._fault(name, 'stamps', f'stamps {abs(stamp - now) * 1e-9:.0f} s {how} '
                                   "this machine's clock")
        elif now and stamp > now + AHEAD:
            return self._fault(name, 'stamps', f'a stamp {(stamp - now) * 1e-9:.0f} s ahead of '
                               'the time of the graph')
        if last is not None and stamp <= last:
            back = last - stamp
            if now and now > then - CLOCK_JUMP:
                return self._fault(name, 'stamps', f'stamps went back by {back * 1e-9:.0f} s, '
                                   'but the time of the graph did not')
        self._stamps[name] = stamp, now
        self._good(name, 'stamps')
        if name != CAMERA:  # an image without a star does not test the unit
            self._good(name, 'message')
        return ''

    def frame(self, name, x, y):
        """Check a miss distance, rad; why it is unusable, '' if usable."""
        if not np.isfinite([x, y]).all():
            return ''
        if np.hypot(x, y) > self.field:
            # the same words each time, so the log gets one line, not one per message
            return self.unreadable(name, f'a star outside the field, of {self.field / DEG:.3g} deg '
                                   '(field_deg): arcsec or degrees for radians?')
        self._good(name, 'message')
        self._same = self._same + 1 if (x, y) == self._frame else 1
        self._frame = x, y
        return self._fault(name, 'frozen', '' if self._same < SAME_FRAMES else
                           f'the same miss distance in {self._same} exposures in a row: it '
                           'measures nothing')

    def number(self, name, finite):
        """Check whether an encoder that was homed in this power-on gives a number."""
        if finite:
            self._good(name, 'number')
        else:
            self._fault(name, 'number', 'no number, although it was homed in this power-on')

    def follows(self, name, distance, moved):
        """Check how an axis encoder followed a command.

        Parameters
        ----------
        name : str
        distance : float
            Distance of its reading from the demand at the end of the track, rad.
        moved : bool
            Whether the reading has changed since the command.
        """
        how = 'it' if moved else 'its reading has not changed since the command, and'
        self.axes(name, '' if distance <= OFF_TARGET else f'contradicts the commanded motion: {how}'
                  f' is {distance / ARCSEC:.0f} arcsec from the demand')

    def centres(self, name, before, after):
        """Check the miss distance, rad, before and after the mount was moved to centre the star.

        Returns
        -------
        bool
            Whether the camera saw the mount move.
        """
        return not self._fault(
            name, 'sign', '' if after < 0.5 * before else 'contradicts the commanded motion: a '
            f'star {before / ARCSEC:.0f} arcsec off was centred, and is {after / ARCSEC:.0f} '
            'arcsec off')

    def moves(self, name, seen, wanted):
        """Compare the motion of a star in the camera with the expected one, rad, shape (2,).

        Returns
        -------
        bool
            Whether the camera saw it.
        """
        good = np.hypot(*(seen - wanted)) <= MOST_AMISS * np.hypot(*wanted)
        found, had = (f'{x / ARCSEC:+.0f}, {y / ARCSEC:+.0f}' for x, y in (seen, wanted))
        return not self._fault(
            name, 'sign', '' if good else 'contradicts the commanded motion: a star had to move by '
            f'{had} arcsec (x, y), and it says {found}')

    def turned(self, name, count, sense):
        """The last `count` miss distances fit the pointing if the camera is rotated."""
        self._fault(name, 'sign', f'{sense} in the last {count} observations, compared with where '
                    'the mount was pointed')

    def doubted(self, name):
        """Whether a camera has contradicted a motion, and has not been confirmed since."""
        return (name, 'sign') in self._faults

    def second(self, name, reading, first):
        """Check readings of the second encoder against the first at an observation, rad.

        Returns
        -------
        bool
            Whether the second is usable: False if it stood still while the first moved.
        """
        reading, first = np.array(reading), np.array(first)
        before, self._pair = self._pair, (reading, first)
        frozen = before is not None and np.isfinite(reading).any() and (
            np.array_equal(before[0], reading, equal_nan=True)) and (
            np.abs(first - before[1]).max() > OFF_TARGET)
        return not self._fault(name, 'frozen', 'exactly the same reading as at the star '
                               'before' if frozen else '')
