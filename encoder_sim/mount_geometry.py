"""Geometry of the mount by rotations alone: axis angles to the true direction of the tube.

No pointing term is used here. Each error is a small rotation of a part, applied in the order in
which the parts carry each other: ground, first axis, bearing, second axis, tube, camera, and
gravity on the tube.

The frame of the ground is east, north, up (ENU). The axes turn in a frame of their own, whose
third axis is the pole of the first one; of an alt-azimuth mount it is that of the ground, of any
other `pointing_model.mounts` says how it stands there. The frame of the tube is right, forward, up:
at angles 0 and 0 of a perfect mount it is that of the axes. The tube's right is then the direction
of rising azimuth, its up that of rising elevation; through the pole both stay with the tube, and
are reversed on the sky. Gravity pulls along the vertical of the ground, whatever the mount.
"""

import numpy as np

from msg_tools.units import wrap
from pointing_model.sky.places import DEFAULT_SITE

from .seeing import ar_noise

RIGHT, FORWARD, UP = 0, 1, 2
_DOWN = np.array([0.0, 0.0, -1.0])


def _about(axis, angle):
    """Rotation matrices about axis 0, 1 or 2, right-handed, shape (..., 3, 3)."""
    angle = np.asarray(angle, dtype=float)
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.zeros((*angle.shape, 3, 3))
    out[..., axis, axis] = 1.0
    out[..., i, i] = out[..., j, j] = c
    out[..., i, j] = -s
    out[..., j, i] = s
    return out


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
    """Rotation that leans the third axis towards the first and the second."""
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
    """Frames (n, 3, 3) of the tube, as of `MountGeometry.frames`, turned by vectors (n, 3), rad."""
    return frames @ np.swapaxes(_by_vector(rotation), -1, -2)


class MountGeometry:
    """The mount's parts and how they are out of true.

    Parameters
    ----------
    mount : scenario.MountErrors
    start : float
        Start of the night, UTC s, from which the drifts count.
    seed : int
        Of what wanders.
    latitude : float
        Where the mount stands, rad: of an equatorial one it decides how.
    """

    def __init__(self, mount, start=0.0, seed=0, latitude=DEFAULT_SITE.latitude):
        self.mount = mount
        stand = mount.at(latitude)
        # columns: the axes of the frame in ENU
        self._stand = None if stand.vertical else np.array(stand.frame).T
        self._zenith = np.array(stand.zenith)
        self.start = start
        self._slips = [
            ar_noise(part.slip_time, seed, 'bearing', f'slip {i}') if part.slip > 0.0 else None
            for i, part in enumerate(mount.runouts)]

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
            Mechanical angles of the first and the second axis, rad; run-out counts their turns.
        time : float or ndarray, optional
            UTC s, for drifts and slip; without it there is none.
        temperature : float or ndarray, optional
            degC, for drifts with temperature; without it there is none.
        approach_az, approach_el : float or ndarray
            Sign of the last slew, for the side on which the tube lies within the backlash.

        Returns
        -------
        ndarray, shape (n, 3, 3)
            Rows are the tube's right, forward (the boresight) and up as ENU unit vectors, so
            that ``frames @ enu`` are the components seen by the tube.
        """
        mount = self.mount
        az = np.atleast_1d(np.asarray(az, dtype=float))
        el = np.atleast_1d(np.asarray(el, dtype=float))
        az, el = np.broadcast_arrays(az, el)
        an, aw, ca, tf = (self._drifted(n, time, temperature) for n in ('an', 'aw', 'ca', 'tf'))

        # the axis leads, the tube follows behind the play
        turned = az - mount.ia - 0.5 * mount.backlash_azimuth * np.asarray(approach_az)
        raised = el - mount.ie - 0.5 * mount.backlash_elevation * np.asarray(approach_el)

        if mount.creep:
            raised = raised - mount.creep * np.mod(raised / mount.creep_period, 1.0)

        azimuth = _about(UP, -turned)
        if mount.counterweight_west or mount.counterweight_meridian:
            side = self._counterweight(azimuth, raised)
            aw = aw - mount.counterweight_west * side
            an = an + mount.counterweight_meridian * side
        if mount.wobble or mount.bumps or mount.runouts:
            azimuth = azimuth @ self._bearing(turned, time)
        if mount.fork_sag:
            azimuth = azimuth @ self._fork(azimuth)
        # up of the first axis in its frame is leant towards x (-aw) and y (an): east and north
        carried = _lean(-np.asarray(aw), an) @ azimuth @ _about(FORWARD, -mount.npae)
        tube = carried @ _about(RIGHT, raised) @ _about(UP, ca)
        if self._stand is not None:
            tube = self._stand @ tube
        if mount.declination_axis_sag:
            tube = self._cantilever(self._stand @ carried) @ tube
        if np.any(tf):
            tube = self._sag(tube, tf) @ tube
        return np.swapaxes(tube, -1, -2)

    def _counterweight(self, azimuth, raised):
        """How far it has pushed the first axis over: 1 on the west side, -1 on the east side."""
        if self.mount.counterweight_by == 'flip':
            return np.where(np.cos(raised) < 0.0, -1.0, 1.0)
        pull = azimuth[..., RIGHT, RIGHT]  # its shaft is the tube's right, west the frame's x
        return np.sign(pull) if self.mount.counterweight_by == 'play' else pull

    def _fork(self, azimuth):
        """The ends of the arms, which carry the second axis, as the fork sees them."""
        arms = np.array([0.0, 0.0, 1.0 if self._zenith[UP] >= 0.0 else -1.0])
        pull = np.swapaxes(azimuth, -1, -2) @ -self._zenith
        # right-handed about arms x pull the arms turn towards the pull
        return _about(RIGHT, self.mount.fork_sag * np.cross(arms, pull)[..., RIGHT])

    def _cantilever(self, carried):
        """The end of the second axis that carries the tube, in ENU."""
        return _by_vector(self.mount.declination_axis_sag * np.cross(-carried[..., RIGHT], _DOWN))

    def _bearing(self, turned, time):
        leans = {'forward': np.zeros_like(turned), 'left': np.zeros_like(turned)}
        for part in self.mount.wobble:
            leans[part.lean] += part.amplitude * np.cos(part.per_turn * turned - part.phase)
        for bump in self.mount.bumps:
            away = wrap(turned - bump.at)
            leans[bump.lean] += bump.amplitude * np.exp(-0.5 * (away / bump.width) ** 2)
        for part, slip in zip(self.mount.runouts, self._slips):
            phase = part.per_turn * turned - part.phase
            if slip is not None and time is not None:
                phase = phase + part.slip * slip.at(np.asarray(time) - self.start)
            leans[part.lean] += part.amplitude * np.cos(phase)
        return _lean(-leans['left'], leans['forward'])

    @staticmethod
    def _sag(tube, tf):
        """Bending by gravity, proportional to its pull across the tube."""
        # forward x down: right-handed about it, the boresight turns towards down
        return _by_vector(np.asarray(tf)[..., np.newaxis] * np.cross(tube[..., FORWARD], _DOWN))

    def boresight(self, az, el, **where):
        """Unit ENU vectors (n, 3) of the boresight; parameters as for `frames`."""
        return self.frames(az, el, **where)[:, FORWARD]
