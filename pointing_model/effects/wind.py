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

"""Wind and what else pulls to one direction of the horizon, wherever the tube looks."""

import numpy as np

from msg_tools.units import DEG

from .base import Effect, Offer, arcsec, effect, form

_EAST, _NORTH = np.eye(3)[:2, :, None]


@form
def _bent_to_one_side():
    def of(c):
        return [tuple(np.sum(axis * t, axis=0) for t in c.tangent()) for axis in (_EAST, _NORTH)]

    def wording(amount):
        east, north = amount.values
        toward = np.arctan2(east, north) / DEG % 360.0
        return (f'The tube is bent by up to {arcsec(float(np.hypot(east, north)))} toward azimuth '
                f'{toward:.0f}°, wherever it looks')

    return Effect('bent_to_one_side',
                  'the tube is bent toward one direction of the horizon',
                  'the part across the line of sight of a dipole fixed to the horizon', 'azimuth',
                  'both', ('east', 'north'), of, wording,
                  'steady wind on tube and dome slit, a cable that pulls',
                  'a pull toward one direction of the horizon')


def propose(context, lacking, own):
    """For every mount."""
    yield Offer('bent_to_one_side', [effect('bent_to_one_side')])
