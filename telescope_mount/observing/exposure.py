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

"""One observation: command the track of a target, wait for an exposure on it, centre it, and make
its row."""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from calibration.analysis.camera_faults import turned_rows
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import centred, centred_second
from pointing_model.runs.run import PointingRun

from .axis_check import FollowingCheck
from .axis_demand import Conditions, Pointing, on_sky, track_to
from .camera_delay import Drifting, row_of
from .instruments import ABSOLUTE, CAMERA, MOUNT

#: exposures without a star before it is given up: one that was under way at the command is smeared
BLANKS = 3
#: most exposures to centre a star
CENTRINGS = 3
#: ratio of miss distances after and before centring that shows a move in the wrong direction
WORSE = 1.2
#: direction of the test move for the camera, in units of the recentring limit: as far as possible
#: from the axes and their bisectors, for which a mirrored camera would look right
BESIDE = np.array([np.cos(np.pi / 8.0), np.sin(np.pi / 8.0)])
#: rows used to test the camera, and their columns
LAST, CAMERA_COLUMNS = 60, (
    'az', 'el', 'az_enc', 'el_enc', 'miss_x', 'miss_y', 'run', 'star')
#: consecutive exposures with moving axes that are no longer settling
RESTLESS = 5
#: time after which a commanded axis must have started to move, s
BEGUN = 10.0


class Exposer:
    """Makes rows of targets.

    Methods that wait are generators of conditions, for `msg_tools.steps.Steps`.

    Parameters
    ----------
    outbox
        See `Sequencer`.
    instruments : Instruments
    active : ActiveCalibration
    table : NightMemory
    ready : callable
        Returns the steps after which the mount can be commanded.
    waiting : callable
        Called with what is waited for, in words; '' when the wait is over.

    Attributes
    ----------
    earliest : int
        Earliest begin of the next track, ns.
    commanded : int
        Begin of the last track, ns.
    exposed : int
        Stamp of the last exposure, ns.
    refusal : str
        Why the last track was refused; '' if it was not.
    """

    def __init__(self, outbox, instruments, active, table, ready, waiting):
        self._out, self._instruments, self._active = outbox, instruments, active
        self._table, self._ready, self._waiting = table, ready, waiting
        self.earliest = self.commanded = self.exposed = 0
        self._following = None  # check of the command that is waited for
        self._blanks = 0  # consecutive targets without a star
        self.refusal = ''
        self.forget_aim()

    def forget_aim(self):
        """Reset the offset learned from earlier stars: a new model or zero includes it."""
        self._carried = np.zeros(2)

    def watch(self, now):
        """Report whether the axes follow the command while an exposure is waited for.

        `now` is on the instruments' wall clock, s.
        """
        instruments = self._instruments
        if self._following is None or not instruments.homed or instruments.excused:
            return
        text, swings = '', instruments.exposures.restless
        if len(swings) >= RESTLESS:
            text = (f'moves by {swings[-1] / ARCSEC:.2g} arcsec beside its track within an '
                    f'exposure, smear_arcsec = {self._out.value("smear_arcsec"):g}')
        instruments.health.axes(
            MOUNT, self._following.fault(instruments.stamp, instruments.here, now,
                                       self._out.guard.sent(instruments.stamp)) or text)

    def observe(self, target, block, blind=False, pointing=None):
        """Steps that point at `target` and centre it if it is far off.

        Parameters
        ----------
        target : StarTarget or SatelliteTarget
        block : int
            Number of the step of the plan.
        blind : bool
            Use model and zero alone, and take the first exposure.
        pointing : Pointing, optional
            Pointing at it; by default that of `aimed_at`.

        Returns
        -------
        dict or None
            The row; None if no star was in the field, or the track was refused.
        """
        pointing = self.aimed_at(target, pointing)
        if blind:
            pointing.aim = np.zeros(2)
        if self._instruments.health.doubted(CAMERA) and not (
                yield from self._sees_motion(pointing)):
            return None
        seen = blank = 0
        first = None
        while True:
            exposed = yield from self.expose(pointing)
            if exposed is None:
                return None
            stamp, miss = exposed
            if not np.isfinite(miss).all():
                blank += 1
                if blank < BLANKS:
                    continue
                if not blind:
                    self.forget_aim()  # it may be the cause
                self._blanks += 1
                if self._blanks >= BLANKS:
                    self._instruments.health.blanks(CAMERA, self._blanks)
                return None
            self._blanks = 0
            self._instruments.health.blanks(CAMERA, 0)
            reading, rate = self._instruments.exposures.over(
                'enc', stamp, self._out.value('exposure_s'))
            enc = np.array(centred(*reading, *miss, pointing.beyond))
            second = self._second(stamp, miss, reading, pointing.beyond)
            second_on = self._instruments.absolute_power_on
            self._active.update_readings(self._instruments.run, enc, second,
                                         second_on.started if second_on else np.nan)
            if blind:
                break
            demand = pointing.demand(np.array([stamp]), self._conditions())[0]
            # only for pointing: the next star will be off by about as much
            pointing.aim = pointing.aim + np.array(
                [wrap(enc[0] - demand[0]), enc[1] - demand[1]])
            self._carried = pointing.aim / self._axis_scale(pointing)
            seen += 1
            off = float(np.hypot(*miss))
            first = off if first is None else first
            near = off <= self._out.value('recentre_arcsec') * ARCSEC
            # farther off than before: another correction would make it worse
            if near or seen == CENTRINGS or off > WORSE * first:
                break
        if first is not None and not near and not self._instruments.health.centres(
                CAMERA, first, off):
            self.forget_aim()
            self._out.refuse_frame('a star that was centred is as far off as before')
            return None
        row = night_row(Measured(stamp, miss, enc, second, rate), pointing, self._conditions(),
                        block, blind, self._instruments, self._active.inclinometer, self._out.value)
        self._check_camera(row)
        return row

    def _sees_motion(self, pointing):
        """Steps that move the mount slightly; whether the camera sees the star move accordingly."""
        aim, seen = pointing.aim, []
        beside = BESIDE * self._out.value('recentre_arcsec') * ARCSEC
        second = pointing.place(np.array([self.now()]), *self._out.sky())[1][0]
        for moved in (np.zeros(2), beside / [np.cos(second), 1.0]):
            pointing.aim = aim + moved
            exposed = yield from self.expose(pointing)
            if exposed is None or not np.isfinite(exposed[1]).all():
                return False
            seen.append(np.array(exposed[1]))
        pointing.aim = aim
        if self._instruments.health.moves(CAMERA, seen[1] - seen[0], -beside):
            return True
        self.forget_aim()
        self._out.refuse_frame('the camera does not show the motion that was commanded')
        return False

    def _check_camera(self, row):
        """Report if the last rows show a rotated camera; the fit detects it in them, too."""
        if row['star'] < 0:
            return  # the miss of a satellite includes its orbit error
        last = self._table.latest(CAMERA_COLUMNS, LAST)
        stars = np.append(last['star'], row['star']) >= 0
        columns = {name: np.append(last[name], row[name])[stars] for name in CAMERA_COLUMNS}
        off = np.hypot(columns['miss_x'], columns['miss_y'])
        if not (np.isfinite(off[-1]) and off[-1] > np.nanmedian(off)):
            return  # with a rotated camera it would grow
        wrong, sense = turned_rows(PointingRun(
            columns, {} if self._out.mount().vertical else {'mount': self._out.mount()}))
        if wrong[-1]:
            self._instruments.health.turned(CAMERA, int(wrong.sum()), sense)
            self.forget_aim()

    def drift(self, pointing, rate, place):
        """Steps for one exposure while the axes drift past a star, see `camera_delay`.

        Parameters
        ----------
        pointing : Pointing
            Pointing at the star.
        rate, place : ndarray, shape (2,)
            Rate and initial offset relative to the star, on the sky, rad/s and rad.

        Returns
        -------
        row : list or None
            See `camera_delay.row_of`; None without a star, or if the track was refused.
        second : list or None
            The same for the absolute encoder.
        place : ndarray, shape (2,)
            Present offset of the axes from the star.
        """
        drifting = Drifting(pointing, max(self.now(), self.earliest), np.array(place), rate)
        exposed = yield from self.expose(drifting)
        now = drifting.beside(np.array([self.now()]))[0]
        if exposed is None or not np.isfinite(exposed[1]).all():
            return None, None, now
        stamp, miss = exposed
        reading, moving = self._instruments.exposures.over(
            'enc', stamp, self._out.value('exposure_s'))
        demand = pointing.demand(np.array([stamp]), self._conditions())[0]
        rows = []
        for angles in (centred(*reading, *miss, pointing.beyond),
                       self._second(stamp, miss, reading, pointing.beyond)):
            beside = on_sky(angles, demand)
            rows.append(row_of(stamp, rate, np.sign(moving), miss, beside)
                        if np.isfinite(beside).all() else None)
        return *rows, now

    def aimed_at(self, target, pointing=None):
        """`Pointing` at a target, with the offset learned from earlier stars."""
        pointing = pointing or Pointing(target, self._active, np.zeros(2), self._out.mount(),
                            self._out.value('meridian_limit_deg') * DEG)
        pointing.aim = self._carried * self._axis_scale(pointing)
        return pointing

    def _axis_scale(self, pointing):
        """Factor from an offset on the sky to the axes: near a pole the first axis turns far.

        For azimuth it is 1: most of the offset is an error of the zero.
        """
        if pointing.mount.vertical:
            return 1.0
        second = pointing.place(np.array([self.now()]), *self._out.sky())[1][0]
        return np.array([1.0 / np.cos(second), 1.0])

    def _second(self, stamp, miss, first, beyond):
        """Centred reading of the absolute encoder; NaN for axes without a usable one."""
        try:
            reading, _ = self._instruments.exposures.over('abs', stamp,
                                                          self._out.value('exposure_s'))
        except ValueError:
            return np.full(2, np.nan)
        if not self._instruments.health.second(ABSOLUTE, reading, first):
            return np.full(2, np.nan)
        return centred_second(reading, first, miss, beyond)

    def expose(self, pointing):
        """Steps that command a track until there is an exposure on it: stamp and miss.

        None if the track is refused.
        """
        found = None
        while found is None:
            found = yield from self._try(pointing)
            if self.refusal:
                return None
            self._instruments.look()
            if found is not None and self._instruments.health.suspect:
                self._out.refuse_frame('an exposure that may be of another instrument')
                found = None
        return found

    def until_free(self):
        """Steps that wait while the guard does not let the mount move."""
        held = self._out.guard.held
        if held():
            self._waiting(f'the guard ({held()})')
            yield lambda: not held()
            self._waiting('')

    def _try(self, pointing):
        """Command once; None if there was no answer in time."""
        yield from self._ready()
        instruments, value, held = self._instruments, self._out.value, self._out.guard.held
        yield from self.until_free()
        self.commanded = max(self.now(), self.earliest)
        track = track_to(pointing, self.commanded, self._conditions(), value('slew_rate_deg_s'))
        instruments.exposures.begin(track)
        self._out.guard.send_command(track)
        since, before = instruments.await_all(), instruments.here
        self._following = FollowingCheck(
            track, before, self._out.mount(), value('on_target_arcsec') * ARCSEC,
            self._out.guard.own_way, since)
        began = instruments.began
        take = partial(instruments.exposures.take, value('on_target_arcsec') * ARCSEC,
                       self._out.refuse_frame, value('exposure_s'),
                       value('smear_arcsec') * ARCSEC)
        found = None

        def answered():
            nonlocal found
            found = take()
            # a slew may take as long as the track
            return (found is not None or self._out.guard.refusal(track.start) or held()
                    or instruments.silent(value('answer_timeout_s'))
                    or not instruments.homed or instruments.stamp > track.end
                    or instruments.began != began)

        yield answered
        self._following = None
        self.refusal = '' if found is not None else self._out.guard.refusal(track.start)
        off = self._note_motion(track, before, found is not None)
        if found is not None:
            self._waiting('')
            self.exposed = found[0]
        elif instruments.homed:
            wait = value('answer_timeout_s')
            beside = off > value('on_target_arcsec') * ARCSEC
            # an instrument whose frame is off target has answered
            mute = instruments.silent(wait) if beside else instruments.unanswered(wait)
            self._waiting(f'an answer of {", ".join(mute)}' if mute else
                          f'the mount to come on target: {off / ARCSEC:.0f} arcsec off')
        return found

    def _note_motion(self, track, before, exposed):
        """Check whether the encoder follows the command, as far as known by now.

        Returns its distance from the demand, rad; 0 if unknown.
        """
        instruments = self._instruments
        at = (instruments.stamp - track.start) * 1e-9
        at_rest = np.array_equal(instruments.here, before)
        # the distance counts for an axis that has arrived or has not started, not during a slew
        known = exposed or instruments.stamp > track.end or (at_rest and at > BEGUN)
        if not instruments.homed or not known:
            return 0.0
        distance = float(np.hypot(*on_sky(instruments.here, track.at(instruments.stamp))))
        instruments.health.follows(MOUNT, distance, not at_rest)
        return distance

    def _conditions(self):
        """Present conditions; the temperature is the last one before the last exposure."""
        site, weather = self._out.sky()
        celsius = self._active.thermometer.before(self.exposed, weather.temperature_c)
        run = self._instruments.run
        return Conditions(site, replace(weather, temperature_c=celsius), self._instruments.here,
                          run, self._table.last_of(run))

    def now(self):
        """Time of the next command: not before the last reading, even if /clock lags."""
        return max(self._instruments.stamp, self._out.now())


class Measured(NamedTuple):
    """Measurements in an exposure.

    Attributes
    ----------
    stamp : int
        Mid-exposure, ns.
    miss : (float, float)
        Star - boresight, rad.
    enc, second : ndarray, shape (2,)
        Encoder readings with the star centred, rad; NaN if unknown for the second.
    rate : ndarray, shape (2,)
        Axis rates, rad/s.
    """

    stamp: int
    miss: tuple
    enc: np.ndarray
    second: np.ndarray
    rate: np.ndarray


def night_row(measured, pointing, conditions, block, blind, instruments, inclinometer, value):
    """The row of an observation.

    Parameters
    ----------
    measured : Measured
    pointing : Pointing
    conditions : Conditions
    block : int
        Number of the step of the plan.
    blind : bool
        Pointed with model and zero alone.
    instruments : Instruments
    inclinometer : pointing_model.active_calibration.Gauge
        Tilt to north and west.
    value : callable
        Returns the value of a parameter of the observer.

    Returns
    -------
    dict
        Names to numbers, rad, and ``stamp``.
    """
    stamp, miss, enc, second, rate = measured
    target, (site, air, *_) = pointing.target, conditions
    power_on, second_on = instruments.power_on, instruments.absolute_power_on
    az, el = (float(v[0]) for v in pointing.place(np.array([stamp]), site, air))
    row = {
        'stamp': stamp, 'time': stamp * 1e-9, 'run': instruments.run,
        'encoder_start': power_on.started if power_on else np.nan,
        'absolute_start': second_on.started if second_on else np.nan, 'block': block,
        'check': float(blind), 'star': target.number, 'az': az, 'el': el,
        'az_enc': enc[0], 'el_enc': enc[1], 'az_abs': second[0], 'el_abs': second[1],
        'miss_x': miss[0], 'miss_y': miss[1], 'az_rate': rate[0], 'el_rate': rate[1],
        'approach_az': pointing.approach[0], 'approach_el': pointing.approach[1],
        'temperature': air.temperature_c, 'pressure': air.pressure_hpa,
        'magnitude': target.magnitude,
    }
    for name, parameter in (('exposure', 'exposure_s'), ('camera_late', 'camera_late_s')):
        if value(parameter):  # no columns if unused
            row[name] = value(parameter)
    if value('inclinometer'):
        row['lean_north'], row['lean_west'] = inclinometer.before(stamp, (np.nan, np.nan))
    if ABSOLUTE not in instruments.names:  # no such encoder: no columns
        for name in ('absolute_start', 'az_abs', 'el_abs'):
            del row[name]
    return row
