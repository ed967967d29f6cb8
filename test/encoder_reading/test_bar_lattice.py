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

import numpy as np
import pytest

from encoder_reading.bar_lattice import BarLattice
from encoder_reading.design import Design
from encoder_reading.disc import BAR_ANGLE, BARS, Disc
from encoder_sim.absolute import Absolute
from encoder_sim.ccd import LinearCCD

HALF = 28


@pytest.mark.parametrize('changes', [
    {}, {'bar_pitch': 60.0, 'blur': 8.0}, {'scale_error': 0.005}, {'scale_error': -0.005},
    {'geometry': 'tangent'}, {'shading_tilt': 0.3, 'shading_falloff': 0.3}])
def test_place_and_scale_whatever_the_bits(changes):
    params = Absolute(**changes)
    places = np.random.default_rng(1).uniform(0.0, 2 * np.pi, 300)
    light = LinearCCD(params, Disc()).light(places)
    alpha, beta = BarLattice(params.design, BARS, HALF).locate(light)
    # a bar's place is where the disc was left, counted from the middle
    expected = -places / BAR_ANGLE
    off = (alpha - expected + 0.5) % 1.0 - 0.5
    assert np.abs(off).max() * params.bar_pitch < 0.3
    assert beta == pytest.approx(params.scale_error, abs=0.002)


def test_pixels_of_the_bars():
    lattice = BarLattice(Design(), BARS, HALF)
    assert lattice.rank.tolist() == list(range(-18, 19))
    pixel, beyond, visible = lattice.pixels(
        np.array([0.0, 0.3], np.float32), np.array([0.0, 0.01], np.float32))
    exact = 899.5 + 48.0 * np.array([lattice.rank, 0.3 + 1.01 * lattice.rank])
    assert (pixel + beyond)[visible] == pytest.approx(exact[visible], abs=1e-3)
    assert np.array_equal(visible, (np.rint(exact) >= HALF) & (np.rint(exact) <= 1799 - HALF))
    assert pixel.min() >= HALF and pixel.max() <= 1799 - HALF
    assert visible[:, 1:-1].all() and not visible.all()


def test_a_flat_row_sees_less_of_the_disc_at_its_ends():
    lattice = BarLattice(Design(geometry='tangent'), BARS, HALF)
    assert lattice.magnification(np.array([0, 899, 1799])) == pytest.approx(
        [0.988, 1.0, 0.988], abs=0.001)
    assert lattice.pixels_of(np.array([0])) == pytest.approx([48.0 / 0.988], abs=0.1)
