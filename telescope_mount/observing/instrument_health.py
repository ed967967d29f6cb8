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

"""What instruments give away of themselves that cannot be true, from their messages alone.

Nothing here knows what an instrument should read. It knows that stamps go on with time, that two
instruments on one topic cannot both be right, that a measurement has noise, and that a mount that
was told to move has moved.
"""

import numpy as np

from calibration.analysis.camera_faults import SAME_FRAMES
from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.places import SIDEREAL

MOUNT, ABSOLUTE, CAMERA = 'mount and incremental encoder', 'absolute encoder', 'camera'
CLOCK = 'clock of this machine'
#: with which the sentences of `InstrumentHealth` begin
ALARM = 'instrument '
#: a reading is not stamped so far ahead of the graph's time: a slew and a homing are, ns
AHEAD = 600 * 10**9
#: on the time of the wall: stamps ahead of and behind this machine's clock, of an exposure, ns
AHEAD_LIVE, BEHIND_LIVE, BEHIND_FRAME = 2 * 10**9, 5 * 10**9, 600 * 10**9
#: a miss distance that no camera measures, rad
BEYOND_FIELD = 0.1
#: stamps that go back by less are out of order, by more the clock went back, ns
CLOCK_JUMP = 10**9
#: messages without a fault after which one is over
RECOVERED = 5
#: an encoder that differs by more from its demand did not follow the command, rad
OFF_TARGET = 60.0 * ARCSEC

#: of a motion, by which a camera may see it wrongly
MOST_AMISS = 0.25

#: what to do, by the kind of fault
REMEDIES = {
    'silent': 'look at its driver, power and cable',
    'never': 'look at its driver: it publishes, and nothing comes',
    'message': 'mend its driver (docs/real_mount.md)',
    'stamps': 'stamp with the time of the measurement, of a clock set by NTP',
    'frozen': 'look at the instrument',
    'step': 'keep it by NTP, and set the zero anew',
    'number': 'home it again',
    'zero': 'home it, or power it off and on, and set the zero anew: it has changed. '
            'Look at its head, disc and cable',
    'motion': 'look at brakes, limits, joint names and signs (telescope-mount check-drivers)',
    'sign': 'its signs, rotation or scale are wrong: telescope-mount check-drivers --nudge',
    'slow': 'nothing, or expose shorter',
    'blank': 'look at clouds, cover, focus, exposure, the size of the field, site and clock',
}


class InstrumentHealth:
    """Takes the messages of the instruments, and reports what cannot be.

    Parameters
    ----------
    live : bool
        Whether the time of the graph is that of the wall, and not simulated.
    """

    def __init__(self, live=False):
        self._live = live
        self.field = BEYOND_FIELD  # rad: no camera sees a star farther from its boresight
        self._faults = {}  # (instrument, kind) -> [sentence, messages without it since]
        self._stamps = {}  # instrument -> (stamp, time of the graph) of its last good message
        self._frame, self._same = None, 0
        self._pair = None
        self._unnamed = set()  # instruments with a publisher that is not known yet
        self._others = {}  # instrument -> nodes that publish, where there are several

    @property
    def sentences(self):
        """What is wrong now and what to do: by (instrument, kind), a sentence each."""
        return {(name, kind): f'{ALARM}{name}: {text}; {REMEDIES[kind]}'
                for (name, kind), (text, _) in self._faults.items()} | {
            (name, 'publishers'): f'{ALARM}{name}: {self._published_by(name)}'
            for name in self._others}

    def is_silent(self, *names):
        """Whether one of `names`, or of all, spoke and has fallen silent."""
        return any(kind == 'silent' and (not names or name in names)
                   for name, kind in self._faults)

    @property
    def blocked(self):
        """Why nothing can be observed now, '' if it can."""
        return next((f'{name}: {self._published_by(name)}' for name in self._others), '')

    @property
    def suspect(self):
        """Whether an exposure that was made now may be another instrument's."""
        return bool(self._others or self._unnamed) or any(
            kind == 'stamps' for _, kind in self._faults)

    def _published_by(self, name):
        return f'published by {" and ".join(self._others[name])}; end all but one'

    def _fault(self, name, kind, text):
        """Keep a fault; '' where it is over at once. The text."""
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
        """It is silent no more."""
        for kind in ('silent', 'never'):
            self._fault(name, kind, '')

    def silent(self, name, usual):
        """Take that none has come for long; `usual` is the time between them, wall s."""
        if np.isfinite(usual):
            self._fault(name, 'silent', f'silent; it sent something every {usual:.2g} s')
        else:
            self._fault(name, 'never', 'has sent nothing yet')

    def slow(self, name, usual, limit):
        """Take how far apart its messages are, wall s, and what an answer may take."""
        self._fault(name, 'slow', '' if not usual > limit else
                    f'a message every {usual:.0f} s, slower than answer_timeout_s = {limit:g}: '
                    'three of them are waited for')

    def unreadable(self, name, reason):
        """Take why a message could not be read; the reason."""
        return self._fault(name, 'message', reason)

    def blanks(self, name, count):
        """Take in how many targets in a row no star was seen; 0 after one was."""
        self._fault(name, 'blank',
                    f'no star in the field of {count} targets in a row' if count else '')

    def zero(self, name, axis='', jump=0.0):
        """Take by how much (rad) the zero of an axis' encoder jumped; without, that it is new."""
        if jump:
            self._fault(name, 'motion', '')
        self._fault(name, 'zero', '' if not jump else f'zero of the {axis} encoder jumped by '
                    f'{jump / ARCSEC:+.0f} arcsec without a power-on')

    def axes(self, name, text):
        """Take how the axes do not follow the command, in words; '' where they do."""
        # after a jump readings beside the track say no more
        self._fault(name, 'motion', '' if (name, 'zero') in self._faults else text)

    def clock(self, step=0.0, now=0):
        """Take by how much (s) the clock of all stamps was set ahead, at `now` (ns); 0: no more."""
        time = np.datetime64(now, 'ns').astype('datetime64[s]').item()
        self._fault(CLOCK, 'step', '' if not step else
                    f'set {"ahead" if step > 0.0 else "back"} by {abs(step):.2f} s at '
                    f'{time:%H:%M:%S} UTC: places of stars moved by up to '
                    f'{abs(step) * SIDEREAL / ARCSEC:.1f} arcsec')

    def publishers(self, name, nodes, unnamed=False):
        """Take who publishes an instrument's messages.

        Parameters
        ----------
        name : str
        nodes : iterable of str
            Names of nodes; one that was killed and started again may be there twice for a while.
        unnamed : bool
            Whether there is one more of which nobody knows yet who it is.
        """
        (self._unnamed.add if unnamed else self._unnamed.discard)(name)
        nodes = sorted(set(nodes))
        if len(nodes) > 1:
            self._others[name] = nodes
        else:
            self._others.pop(name, None)

    def forget_stamps(self):
        """The clock of the graph began anew."""
        self._stamps.clear()

    def stamp(self, name, stamp, now):
        """Take the stamp of a message.

        Parameters
        ----------
        name : str
            Of the instrument.
        stamp, now : int
            Of the message, and the graph's time; ns, `now` 0 where it is not known.

        Returns
        -------
        str
            Why the message cannot be used; '' if it can.
        """
        last, then = self._stamps.get(name, (None, 0))
        if stamp == 0:
            return self._fault(name, 'stamps', 'stamps are 0')
        if last is not None and 0 <= last - stamp < CLOCK_JUMP:
            return self._fault(name, 'stamps', 'a stamp not after the one before: two of them on '
                               'one topic, or its clock stands')
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
                return self._fault(name, 'stamps', f'stamps run back, by {back * 1e-9:.0f} s, '
                                   'and the time of the graph does not')
        self._stamps[name] = stamp, now
        self._good(name, 'stamps')
        if name != CAMERA:  # an image without a star says nothing of its unit
            self._good(name, 'message')
        return ''

    def frame(self, name, x, y):
        """Take a miss distance, rad; why it cannot be used, '' if it can."""
        if not np.isfinite([x, y]).all():
            return ''
        if np.hypot(x, y) > self.field:
            # the same words each time: one line of the log, not one a message
            return self.unreadable(name, f'a star outside the field, of {self.field / DEG:.3g} deg '
                                   '(field_deg): arcsec or degrees for radians?')
        self._good(name, 'message')
        self._same = self._same + 1 if (x, y) == self._frame else 1
        self._frame = x, y
        return self._fault(name, 'frozen', '' if self._same < SAME_FRAMES else
                           f'the same miss distance in {self._same} exposures in a row: it '
                           'measures nothing')

    def number(self, name, finite):
        """Take whether an encoder that was homed in this power-on gave a number."""
        if finite:
            self._good(name, 'number')
        else:
            self._fault(name, 'number', 'no number, although it was homed in this power-on')

    def follows(self, name, distance, moved):
        """Take how an axis encoder followed a command.

        Parameters
        ----------
        name : str
        distance : float
            Of its reading from the demand, at the end of the track, rad.
        moved : bool
            Whether it reads otherwise than before the command.
        """
        how = 'it' if moved else 'its reading has not changed since the command, and'
        self.axes(name, '' if distance <= OFF_TARGET else f'contradicts the commanded motion: {how}'
                  f' is {distance / ARCSEC:.0f} arcsec from the demand')

    def centres(self, name, before, after):
        """Take the miss distance, rad, before and after the mount was moved by it.

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
        """Take by how much a star moved in the camera, and by how much it had to, rad, shape (2,).

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
        """Take that the last `count` miss distances fit the pointing with the camera turned."""
        self._fault(name, 'sign', f'{sense} in the last {count} observations, by where the mount '
                    'was pointed')

    def doubted(self, name):
        """Whether a camera has contradicted the motion, and not yet seen the mount move since."""
        return (name, 'sign') in self._faults

    def second(self, name, reading, first):
        """Take readings of the second encoder and of the first at an observation, rad.

        Returns
        -------
        bool
            Whether the second one may be used: False where it stood still and the other moved.
        """
        reading, first = np.array(reading), np.array(first)
        before, self._pair = self._pair, (reading, first)
        frozen = before is not None and np.isfinite(reading).any() and (
            np.array_equal(before[0], reading, equal_nan=True)) and (
            np.abs(first - before[1]).max() > OFF_TARGET)
        return not self._fault(name, 'frozen', 'the same reading as at the star before, to the '
                               'last bit' if frozen else '')
