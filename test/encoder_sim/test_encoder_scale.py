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

import dataclasses

import numpy as np
import pytest

from encoder_sim.encoder_scale import EncoderScale, ZeroDrift
from encoder_sim.graduated_disc import disc_angle
from msg_tools.units import ARCSEC, DEG

TURN = np.linspace(0.0, 2 * np.pi, 361)


def test_one_micrometre_on_79_mm_is_five_arcseconds_once_a_turn():
    error = (disc_angle(TURN, 1e-6, 0.5, 0.0395) - TURN) / ARCSEC
    assert error == pytest.approx(-5.2219 * np.sin(TURN - 0.5), abs=2e-4)


def test_against_circle_and_line():
    # a disc of radius 2 whose centre is 0.3 off, turned by 70 degrees with its axis
    angle, phase, e, radius = 70 * DEG, 20 * DEG, 0.3, 2.0
    centre = -e * np.exp(1j * (angle - phase))
    seen = np.angle((radius - centre) * np.exp(-1j * angle))  # in the frame of the disc
    assert disc_angle(angle, e, phase, radius) == pytest.approx(-seen)


def test_a_second_head_removes_the_first_order():
    one = disc_angle(TURN, 1e-4, 0.5, 0.0395) - TURN
    two = disc_angle(TURN, 1e-4, 0.5, 0.0395, heads=2) - TURN
    assert np.abs(two).max() < 0.002 * np.abs(one).max()
    assert np.abs(two).max() == pytest.approx(0.5 * (1e-4 / 0.0395) ** 2, rel=0.01)


def test_turns_are_kept():
    assert disc_angle(7.0 + 4 * np.pi, 1e-5, 0.2, 0.1) == pytest.approx(
        disc_angle(7.0, 1e-5, 0.2, 0.1) + 4 * np.pi
    )


def test_zero_drift_per_power_on():
    drift = ZeroDrift(EncoderScale(zero_drift=20 * ARCSEC), 1, 'incremental/azimuth')
    values = np.array([drift.at_power_on(k) for k in range(1, 400)]) / ARCSEC
    assert 17.5 < values.std() < 22.5 and abs(values.mean()) < 3.0
    assert drift.at_power_on(7) * 1.0 == values[6] * ARCSEC
    other = ZeroDrift(EncoderScale(zero_drift=20 * ARCSEC), 1, 'incremental/elevation')
    assert other.at_power_on(7) != drift.at_power_on(7)


def test_zero_drifts_as_given():
    drift = ZeroDrift(EncoderScale(zero_drift=1.0, zero_drifts=(0.0, 3.0)), 1, 'a')
    assert [drift.at_power_on(k) for k in (1, 2, 3)] == [0.0, 3.0, 3.0]


def test_later_with_time_and_temperature():
    params = dataclasses.replace(
        EncoderScale(), zero_rate=0.5, zero_slope=2.0, reference_temperature=10.0
    )
    assert ZeroDrift(params, 1, 'a').later(np.array([0.0, 4.0]), 13.0) == pytest.approx([6.0, 8.0])
