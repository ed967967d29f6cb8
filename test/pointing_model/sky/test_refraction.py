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

"""Refraction of a star and of what is near."""

import erfa
import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import Weather, refracted_elevation
from pointing_model.sky.site import Site
from pointing_model.sky.star_catalogue import load_catalogue

SITE, AIR, VACUUM = Site(), Weather(), Weather(pressure_hpa=0.0)
START = 1379721600.0  # 2013-09-21


def test_refraction_of_a_star_is_that_of_the_sky():
    stars = load_catalogue(3.0)
    _, true = observed_place(stars, START, SITE, VACUUM)
    _, seen = observed_place(stars, START, SITE, AIR)
    up = true > 3.0 * DEG
    assert up.sum() > 50
    assert np.max(np.abs(refracted_elevation(true[up], AIR) - seen[up])) < 1e-7 * ARCSEC


def _traced(zenith_distance, distance, weather, radius):
    """True zenith distance of what is seen at `zenith_distance`, by its ray through the air.

    Spherical shells, exponential air with the scale height of ERFA's model.
    """
    refa, refb = erfa.refco(weather.pressure_hpa, weather.temperature_c, weather.humidity,
                            weather.wavelength_um)
    excess = 1.0 - np.sqrt(1.0 - 2.0 * (refa - refb))
    scale = 4.4474e-6 * (weather.temperature_c + 273.15) * radius
    edges = radius + np.linspace(0.0, 150e3, 20001)
    index = 1.0 + excess * np.exp(-(0.5 * (edges[1:] + edges[:-1]) - radius) / scale)
    invariant = (1.0 + excess) * radius * np.sin(zenith_distance)
    low, high = (np.arcsin(invariant / (index * r)) for r in (edges[:-1], edges[1:]))
    angle = np.sum(low - high)  # at the Earth's centre
    far = radius + distance
    angle += np.arcsin(invariant / edges[-1]) - np.arcsin(invariant / far)
    return np.arctan2(far * np.sin(angle), far * np.cos(angle) - radius)


@pytest.mark.parametrize('altitude', [400e3, 20200e3])
@pytest.mark.parametrize('seen', [20.0, 35.0, 70.0])
def test_parallactic_refraction_by_ray_tracing(seen, altitude):
    """What the finite distance changes, against a ray through 20 000 shells of air."""
    radius, z = 6.37e6, np.pi / 2.0 - seen * DEG
    near = _traced(z, altitude, AIR, radius)
    far = _traced(z, 1e15, AIR, radius)
    distance = np.sqrt((radius + altitude)**2 - (radius * np.sin(near))**2) - radius * np.cos(near)
    expected = (far - near) / ARCSEC
    el = np.pi / 2.0 - near
    measured = refracted_elevation(el, AIR) - refracted_elevation(el, AIR, distance, radius)
    assert expected > 0.0
    assert measured / ARCSEC == pytest.approx(expected, rel=0.03)
