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

import json

import numpy as np
import pytest

from msg_tools.units import ARCSEC
from pointing_model.active_calibration import ActiveCalibration
from pointing_model.encoder_difference import Difference
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun
from pointing_model.zero import PowerOnZero
from pointing_model.zero_drift import KEY, AxisFollowing, Following, harmonic_columns

DISCS = np.array([0.3, -0.2, 0.1, 0.05]) * ARCSEC
ELEVATION = Following({'el': AxisFollowing(
    DISCS, {1: 8.0 * ARCSEC, 2: -3.0 * ARCSEC}, 0.4 * ARCSEC, 0.3 * ARCSEC)})


def readings(n=6, seed=1):
    """Both encoders of both axes, shape (2, n), and what elevation has wandered, (n,)."""
    rng = np.random.default_rng(seed)
    absolute = np.array([rng.uniform(0.0, 6.0, n), rng.uniform(0.4, 1.4, n)])
    moved = np.cumsum(rng.normal(size=n)) * ARCSEC
    incremental = absolute + 20.0 * ARCSEC
    # the discs are a function of the incremental encoder's own angle
    incremental[1] = absolute[1] + 8.0 * ARCSEC + moved
    for _ in range(3):
        incremental[1] = absolute[1] + 8.0 * ARCSEC + moved \
            + harmonic_columns(incremental[1]) @ DISCS
    return incremental, absolute, moved


def table(check, run=1.0, seed=1):
    incremental, absolute, moved = readings(len(check), seed)
    return PointingRun({
        'az': absolute[0], 'el': absolute[1], 'az_enc': incremental[0], 'el_enc': incremental[1],
        'az_abs': absolute[0], 'el_abs': absolute[1], 'check': np.array(check, float),
        'run': np.broadcast_to(run, len(check)).astype(float)}), moved


def test_what_has_wandered_is_told_from_discs_and_reference():
    incremental, absolute, moved = readings()
    found = ELEVATION.moved(1, incremental, absolute)
    assert not found[0].any()
    np.testing.assert_allclose(found[1] / ARCSEC, moved / ARCSEC, atol=1e-6)
    # each power-on has its reference; one without does not follow
    np.testing.assert_allclose(
        (ELEVATION.moved(2, incremental, absolute)[1] - found[1]) / ARCSEC, 11.0)
    assert not ELEVATION.moved(3, incremental, absolute).any()
    assert not ELEVATION.moved(1, incremental, absolute * np.nan).any()
    assert not Following() and not Following().moved(1, incremental, absolute).any()


def test_rows_to_fit_by_are_corrected_by_their_own_readings():
    rows, moved = table([0, 0, 0, 0])
    out = ELEVATION.corrected(rows)
    np.testing.assert_allclose((rows['el_enc'] - out['el_enc']) / ARCSEC, moved / ARCSEC, atol=1e-6)
    np.testing.assert_array_equal(out['az_enc'], rows['az_enc'])
    assert Following().corrected(rows) is rows
    without = PointingRun({k: v for k, v in rows.columns.items() if not k.endswith('_abs')})
    assert ELEVATION.corrected(without) is without


def test_a_blind_row_is_corrected_by_what_was_known_before():
    rows, moved = table([0, 1, 1, 0])
    rows.columns['el_abs'][1] = np.nan
    off = (rows['el_enc'] - ELEVATION.corrected(rows)['el_enc']) / ARCSEC
    # the second blind row looks past the one without a reading
    np.testing.assert_allclose(off, moved[[0, 0, 0, 3]] / ARCSEC, atol=1e-6)
    # before the first row of a power-on nothing is known of it: its own reading
    rows, moved = table([0, 1, 1], run=[1.0, 2.0, 2.0])
    off = (rows['el_enc'] - ELEVATION.corrected(rows)['el_enc']) / ARCSEC
    np.testing.assert_allclose(off, moved[[0, 1, 1]] / ARCSEC + [0.0, 11.0, 11.0], atol=1e-6)


def test_it_travels_in_the_model():
    model = PointingModel({'IA': 1e-5}, provenance={KEY: ELEVATION.document()})
    again = Following.from_model(PointingModel.from_json(model.to_json()))
    assert list(again.axes) == ['el'] and again.axes['el'].references.keys() == {1, 2}
    np.testing.assert_allclose(again.axes['el'].discs, DISCS)
    np.testing.assert_allclose(again.sigma() / ARCSEC, [0.0, 0.5])
    told = json.loads(model.to_json())['provenance'][KEY]['elevation']
    assert told['follows'] == 'absolute encoder'
    assert told['reference'][0] == {'run': 1, 'difference_arcsec': pytest.approx(8.0)}
    assert not Following.from_model(None) and not Following.from_model(PointingModel({}))
    for damaged in ({'elevation': {}}, {'azimuth': 3}, {'elevation': {'discs_arcsec': {}}}):
        with pytest.raises(ValueError, match='zero_follows of the model is damaged'):
            Following.from_model(PointingModel({}, provenance={KEY: damaged}))


def in_force(zero=(5.0, 6.0)):
    model = PointingModel({'IE': 40.0 * ARCSEC}, provenance={
        KEY: ELEVATION.document(),
        'zeros_in_force': [{'run': 1, 'az_arcsec': 5.0, 'el_arcsec': 6.0}]})
    out = ActiveCalibration(model)
    out.update_zero(1, PowerOnZero(*np.array(zero) * ARCSEC, np.eye(2) * ARCSEC**2, 1))
    return out


def test_the_zero_in_force_follows_between_stars():
    now = in_force()
    assert now.follows and 'stands still' in now.following()
    az, el = np.array([1.0]), np.array([0.8])
    standing = now.encoder(az, el)
    incremental, absolute, moved = readings()
    for k in range(3):
        now.update_readings(1, incremental[:, k], absolute[:, k])
        np.testing.assert_allclose(
            (now.zero_now - now.zero.angles) / ARCSEC, [0.0, moved[k] / ARCSEC], atol=1e-6)
        np.testing.assert_allclose(
            (now.encoder(az, el) - standing) / ARCSEC, [[0.0, moved[k] / ARCSEC]], atol=1e-6)
    assert f'elevation by {moved[2] / ARCSEC:+.2f} arcsec' in now.following()
    np.testing.assert_allclose(now.zero_sigma / ARCSEC, [1.0, np.hypot(1.0, 0.5)])
    # a reading that is none changes nothing
    now.update_readings(1, incremental[:, 0], absolute[:, 0] * np.nan)
    assert f'elevation by {moved[2] / ARCSEC:+.2f} arcsec' in now.following()


def test_a_zero_of_another_model_does_not_follow():
    now = in_force(zero=(350.0, 6.0))
    incremental, absolute, _ = readings()
    now.update_readings(1, incremental[:, 0], absolute[:, 0])
    assert not now.follows and now.following() == ''
    np.testing.assert_array_equal(now.zero_now, now.zero.angles)
    np.testing.assert_allclose(now.zero_sigma / ARCSEC, 1.0)


def test_a_power_on_of_the_absolute_encoder_stops_it():
    follows = Following({'el': AxisFollowing(DISCS, {1: 8.0 * ARCSEC, 2: -3.0 * ARCSEC},
                                             starts={1: 1000.5})})
    np.testing.assert_array_equal(
        follows.stopped([1, 1, 1, 2], [1000.5, 2000.0, np.nan, 2000.0]),
        [False, True, False, False])
    rows, moved = table([0, 0, 0, 0, 1])
    rows = PointingRun({**rows.columns,
                        'absolute_start': np.array([1000.5, 1000.5, 2000.0, 2000.0, 2000.0])})
    # it has another zero from then on: what had been seen by then stays
    rows['el_abs'][2:] += 60.0 * ARCSEC
    off = (rows['el_enc'] - follows.corrected(rows)['el_enc']) / ARCSEC
    np.testing.assert_allclose(off, moved[[0, 1, 1, 1, 1]] / ARCSEC, atol=1e-6)
    again = Following.from_model(PointingModel({}, provenance={
        KEY: json.loads(json.dumps(follows.document()))}))
    assert again.axes['el'].starts == {1: 1000.5}

    now = ActiveCalibration(PointingModel({}, provenance={KEY: follows.document()}))
    now.update_zero(1, PowerOnZero(0.0, 0.0, np.eye(2) * ARCSEC**2, 1))
    incremental, absolute, moved = readings()
    now.update_readings(1, incremental[:, 0], absolute[:, 0], 1000.5)
    assert now.complaints() == []
    now.update_readings(1, incremental[:, 1], absolute[:, 1] + 60.0 * ARCSEC, 2000.0)
    np.testing.assert_allclose(now.zero_now[1] / ARCSEC, moved[0] / ARCSEC, atol=1e-6)
    assert now.following().startswith('absolute encoder: stopped, it was switched off and on')
    (complaint,) = now.complaints()
    assert 'no longer follows the absolute encoder' in complaint and 'calibrate_zero' in complaint


def test_streams_of_both_encoders_are_paired_where_the_mount_is_slow():
    both = Difference()
    tick = 10**8
    for k in range(5):
        both.update_incremental(k * tick, np.array([1.0 + 1e-6 * k, 0.5]))
    assert both.incremental is None
    both.update_absolute(2 * tick + tick // 2, np.array([0.9, 0.4]))  # between two of the other
    np.testing.assert_allclose(both.incremental, [1.0 + 2.5e-6, 0.5])
    np.testing.assert_array_equal(both.absolute, [0.9, 0.4])
    both.update_absolute(6 * tick, np.array([0.7, 0.4]))  # not there yet
    assert both.absolute[0] == 0.9
    both.update_incremental(6 * tick, np.array([1.5, 0.5]))  # and then in a slew
    assert both.absolute[0] == 0.9
    both.update_incremental(7 * tick, np.array([1.5, 0.5]))
    both.update_absolute(7 * tick, np.array([1.4, np.nan]))
    assert both.absolute[0] == 0.9
    both.update_absolute(7 * tick, np.array([1.4, 0.4]))
    assert both.absolute[0] == 1.4
    both.update_incremental(tick, np.array([1.0, 0.5]))  # the clock began anew
    both.update_incremental(2 * tick, np.array([1.0, 0.5]))
    both.update_absolute(2 * tick, np.array([0.8, 0.4]))
    assert both.absolute[0] == 0.8
