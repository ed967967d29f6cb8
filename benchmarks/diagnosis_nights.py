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

"""Simulated nights with effects by independent formulas, for `diagnosis.py` and others."""


import numpy as np

from calibration.estimation.group_columns import orthonormal
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model import geometry
from pointing_model.pointing_terms import PHYSICAL, stacked_design
from pointing_model.runs.run import PointingRun

TRUTH = dict(zip(PHYSICAL, np.array([20.0, -35.0, 25.0, -18.0, 30.0, -22.0, 15.0]) * ARCSEC))
SITE = {'latitude': 34.3 * DEG, 'longitude': 109.0 * DEG}


def sky(rng, n):
    """Stars above 20 degrees in an order that mixes the sky, with all drivers."""
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(20.0 * DEG), np.sin(85.0 * DEG), n))
    return {
        'az': az, 'el': el, 'time': 1.7e9 + np.cumsum(rng.uniform(60.0, 120.0, n)),
        'temperature': 12.0 - 4.0 * np.linspace(0.0, 1.0, n)**0.7 + 0.5 * rng.normal(size=n),
        'approach_az': np.sign(np.append(1.0, np.diff(az))),
        'approach_el': np.sign(np.append(1.0, np.diff(el))),
        'magnitude': rng.uniform(1.0, 6.0, n), 'miss_x': 15.0 * ARCSEC * rng.normal(size=n),
        'miss_y': 15.0 * ARCSEC * rng.normal(size=n),
    }


def noise(rng, kind, el):
    """Unit noise of both axes."""
    if kind == 't4':
        return rng.standard_t(4, size=(2, len(el))) / np.sqrt(2.0)
    e = rng.normal(size=(2, len(el)))
    return e / np.sin(el) if kind == '1/sin E' else e


def make_run(columns, x, y):
    """A run with offsets (x, y), arcsec on the sky, beyond the mount's terms."""
    az_enc, el_enc = geometry.sky_to_encoder(columns['az'], columns['el'], TRUTH)
    return PointingRun({**columns, 'az_enc': az_enc + x * ARCSEC / np.cos(columns['el']),
                        'el_enc': el_enc + y * ARCSEC}, {'site': SITE})


def _terms_of(c, **values):
    """Offsets of terms that differ from row to row, by rotations."""
    exact = np.zeros((2, len(c['az'])))
    for i, (a, e) in enumerate(zip(c['az'], c['el'])):
        row = {k: v[i] for k, v in values.items()}
        both = {k: TRUTH[k] + row.get(k, 0.0) for k in TRUTH}
        exact[:, i] = np.array(geometry.offsets(a, e, both)) - geometry.offsets(a, e, TRUTH)
    return exact


def on_az(c, angle):
    return np.array([angle * np.cos(c['el']), np.zeros_like(angle)])


def on_el(angle):
    return np.array([np.zeros_like(angle), angle])


def _hours(c):
    return (c['time'] - c['time'].mean()) / 3600.0


def _step(c, rng):
    n = len(c['az'])
    return 1.0 * (np.arange(n) >= rng.integers(n // 4, 3 * n // 4))


def _turned(c, axis, angle):
    v = np.array([np.cos(c['el']) * np.sin(c['az']), np.cos(c['el']) * np.cos(c['az']),
                  np.sin(c['el'])])
    w = v + angle * np.cross(axis, v, axis=0)
    w /= np.linalg.norm(w, axis=0)
    return np.array([wrap(np.arctan2(w[0], w[1]) - c['az']) * np.cos(c['el']),
                     np.arcsin(w[2]) - c['el']])


def _equatorial_x(c):
    lst = SITE['longitude'] + 4.894961212735793 + 2.0 * np.pi * 1.00273790935 * (
        (c['time'] - 946728000.0) / 86400.0)
    s, k = np.sin(SITE['latitude']), np.cos(SITE['latitude'])
    return np.array([-np.sin(lst), -s * np.cos(lst), k * np.cos(lst)])


def _aberration(c, v):
    place = np.array([np.cos(c['el']) * np.sin(c['az']), np.cos(c['el']) * np.cos(c['az']),
                      np.sin(c['el'])])
    w = place + v
    w = w / np.linalg.norm(w, axis=0)
    return np.array([wrap(np.arctan2(w[0], w[1]) - c['az']) * np.cos(c['el']),
                     np.arcsin(w[2]) - c['el']])


#: near aliases that are expected on any night: parts of names
CLASSES = (
    ('refraction', 'second_flexure', 'elevation_encoder'),
    ('azimuth_zero_with', 'collimation_with'), ('elevation_zero_with', 'flexure_with'),
    ('azimuth_hysteresis',), ('elevation_hysteresis',), ('tilt_with', 'precession'),
)


def alike(one, two):
    """Whether two names are of one class."""
    return one == two or any(one.startswith(c) and two.startswith(c) for c in CLASSES)


U = 5.0 * ARCSEC  # size before it is scaled
#: name in the dictionary -> (columns, rng) -> offsets (2, n), radians
EFFECTS = {
    'azimuth_encoder_1': lambda c, r: on_az(c, wrap(np.arctan2(
        np.sin(c['az'] - 0.7), np.cos(c['az'] - 0.7) - U) - c['az'] + 0.7)),
    'azimuth_encoder_2': lambda c, r: on_az(c, wrap(np.arctan2(
        (1.0 + U) * np.sin(c['az'] - 1.0), np.cos(c['az'] - 1.0)) - c['az'] + 1.0)),
    'azimuth_encoder_4': lambda c, r: on_az(c, U * np.sin(4.0 * c['az'] + r.uniform(0.0, 6.0))),
    'second_flexure': lambda c, r: on_el(np.arctan2(
        np.sin(c['el']), np.cos(c['el']) - U) - c['el']),
    'elevation_encoder_2': lambda c, r: on_el(
        np.arctan2((1.0 + U) * np.sin(c['el']), np.cos(c['el'])) - c['el']),
    'elevation_encoder_3': lambda c, r: on_el(U * np.sin(3.0 * c['el'] + 0.5)),
    'refraction': lambda c, r: on_el(
        U / np.tan(c['el'] + 7.31 * DEG / (c['el'] / DEG + 4.4))),
    'elevation_nod_3': lambda c, r: on_el(U * np.cos(3.0 * c['az'] + r.uniform(0.0, 6.0))),
    'azimuth_bearing_wobble_2': lambda c, r: _terms_of(
        c, AN=U * np.cos(c['az']), AW=-U * np.sin(c['az'])),
    'fork_cross_term': lambda c, r: on_el(U * np.sin(c['el']) * np.cos(c['az'] - 0.9)),
    'elevation_axis_wobble_2': lambda c, r: _terms_of(c, NPAE=U * np.sin(2.0 * c['el'] + 0.3)),
    'azimuth_zero_with_time': lambda c, r: on_az(c, U * _hours(c)),
    'elevation_zero_with_time': lambda c, r: on_el(U * _hours(c)),
    'elevation_zero_with_time_squared': lambda c, r: on_el(U * _hours(c)**2),
    'azimuth_zero_with_temperature': lambda c, r: on_az(c, U * (c['temperature'] - 9.0)),
    'elevation_zero_with_temperature': lambda c, r: on_el(U * (c['temperature'] - 9.0)),
    'azimuth_zero_step': lambda c, r: on_az(c, U * _step(c, r)),
    'elevation_zero_step': lambda c, r: on_el(U * _step(c, r)),
    'azimuth_hysteresis_cosE': lambda c, r: on_az(c, U * c['approach_az']),
    'elevation_hysteresis': lambda c, r: on_el(U * c['approach_el']),
    'tilt_with_time': lambda c, r: _terms_of(c, AN=0.6 * U * _hours(c), AW=-0.8 * U * _hours(c)),
    'flexure_with_temperature': lambda c, r: _terms_of(c, TF=U * (c['temperature'] - 9.0)),
    'collimation_with_time': lambda c, r: _terms_of(c, CA=U * _hours(c)),
    'precession_or_epoch_error': lambda c, r: _turned(c, _equatorial_x(c), U),
    'annual_aberration': lambda c, r: _aberration(c, U * _equatorial_x(c)),
    'camera_rotation': lambda c, r: np.array([
        np.cos(0.1) * c['miss_x'] - np.sin(0.1) * c['miss_y'] - c['miss_x'],
        np.sin(0.1) * c['miss_x'] + np.cos(0.1) * c['miss_y'] - c['miss_y']]),
    'camera_scale': lambda c, r: 0.05 * np.array([c['miss_x'], c['miss_y']]),
    'magnitude_equation_el': lambda c, r: on_el(U * (c['magnitude'] - 3.0)),
}


def grating(c, x, y, size):
    """Interpolation error at the reading that the encoder really shows: not equal phases."""
    run = make_run(c, x, y)
    phase = 47200.0 * (run['az_enc'] - c['miss_x'] / np.cos(c['el']))
    return np.arctan2(np.sin(phase), np.cos(phase) - size * 47200.0) - np.arctan2(
        np.sin(phase), np.cos(phase))


def _square(c, r):
    waves = int(r.integers(4, 13))
    return np.sign((c['az'] / (2.0 * np.pi) * waves + r.uniform()) % 1.0 - 0.5)


def _bump(c, r):
    d = wrap(c['az'] - r.uniform(0.0, 2.0 * np.pi))
    return np.exp(-0.5 * (d / (r.uniform(12.0, 30.0) * DEG))**2)


def _gap(c, r):
    u = (c['time'] - c['time'][0]) / np.ptp(c['time'])
    start = r.uniform(0.2, 0.6)
    return 1.0 * ((u > start) & (u < start + 0.25))


#: (driver, curve) of effects that no dictionary holds
OUTSIDE = {
    'bump in a narrow azimuth range': ('azimuth', _bump),
    'square wave of azimuth': ('azimuth', _square),
    'sawtooth of elevation': ('elevation', lambda c, r: (
        (c['el'] / (r.uniform(14.0, 30.0) * DEG) + r.uniform()) % 1.0) - 0.5),
    'kink in elevation': ('elevation', lambda c, r: np.maximum(
        c['el'] - r.uniform(35.0, 55.0) * DEG, 0.0)),
    'oscillation in time': ('time', lambda c, r: np.sin(
        2.0 * np.pi * r.uniform(2.0, 5.0) * _hours(c) / np.ptp(_hours(c)) + r.uniform(0.0, 6.0))),
    'excursion in time': ('time', _gap),
}


#: those of time, temperature or order, which one night does not tell from a zero that wanders
OF_TIME = [name for name in EFFECTS
           if any(part in name for part in ('with_time', 'with_temperature', 'zero_step'))]
#: physics fixes their size: at another it is not them
OF_FIXED_SIZE = {'annual_aberration'}


def scaled(c, s, size):
    """The signal with lambda = `size` beyond the seven terms, in units of 1"; None if hidden."""
    basis = orthonormal(stacked_design(PHYSICAL, c['az'], c['el']))
    flat = np.asarray(s).ravel()
    left = np.linalg.norm(flat - (basis @ flat) @ basis)
    if left < 0.05 * np.linalg.norm(flat):
        return None
    return np.asarray(s) * (size / left)
