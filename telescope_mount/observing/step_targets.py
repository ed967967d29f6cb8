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

"""Targets of a step of the plan under present conditions."""

import numpy as np

from msg_tools.steps import CallRefused
from msg_tools.units import DEG
from pointing_model.sky.star_catalogue import POLARIS_HIP, StarTarget, load_catalogue

from .star_choice import AxisLimits, choose_stars
from .star_order import seconds_a_star, weight_of_slews
from .zero_method import ZeroChoice


class StepTargets:
    """Chooses targets from the catalogue by the parameters of the observer.

    Parameters
    ----------
    outbox, instruments, active, table
        See `sequencer.Sequencer`.
    exposer : Exposer
        It gives the time of the next exposure.
    """

    def __init__(self, outbox, instruments, active, table, exposer):
        self._out, self._instruments, self._active = outbox, instruments, active
        self._table, self._exposer = table, exposer

    @property
    def stars(self):
        """The catalogue, two magnitudes deeper to include disturbing neighbours."""
        return load_catalogue(mag_limit=self._out.value('magnitude_limit') + 2.0)

    @property
    def polaris(self):
        """Polaris as a target."""
        return StarTarget(load_catalogue(hip=[POLARIS_HIP]))

    def limits(self):
        """Limits of the axes, `AxisLimits`."""
        return AxisLimits.of(self._out.value, self._out.guard.allowed)

    def all_over_the_sky(self, count, block, exclude, stay_up=True, between=(0.0, 90.0)):
        """`count` targets, in observing order.

        Parameters
        ----------
        count, block : int
            Number of targets, and block of the plan: each block has other stars.
        exclude : sequence of int
            Numbers of stars to exclude.
        stay_up : bool
            Whether they stay within the limits until all are observed.
        between : (float, float)
            Preferred range of elevation, deg, as far as the limits permit.
        """
        value = self._out.value
        lowest, highest = value('min_elevation_deg'), value('max_elevation_deg')
        if max(lowest, between[0]) < min(highest, between[1]):
            lowest, highest = max(lowest, between[0]), min(highest, between[1])
        rate = value('slew_rate_deg_s')
        rows = choose_stars(
            self.stars, self._exposer.now() * 1e-9, *self._out.sky(), count,
            value('star_seed') + block, lowest * DEG, highest * DEG, value('magnitude_limit'),
            exclude=exclude, duration=count * seconds_a_star(rate) if stay_up else 0.0,
            start=self._instruments.here, mount=self._out.mount(), limits=self.limits(),
            slews=weight_of_slews(rate))
        return [StarTarget(self.stars.select([row])) for row in rows]

    def for_zero(self, evening):
        """Exposures to set a zero, a `ZeroChoice`; the night began at `evening`, ns."""
        return ZeroChoice(
            self.stars, self._table, self._exposer.now() * 1e-9, *self._out.sky(),
            mount=self._out.mount(), axes=self.limits(), model=self._active.model,
            run=self._instruments.run, evening=evening, here=self._instruments.here,
            limits=[self._out.value(name) for name in (
                'min_elevation_deg', 'max_elevation_deg', 'magnitude_limit')],
            a_star=seconds_a_star(self._out.value('slew_rate_deg_s')))

    def check_polaris(self):
        """Refuse a plan with Polaris if it cannot give a zero."""
        self.check_height(self.polaris, 'Polaris', 'set the zero on stars (zero_on_stars)')
        time, mount = np.array([self._exposer.now() * 1e-9]), self._out.mount()
        place = self.polaris.place(time, *self._out.sky())
        highest = self._out.value('max_elevation_deg')
        if not AxisLimits().reached(mount, *place, highest * DEG, time[0], [POLARIS_HIP])[0]:
            angle = abs(mount.axes_of(*place)[1][0])
            raise CallRefused(f'Polaris stands at {angle / DEG:.1f} deg of {mount.names.axes[1]}, '
                              f'beyond max_elevation_deg = {highest}, and gives no zero of the '
                              f'{mount.names.axes[0]} there: set it on stars (zero_on_stars)')

    def check_height(self, target, name, remedy):
        """Refuse a target that is too low."""
        lowest = self._out.value('min_elevation_deg')
        time = np.array([self._exposer.now() * 1e-9])
        el = target.place(time, *self._out.sky())[1][0]
        if el < lowest * DEG:
            raise CallRefused(f'{name} stands at {el / DEG:.1f} deg, below min_elevation_deg = '
                              f'{lowest}: {remedy}')
