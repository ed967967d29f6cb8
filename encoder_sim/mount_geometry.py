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

"""Geometry of the mount by rotations alone: axis angles to the true direction of the tube.

No pointing term is used here. Each error is a small rotation of a part, applied in the order in
which the parts carry each other: ground, first axis, bearing, second axis, tube, camera, and
gravity on the tube.

The frame of the ground is east, north, up (ENU). The axes turn in a frame whose third axis is the
pole of the first axis; for an alt-azimuth mount this is the frame of the ground, for others
`pointing_model.mounts` gives its orientation. The frame of the tube is right, forward, up: at
angles 0 and 0 of a perfect mount it equals the frame of the axes. The tube's right is then the
direction of increasing azimuth, its up that of increasing elevation; through the pole both stay
with the tube, and are reversed on the sky. Gravity acts along the vertical of the ground for all
mounts.
"""

from dataclasses import dataclass

import erfa
import numpy as np

from pointing_model.mounts import parse_mount
from pointing_model.sky.site import DEFAULT_SITE

from .azimuth_track import AzimuthTrack, Bump, Runout, Wobble
from .field_kinds import choice, number, pier_only, section, sections, term, text
from .loose_parts import Cables, Flop, Focuser, Secondary, Yielding

RIGHT, FORWARD, UP = 0, 1, 2
_DOWN = np.array([0.0, 0.0, -1.0])
_FREE, _STIFF, _FIRM = Cables(), Focuser(), Secondary()


@dataclass(frozen=True)
class MountErrors:
    """Geometry of the mount, with the signs of its field: encoder - catalogue.

    The terms are those of an alt-azimuth mount, in the frame of the axes: for other mounts they
    are the same rotations, with the file's own names (IH ID CH NP MA ME TF; `aw` is -MA).
    Likewise `azimuth` and `elevation` are the first and the second axis.

    Attributes
    ----------
    kind : str
        Kind for `mounts.parse_mount`: altaz, equatorial, german, xy, free:AZ,EL[,ROLL]. The
        latitude determines the orientation of an equatorial mount.
    ia, ie : float
        Zero errors of the axes, rad: axis angle - true angle.
    ca : float
        Collimation error, rad; positive: the boresight lies to the left of the tube's axis.
    npae : float
        Non-perpendicularity of the axes, rad; positive: the right end of the second axis is high.
    an, aw : float
        Tilt of the first axis towards its angle 0 (north, the meridian) and towards -90 degrees
        (west; the east for an equatorial mount), rad.
    tf : float
        Sag of the horizontal tube, rad.
    wobble : tuple of Wobble
        Harmonics of the bearing of the first axis.
    bumps : tuple of Bump
        Bumps of its track.
    runouts : tuple of Runout
        Non-repetitive run-out of its bearing.
    yielding : tuple of Yielding
    flop : Flop
    cables : Cables
    focuser : Focuser
    creep, creep_period : float
        The tube creeps back against the drive of the second axis by up to `creep` (rad) as the
        axis turns through `creep_period` (rad), and then snaps back: a sawtooth.
    backlash_azimuth, backlash_elevation : float
        Play between an axis (with its encoders) and the tube, full width, rad.
    fork_sag : float
        Slope of the ends of a fork's arms if they were horizontal, rad. (Equatorial mounts only,
        like everything down to the counterweight.) The arms are cantilevers along the polar axis;
        across their plane the ends, with the declination bearings, turn about the declination axis
        by this times the pull across the polar axis, cos(latitude) cos(hour angle): FO is
        -fork_sag cos(latitude) in the north (TPOINT's catalogue: change in declination as cos h).
        In their plane they are stiff.
    declination_axis_sag : float
        Slope of the end of the declination axis that carries the tube if it were horizontal, rad:
        F L^2 / (2 E I) of a cantilever (any textbook, such as Timoshenko's Strength of Materials).
        It turns the tube about the horizontal across the axis, in proportion to the component of
        its weight across the axis. The tube is on the left end as seen from it: in the east while
        it looks at the meridian from there, with the counterweight down; negative: on the other
        end. So DAF is -declination_axis_sag. (TPOINT's catalogue: the axis of German and cross-axis
        mounts bends downward; its DAB has another factor, the sine of the axis' zenith distance.)
    counterweight_west, counterweight_meridian : float
        Tilt of the polar axis to the west and to the meridian while the counterweight is on its
        west side, and the opposite in the east, rad: MA and ME with two signs. (Users report heads
        that rock in the oversize holes of their bolts: Astro-Physics' group, 2018 and 2020. No
        measured tilt was found.)
    counterweight_by : {'play', 'bending', 'flip'}
        Transition between the sides. play: the imbalance presses the axis to one end of the play
        in bearings and seat, and to the other when the pull, proportional to the cosine of the
        axis' hour angle, changes sign. bending: it bends the axis in proportion to the pull. flip:
        friction holds the axis until the mount goes through the pole.
    ca_rate, an_rate, aw_rate, tf_rate : float
        Drift with time, rad/s.
    ca_slope, an_slope, aw_slope, tf_slope : float
        Change with temperature, rad/degC from `reference_temperature`.
    behind_air : float
        Time constant with which the parts of these terms follow the air temperature, s.
    secondary : Secondary
    """

    kind: str = text('altaz', parse=lambda kind: parse_mount(kind, 0.0))
    ia: float = term('IA', 'arcsec', -36000.0, 36000.0)
    ie: float = term('IE', 'arcsec', -36000.0, 36000.0)
    ca: float = term('CA', 'arcsec', -36000.0, 36000.0)
    npae: float = term('NPAE', 'arcsec', -36000.0, 36000.0)
    an: float = term('AN', 'arcsec', -36000.0, 36000.0)
    aw: float = term('AW', 'arcsec', -36000.0, 36000.0)
    tf: float = term('TF', 'arcsec', -3600.0, 3600.0)
    wobble: tuple = sections(Wobble)
    bumps: tuple = sections(Bump)
    runouts: tuple = sections(Runout)
    yielding: tuple = sections(Yielding)
    flop: Flop = section(Flop)
    cables: Cables = section(Cables)
    focuser: Focuser = section(Focuser)
    creep: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    creep_period: float = number(15.0, 'deg', 0.1, 360.0)
    backlash_azimuth: float = number(0.0, 'arcsec', 0.0, 3600.0)
    backlash_elevation: float = number(0.0, 'arcsec', 0.0, 3600.0)
    fork_sag: float = pier_only(number(0.0, 'arcsec', -3600.0, 3600.0))
    declination_axis_sag: float = pier_only(number(0.0, 'arcsec', -3600.0, 3600.0))
    counterweight_west: float = pier_only(number(0.0, 'arcsec', -3600.0, 3600.0))
    counterweight_meridian: float = pier_only(number(0.0, 'arcsec', -3600.0, 3600.0))
    counterweight_by: str = pier_only(choice('play', 'play', 'bending', 'flip'))
    ca_rate: float = term('CA', 'arcsec_per_hour', -600.0, 600.0)
    an_rate: float = term('AN', 'arcsec_per_hour', -600.0, 600.0)
    aw_rate: float = term('AW', 'arcsec_per_hour', -600.0, 600.0)
    tf_rate: float = term('TF', 'arcsec_per_hour', -600.0, 600.0)
    ca_slope: float = term('CA', 'arcsec_per_degc', -600.0, 600.0)
    an_slope: float = term('AN', 'arcsec_per_degc', -600.0, 600.0)
    aw_slope: float = term('AW', 'arcsec_per_degc', -600.0, 600.0)
    tf_slope: float = term('TF', 'arcsec_per_degc', -600.0, 600.0)
    reference_temperature: float = number(10.0, 'c', -60.0, 60.0)
    behind_air: float = number(0.0, 'h', 0.0, 100.0)
    secondary: Secondary = section(Secondary)

    def at(self, latitude=0.0):
        """The `pointing_model.mounts.Mount` of this kind at `latitude`, rad."""
        return parse_mount(self.kind, latitude)

    @property
    def names(self):
        """Names of its axes and terms: `pointing_model.mount_kinds.MountKind`."""
        return self.at().names


def _about(axis, angle):
    """Rotation matrices about axis 0, 1 or 2, right-handed, shape (..., 3, 3)."""
    turn = (erfa.ufunc.rx, erfa.ufunc.ry, erfa.ufunc.rz)[axis]
    return turn(-np.asarray(angle), np.eye(3))


def _by_vector(vector):
    """Rotation matrices of rotation vectors (..., 3): Rodrigues' formula, shape (..., 3, 3)."""
    vector = np.asarray(vector, dtype=float)
    square = np.sum(vector * vector, axis=-1)[..., np.newaxis, np.newaxis]
    angle = np.sqrt(square)
    x, y, z = np.moveaxis(vector, -1, 0)
    cross = np.zeros((*vector.shape, 3))
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = -z, y, -x
    cross[..., 1, 0], cross[..., 2, 0], cross[..., 2, 1] = z, -y, x
    # sinc keeps both factors regular at zero
    return (
        np.eye(3)
        + np.sinc(angle / np.pi) * cross
        + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * (cross @ cross)
    )


def _lean(towards_x, towards_y):
    """Rotation that tilts the third axis towards the first and the second."""
    towards_x, towards_y = np.broadcast_arrays(towards_x, towards_y)
    return _by_vector(np.stack([-towards_y, towards_x, np.zeros_like(towards_x)], axis=-1))


def direction(az, el):
    """Unit vectors east, north, up of azimuth (north through east) and elevation, (..., 3)."""
    az, el = np.broadcast_arrays(az, el)
    return np.stack([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)], axis=-1)


def azimuth_elevation(vectors):
    """Azimuth in [0, 2 pi) and elevation of ENU vectors (..., 3), rad."""
    east, north, up = np.moveaxis(np.asarray(vectors, dtype=float), -1, 0)
    return np.arctan2(east, north) % (2.0 * np.pi), np.arctan2(up, np.hypot(east, north))


def bent(frames, rotation):
    """Frames (n, 3, 3) of the tube, see `MountGeometry.frames`, turned by vectors (n, 3), rad."""
    return frames @ np.swapaxes(_by_vector(rotation), -1, -2)


class MountGeometry:
    """The parts of a mount and their misalignments.

    Parameters
    ----------
    mount : MountErrors
    start : float
        Start of the night, UTC s, the origin of drifts.
    seed : int
        Seed of the drifts.
    latitude : float
        Latitude of the mount, rad, for the orientation of an equatorial one.
    """

    def __init__(self, mount, start=0.0, seed=0, latitude=DEFAULT_SITE.latitude):
        self.mount = mount
        orientation = mount.at(latitude)
        # columns: the axes of the frame in ENU
        self._orientation = None if orientation.vertical else np.array(orientation.frame).T
        self._zenith = np.array(orientation.zenith)
        self.start = start
        self._track = AzimuthTrack(mount.wobble, mount.bumps, mount.runouts, seed)

    def _drifted(self, name, time, temperature):
        mount = self.mount
        value = getattr(mount, name)
        rate, slope = getattr(mount, f'{name}_rate'), getattr(mount, f'{name}_slope')
        if rate and time is not None:
            value = value + rate * (np.asarray(time, dtype=float) - self.start)
        if slope and temperature is not None:
            value = value + slope * (np.asarray(temperature) - mount.reference_temperature)
        return value

    def frames(self, az, el, *, time=None, temperature=None, approach_az=0.0, approach_el=0.0):
        """The frame of the tube in space.

        Parameters
        ----------
        az, el : ndarray, shape (n,)
            Mechanical angles of the first and the second axis, rad; run-out depends on their turns.
        time : float or ndarray, optional
            UTC s, for drifts and slip; without it there is none.
        temperature : float or ndarray, optional
            degC, for drifts with temperature; without it there is none.
        approach_az, approach_el : float or ndarray
            Sign of the last slew, which determines the side of the backlash.

        Returns
        -------
        ndarray, shape (n, 3, 3)
            Rows are the tube's right, forward (the boresight) and up as ENU unit vectors, so
            that ``frames @ enu`` are the components seen from the tube.
        """
        mount = self.mount
        az = np.atleast_1d(np.asarray(az, dtype=float))
        el = np.atleast_1d(np.asarray(el, dtype=float))
        az, el = np.broadcast_arrays(az, el)
        an, aw, ca, tf = (self._drifted(n, time, temperature) for n in ('an', 'aw', 'ca', 'tf'))

        # the tube lags behind the axis by the play
        turned = az - mount.ia - 0.5 * mount.backlash_azimuth * np.asarray(approach_az)
        raised = el - mount.ie - 0.5 * mount.backlash_elevation * np.asarray(approach_el)

        if mount.creep:
            raised = raised - mount.creep * np.mod(raised / mount.creep_period, 1.0)

        if mount.cables != _FREE:
            pull = mount.cables.pull(turned)
            turned, raised = turned - mount.cables.twist * pull, raised - mount.cables.tip * pull
        raised = raised + sum(part.lift(turned, raised) for part in mount.yielding)

        azimuth = _about(UP, -turned)
        if mount.counterweight_west or mount.counterweight_meridian:
            side = self._counterweight(azimuth, raised)
            aw = aw - mount.counterweight_west * side
            an = an + mount.counterweight_meridian * side
        if not self._track.perfect:
            left, forward = self._track.leans(
                turned, None if time is None else np.asarray(time) - self.start)
            azimuth = azimuth @ _lean(-left, forward)
        if mount.fork_sag:
            azimuth = azimuth @ self._fork(azimuth)
        # tilt the pole of the first axis towards x (-aw) and y (an) of its frame: east and north
        carried = _lean(-np.asarray(aw), an) @ azimuth @ _about(FORWARD, -mount.npae)
        tube = carried @ _about(RIGHT, raised) @ _about(UP, ca)
        if self._orientation is not None:
            tube = self._orientation @ tube
        if mount.declination_axis_sag:
            tube = self._cantilever(self._orientation @ carried) @ tube
        if np.any(tf):
            tube = self._sag(tube, tf) @ tube
        if mount.flop.amplitude:
            tube = self._aside(tube, *mount.flop.shift(tube[..., UP, FORWARD], approach_el))
        if mount.focuser != _STIFF:
            tube = self._aside(tube, *mount.focuser.shift(
                _DOWN @ tube, np.cos(raised) < 0.0))
        if mount.secondary != _FIRM and temperature is not None:
            warmer = np.asarray(temperature) - mount.reference_temperature
            tube = self._aside(tube, 0.0, mount.secondary.shift(_DOWN @ tube, warmer))
        return np.swapaxes(tube, -1, -2)

    def _counterweight(self, azimuth, raised):
        """Effect of the counterweight on the first axis: 1 on the west side, -1 on the east."""
        if self.mount.counterweight_by == 'flip':
            return np.where(np.cos(raised) < 0.0, -1.0, 1.0)
        pull = azimuth[..., RIGHT, RIGHT]  # its shaft points to the tube's right, x to the west
        return np.sign(pull) if self.mount.counterweight_by == 'play' else pull

    def _fork(self, azimuth):
        """Rotation of the ends of the arms, which carry the second axis, in the fork's frame."""
        arms = np.array([0.0, 0.0, 1.0 if self._zenith[UP] >= 0.0 else -1.0])
        pull = np.swapaxes(azimuth, -1, -2) @ -self._zenith
        # a right-handed rotation about arms x pull turns the arms towards the pull
        return _about(RIGHT, self.mount.fork_sag * np.cross(arms, pull)[..., RIGHT])

    def _cantilever(self, carried):
        """Rotation of the end of the second axis that carries the tube, in ENU."""
        return _by_vector(self.mount.declination_axis_sag * np.cross(-carried[..., RIGHT], _DOWN))

    @staticmethod
    def _sag(tube, tf):
        """Bending by gravity, proportional to its pull across the tube."""
        # forward x down: a right-handed rotation about it turns the boresight down
        return _by_vector(np.asarray(tf)[..., np.newaxis] * np.cross(tube[..., FORWARD], _DOWN))

    @staticmethod
    def _aside(tube, right, up):
        """The tube with its line of sight turned to its right and up."""
        right, up = np.broadcast_arrays(right, up)
        return tube @ _by_vector(np.stack([up, np.zeros_like(up), -right], axis=-1))

    def boresight(self, az, el, **where):
        """Unit ENU vectors (n, 3) of the boresight; parameters as in `frames`."""
        return self.frames(az, el, **where)[:, FORWARD]
