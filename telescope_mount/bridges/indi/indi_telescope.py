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

"""A telescope of an INDI server: its properties in SI, its readings tick by tick.

It is slewed, tracked, stopped and parked. It is never synchronised: that would move the zero that
is to be measured.
"""

import threading
import time

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap

from ..axes_and_places import HOUR
from ..goto_mount import Tick
from .client import PATIENCE, IndiError, Vector

PLACE, TRUE_PLACE, AXES = 'EQUATORIAL_EOD_COORD', 'EQUATORIAL_PE', 'MOUNT_AXES'
#: of an alt-azimuth mount, where it reports that it looks, degrees
HORIZONTAL = 'HORIZONTAL_COORD'
PARK, ABORT, TRACK = 'TELESCOPE_PARK', 'TELESCOPE_ABORT_MOTION', 'TELESCOPE_TRACK_STATE'
ON_SET, SITE, SIDE = 'ON_COORD_SET', 'GEOGRAPHIC_COORD', 'TELESCOPE_PIER_SIDE'
RATE, KIND, CLOCK, CONNECTION = 'TELESCOPE_SLEW_RATE', 'MOUNT_TYPE', 'TIME_UTC', 'CONNECTION'
MODE, RATES, CUSTOM = 'TELESCOPE_TRACK_MODE', 'TELESCOPE_TRACK_RATE', 'TRACK_CUSTOM'
#: programs that simulate one: that of INDI, and one of `examples/simulated_servers`
SIMULATOR, TWO_AXES = 'indi_simulator_telescope', 'two_axes'
#: bit of DRIVER_INTERFACE of a telescope
TELESCOPE = 1
#: what a driver calls a kind of mount -> `pointing_model.mounts.KINDS`
KINDS = {'ALTAZ': 'altaz', 'EQ_FORK': 'equatorial', 'EQ_GEM': 'german'}
#: readings that come within so much of each other are of one tick, ns: a driver sends them at once
TICK = 30_000_000
#: s that a driver has to tell the rest of its properties, once it tells where it looks
SETTLING = 2.0


def find_device(client, wanted='', timeout=PATIENCE):
    """Name of the telescope on a server.

    Parameters
    ----------
    client : IndiClient
    wanted : str
        Its name; '': the only one that is there.

    Raises
    ------
    IndiError
        It is not there, or there are several.
    """
    if wanted:
        client.property(wanted, CONNECTION, timeout)
        return wanted
    return client.only('telescope', TELESCOPE, timeout)


def is_simulator(telescope):
    """Whether it is INDI's telescope simulator, or the two axes of `examples/simulated_servers`."""
    return _driver(telescope) in (SIMULATOR, TWO_AXES)


def _driver(telescope):
    return telescope.last('DRIVER_INFO').values.get('DRIVER_EXEC')


def check_kind(telescope, kind):
    """Raise IndiError where a driver of an alt-azimuth mount tells axes of another one."""
    if kind == 'altaz' and _driver(telescope) == SIMULATOR:
        raise IndiError(f'{telescope.device} is set to ALTAZ, but its axes are hour angle and '
                        'declination: set its MOUNT_TYPE to EQ_FORK or EQ_GEM. For an alt-azimuth '
                        'one: python examples/simulated_servers/indi_simulator.py --kind altaz')


def knows_where_it_looks(telescope):
    """Raise IndiError where the position that a driver reports is what it believes."""
    if telescope.get(TRUE_PLACE) is None and not is_simulator(telescope):
        raise IndiError(f'{telescope.device} reports what it believes, not what is seen: start a '
                        'camera of your own that publishes camera/miss_distance, and leave '
                        'indi_sky out')


class IndiTelescope:
    """One device.

    Parameters
    ----------
    client : IndiClient
        Connected or about to be.
    device : str
        As of `find_device`.
    axes : str
        Property with the axis angles and its two elements, degrees, ``NAME:FIRST,SECOND``; ''
        for `AXES` where the driver has it, of an alt-azimuth mount `HORIZONTAL`, else the place
        that it reports.
    altaz : bool
        Whether it is an alt-azimuth mount.
    """

    def __init__(self, client, device, axes='', altaz=False):
        self.client, self.device, self._rates = client, device, np.zeros(2)
        self._reported = altaz and not axes
        axes = axes or (f'{HORIZONTAL}:AZ,ALT' if altaz else f'{AXES}:PRIMARY,SECONDARY')
        self._axes_property, _, elements = axes.partition(':')
        self._elements = tuple(elements.split(','))
        if len(self._elements) != 2:
            raise ValueError(f'{axes!r}: write the property of the axis angles as '
                             'NAME:FIRST,SECOND')

    # --- its state ----------------------------------------------------------------------------

    def get(self, name):
        """A `Vector`, None where it has not come."""
        return self.client.get(self.device, name)

    def last(self, name):
        """A `Vector`, without values where it has not come."""
        return self.client.get(self.device, name, Vector({}))

    def connect(self, timeout=PATIENCE):
        """Have the server connect to the mount, and hear all that its driver defines.

        IndiError where it does not.
        """
        state = self.client.property(self.device, CONNECTION, timeout)
        if state.on != 'CONNECT':
            self.client.switch(self.device, CONNECTION, 'CONNECT')
        self.client.wait(lambda: self.get(CONNECTION).on == 'CONNECT' and self.get(PLACE),
                         f'{self.device} does not connect to its mount', timeout)
        # what kind of mount it is, where it stands, its axes: some of it may be on its way
        self.client.settle(self.device, CONNECTION, SETTLING)

    @property
    def has_axes(self):
        """Whether it tells axis angles: encoders, or what its driver takes for them."""
        return self.get(self._axes_property) is not None

    @property
    def believed(self):
        """Whether its axes are those of the position that it reports, with its own model in it."""
        return self._reported or not self.has_axes

    @property
    def kind(self):
        """Kind of mount where the driver says, else ''."""
        return KINDS.get(self.last(KIND).on, '')

    @property
    def site(self):
        """Latitude and longitude, rad, and height, m, as the driver has them; None if not."""
        values = self.last(SITE).values
        if not values:
            return None
        return (values['LAT'] * DEG, float(wrap(values['LONG'] * DEG)), values.get('ELEV', 0.0))

    @property
    def parked(self):
        """Whether it says so."""
        return self.last(PARK).on == 'PARK'

    @property
    def tracks(self):
        """Whether it says that it follows the sky; None where it does not say."""
        track = self.get(TRACK)
        return None if track is None else track.on == 'TRACK_ON'

    @property
    def taken_up(self):
        """When it said last that it follows the sky, ns; 0 where it says that it does not."""
        track = self.last(TRACK)
        return track.received if track.on == 'TRACK_ON' else 0

    @property
    def takes_rates(self):
        """Whether its axes can be told at which rates to track."""
        return CUSTOM in self.last(MODE).values and self.get(RATES) is not None

    @property
    def side(self):
        """Side of the pier as the driver calls it, '' where it does not say."""
        return self.last(SIDE).on

    @property
    def beyond(self):
        """Whether it says that it looks through the pole; None where it does not say."""
        return {'PIER_WEST': True, 'PIER_EAST': False}.get(self.side)

    @property
    def slewing(self):
        """Whether it is under way."""
        return self.last(PLACE).state == 'Busy'

    @property
    def axes(self):
        """Last axis angles, rad, shape (2,), and when they came, ns; None where none have."""
        axes = self.get(self._axes_property)
        if axes is None:
            return None
        return np.array([axes.values[name] for name in self._elements]) * DEG, axes.received

    @property
    def place(self):
        """Where it says it looks: right ascension and declination of date, rad, and when it came.

        The true pointing where a simulator offers it apart.
        """
        for name, elements in ((TRUE_PLACE, ('RA_PE', 'DEC_PE')), (PLACE, ('RA', 'DEC'))):
            place = self.get(name)
            if place is not None:
                hours, degrees = (place.values[element] for element in elements)
                return np.array([hours * HOUR, degrees * DEG]), place.received
        return None

    def is_axes(self, name):
        """Whether a property is that of the axis angles."""
        return name == self._axes_property

    def is_place(self, name):
        """Whether a property is that of the place it looks at."""
        return name == (TRUE_PLACE if self.get(TRUE_PLACE) is not None else PLACE)

    # --- orders -------------------------------------------------------------------------------

    def prepare(self, site=None, timeout=PATIENCE):
        """Make it ready to be pointed: standing, not parked, tracking after a slew, at its fastest.

        Parameters
        ----------
        site : Site, optional
            To be set in the driver, and its clock to UTC of now.
        timeout : float
            s.
        """
        self.connect(timeout)
        if self.slewing or self.tracks:
            self.abort()  # nobody here has sent it, and nobody would renew it
        if site is not None:
            self.set_site(site, timeout)
        if self.parked:
            self.client.switch(self.device, PARK, 'UNPARK')
            self.client.wait(lambda: not self.parked, f'{self.device} does not unpark', timeout)
        on_set = self.client.property(self.device, ON_SET, timeout)
        if on_set.on != 'TRACK':
            self.client.switch(self.device, ON_SET, 'TRACK')
            self.client.wait(lambda: self.get(ON_SET).on == 'TRACK',
                             f'{self.device} does not take ON_COORD_SET.TRACK', timeout)
        rates = list(self.last(RATE).values)
        if rates:
            self.client.switch(self.device, RATE, rates[-1])

    def set_site(self, site, timeout=PATIENCE):
        """Tell the driver where it stands, and the time where it takes it."""
        self.client.property(self.device, SITE, timeout)
        self.client.send(self.device, SITE, LAT=site.latitude / DEG,
                         LONG=float(np.mod(site.longitude / DEG, 360.0)), ELEV=site.height)
        if self.get(CLOCK) is not None:
            self.client.send(self.device, CLOCK, OFFSET='0.00',
                             UTC=time.strftime('%Y-%m-%dT%H:%M:%S', time.gmtime()))

        def taken():
            there = self.site
            return there is not None and np.allclose(
                np.array(there[:2]) - (site.latitude, wrap(site.longitude)), 0.0, atol=1e-7)
        self.client.wait(taken, f'{self.device} does not take the site', timeout)

    def goto(self, ra, dec):
        """Slew to a place of date, rad, and track it."""
        on_set = self.last(ON_SET).on
        # a driver that synchronises instead would move the zero that is measured
        if on_set != 'TRACK':
            raise IndiError(f'{self.device} is set to {on_set or "nothing"} and not to TRACK: no '
                            'slew')
        if self.tracks is False:
            # some go on as they did before the slew
            self.track(True)
        if self.last(MODE).on == CUSTOM:  # taken only while it tracks
            self.client.switch(self.device, MODE, 'TRACK_SIDEREAL')
        self.client.send(self.device, PLACE, RA=float(np.mod(ra, 2.0 * np.pi)) / HOUR,
                         DEC=dec / DEG)

    def track(self, on):
        """Let it follow the sky, or stand."""
        if self.get(TRACK) is not None:
            self.client.switch(self.device, TRACK, 'TRACK_ON' if on else 'TRACK_OFF')

    def turn(self, rates):
        """Track on with other rates of the axes, shape (2,), rad/s."""
        if self.last(MODE).on != CUSTOM:
            self.client.switch(self.device, MODE, CUSTOM)
        through = np.where(rates * self._rates < 0.0, 0.0, rates)
        # none is reversed at once: drivers refuse that
        for row in ([through] if np.any(through != rates) else []) + [rates]:
            self.client.send(self.device, RATES, **dict(zip(
                ('TRACK_RATE_RA', 'TRACK_RATE_DE'), (row / ARCSEC).tolist())))
        self._rates = rates

    def abort(self):
        """Stop at once, and stand."""
        self.client.switch(self.device, ABORT, 'ABORT')
        self.track(False)


class Ticks:
    """Pairs what a telescope sends, by the moment at which it came.

    Parameters
    ----------
    tick : callable
        ``tick(Tick)``, in the thread of the connection.

    Attributes
    ----------
    telescope : IndiTelescope or None
        Set once it is found.
    """

    def __init__(self, tick):
        self.telescope = None
        self._tick = tick
        self._lock = threading.Lock()

    def __call__(self, device, name, vector):
        """As `update` of an `IndiClient`."""
        telescope = self.telescope
        if telescope is None or device != telescope.device:
            return
        if telescope.is_place(name):
            axes, place = telescope.axes, telescope.place
            tracking = not telescope.slewing and vector.state != 'Alert'
            if axes is None:
                return
            if abs(vector.received - axes[1]) <= TICK:
                self._tick(Tick(axes[1], axes[0], place[0], tracking))
            elif tracking and telescope.tracks is False:  # axes that stand are not sent again
                self._tick(Tick(vector.received, axes[0], place[0], tracking))
        elif telescope.is_axes(name):
            self._tick(Tick(vector.received, telescope.axes[0], None, not telescope.slewing))
