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

"""Simulated runs of equatorial mounts with effects by independent formulas, for `equatorial.py`."""


import numpy as np

from calibration.estimation.group_columns import orthonormal
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model import geometry
from pointing_model.mounts import Mount, is_beyond
from pointing_model.pointing_terms import stacked_design
from pointing_model.runs.run import PointingRun

LATITUDE = 31.0 * DEG
TRUTH = np.array([40.0, -60.0, 35.0, -28.0, 30.0, -45.0, 15.0]) * ARCSEC


def mount_of(kind):
    """The mount that is simulated."""
    return Mount.equatorial(LATITUDE, kind)


def sky(rng, n, mount):
    """Stars above 20 degrees in an order that mixes the sky, with all drivers."""
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(20.0 * DEG), np.sin(85.0 * DEG), n))
    h, _ = mount.axes_of(az, el)
    a, e = mount.axes_of(az, el, (h < 0.0) & (mount.two_sided))
    return {
        'az': a, 'el': e, 'time': 1.7e9 + np.cumsum(rng.uniform(60.0, 120.0, n)),
        'temperature': 12.0 - 4.0 * np.linspace(0.0, 1.0, n)**0.7 + 0.5 * rng.normal(size=n),
        'approach_az': np.sign(np.append(1.0, np.diff(a))),
        'approach_el': np.sign(np.append(1.0, np.diff(e))),
        'magnitude': rng.uniform(1.0, 6.0, n), 'miss_x': 15.0 * ARCSEC * rng.normal(size=n),
        'miss_y': 15.0 * ARCSEC * rng.normal(size=n)}


def terms_of_truth(mount):
    """Terms of the simulated mount."""
    return dict(zip(mount.names.physical, TRUTH))


def make_run(c, x, y, mount):
    """A run with offsets (x, y), arcsec on the sky along its axes, beyond the mount's terms."""
    a, e = geometry.sky_to_encoder(c['az'], c['el'], terms_of_truth(mount), mount)
    return PointingRun({**c, 'az_enc': a + x * ARCSEC / np.cos(c['el']), 'el_enc': e + y * ARCSEC},
                       {'mount': mount})


U = 5.0 * ARCSEC  # size before it is scaled


def _on_first(c, angle, _=None):
    return np.array([angle * np.cos(c['el']), 0.0 * angle])


def _on_second(angle):
    return np.array([0.0 * angle, angle])


def _moved(c, mount, az, el):
    """Offsets of stars seen at another place of the horizon."""
    a, e = mount.axes_of(az, el, is_beyond(c['el']))
    return np.array([wrap(a - c['az']) * np.cos(c['el']), wrap(e - c['el'])])


def _lifted(c, mount, by):
    az, el = mount.horizon_of(c['az'], c['el'])
    return _moved(c, mount, az, el + by(el))


def _varying(c, mount, **values):
    """Offsets of terms that differ from row to row, by rotations."""
    truth, out = terms_of_truth(mount), np.zeros((2, len(c['az'])))
    for i, (a, e) in enumerate(zip(c['az'], c['el'])):
        both = {k: v + (values[k][i] if k in values else 0.0) for k, v in truth.items()}
        out[:, i] = np.array(geometry.offsets(a, e, both, mount)) - geometry.offsets(
            a, e, truth, mount)
    return out


def _disc(angle, phase, shift, order=1):
    """Error of a disc off its centre (once a turn), or oval (twice)."""
    if order == 1:
        return wrap(np.arctan2(np.sin(angle - phase), np.cos(angle - phase) - shift)
                    - angle + phase)
    return wrap(np.arctan2((1.0 + shift) * np.sin(angle - phase), np.cos(angle - phase))
                - angle + phase)


def _hours(c):
    return (c['time'] - c['time'].mean()) / 3600.0


def _side(c):
    return np.where(is_beyond(c['el']), -1.0, 1.0)


def _bennett(el):
    return U / np.tan(el + 7.31 * DEG / (el / DEG + 4.4))


#: name in the dictionary -> (columns, mount, rng) -> offsets (2, n), radians
EFFECTS = {
    'hour_angle_encoder_1': lambda c, m, r: _on_first(c, _disc(c['az'], 0.7, U)),
    'hour_angle_encoder_2': lambda c, m, r: _on_first(c, _disc(c['az'], 1.0, U, 2)),
    'hour_angle_encoder_4': lambda c, m, r: _on_first(
        c, U * np.sin(4.0 * c['az'] + r.uniform(0.0, 6.0))),
    'declination_encoder_1': lambda c, m, r: _on_second(_disc(c['el'], 0.4, U)),
    'declination_encoder_2': lambda c, m, r: _on_second(_disc(c['el'], 0.9, U, 2)),
    'fork_flexure': lambda c, m, r: _on_second(U * np.cos(c['az'])),
    'declination_axis_flexure': lambda c, m, r: np.array(
        [-U * np.sin(m.horizon_of(c['az'], c['el'])[1]), 0.0 * c['az']]),
    'refraction': lambda c, m, r: _lifted(c, m, _bennett),
    'second_flexure': lambda c, m, r: _lifted(c, m, lambda el: U * np.sin(el)),
    'declination_nod_3': lambda c, m, r: _on_second(U * np.cos(3.0 * c['az']
                                                              + r.uniform(0.0, 6.0))),
    'line_of_sight_2': lambda c, m, r: _varying(c, m, CH=U * np.sin(2.0 * c['az'] + 0.3)),
    'hour_angle_bearing_wobble_2': lambda c, m, r: _varying(
        c, m, ME=U * np.cos(c['az']), MA=U * np.sin(c['az'])),
    'declination_axis_wobble_2': lambda c, m, r: _varying(c, m, NP=U * np.sin(2.0 * c['el'] + 0.3)),
    'hour_angle_zero_with_time': lambda c, m, r: _on_first(c, U * _hours(c)),
    'declination_zero_with_time': lambda c, m, r: _on_second(U * _hours(c)),
    'declination_zero_with_temperature': lambda c, m, r: _on_second(U * (c['temperature'] - 9.0)),
    'hour_angle_hysteresis_cosE': lambda c, m, r: _on_first(c, U * c['approach_az']),
    'declination_hysteresis': lambda c, m, r: _on_second(U * c['approach_el']),
    'flexure_with_temperature': lambda c, m, r: _varying(c, m, TF=U * (c['temperature'] - 9.0)),
    'tilt_with_time': lambda c, m, r: _varying(c, m, ME=0.6 * U * _hours(c),
                                               MA=-0.8 * U * _hours(c)),
    'camera_rotation': lambda c, m, r: np.array([
        np.cos(0.1) * c['miss_x'] - np.sin(0.1) * c['miss_y'] - c['miss_x'],
        np.sin(0.1) * c['miss_x'] + np.cos(0.1) * c['miss_y'] - c['miss_y']]),
    'magnitude_equation_el': lambda c, m, r: _on_second(U * (c['magnitude'] - 3.0)),
}
#: of a German mount: what hangs on the other end of the axis
BY_SIDE = {
    'ME_by_side': lambda c, m, r: _varying(c, m, ME=U * _side(c)),
    'MA_by_side': lambda c, m, r: _varying(c, m, MA=U * _side(c)),
    'IH_by_side': lambda c, m, r: _on_first(c, U * _side(c)),
    'ID_by_side': lambda c, m, r: _on_second(U * _side(c)),
    'TF_by_side': lambda c, m, r: _varying(c, m, TF=U * _side(c)),
    'NP_by_side': lambda c, m, r: _varying(c, m, NP=U * _side(c)),
}


def scaled(c, s, size, mount):
    """The signal with lambda = `size` beyond the seven terms, in units of 1"; None if hidden."""
    basis = orthonormal(stacked_design(mount.names.physical, c['az'], c['el'], mount))
    flat = np.asarray(s).ravel()
    left = np.linalg.norm(flat - (basis @ flat) @ basis)
    if left < 0.05 * np.linalg.norm(flat):
        return None
    return np.asarray(s) * (size / left)
