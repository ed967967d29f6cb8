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

It is slewed, tracked, stopped and parked, but never synchronised: that would move the zero that
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
#: position reported by an alt-azimuth mount, degrees
HORIZONTAL = 'HORIZONTAL_COORD'
PARK, ABORT, TRACK = 'TELESCOPE_PARK', 'TELESCOPE_ABORT_MOTION', 'TELESCOPE_TRACK_STATE'
ON_SET, SITE, SIDE = 'ON_COORD_SET', 'GEOGRAPHIC_COORD', 'TELESCOPE_PIER_SIDE'
RATE, KIND, CLOCK, CONNECTION = 'TELESCOPE_SLEW_RATE', 'MOUNT_TYPE', 'TIME_UTC', 'CONNECTION'
MODE, RATES, CUSTOM = 'TELESCOPE_TRACK_MODE', 'TELESCOPE_TRACK_RATE', 'TRACK_CUSTOM'
#: simulators: that of INDI, and one of `examples/simulated_servers`
SIMULATOR, TWO_AXES = 'indi_simulator_telescope', 'two_axes'
#: bit of DRIVER_INTERFACE of a telescope
TELESCOPE = 1
#: kind of mount by the driver's name -> `pointing_model.mounts.KINDS`
KINDS = {'ALTAZ': 'altaz', 'EQ_FORK': 'equatorial', 'EQ_GEM': 'german'}
#: largest time between readings of one tick, ns: a driver sends them at once
TICK = 30_000_000
#: s in which a driver sends the rest of its properties after its position
SETTLING = 2.0


def find_device(client, wanted='', timeout=PATIENCE):
    """Name of the telescope on a server.

    Parameters
    ----------
    client : IndiClient
    wanted : str
        Name of the telescope; '': the only one.

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
    """Raise IndiError if the driver of an alt-azimuth mount reports other axes."""
    if kind == 'altaz' and _driver(telescope) == SIMULATOR:
        raise IndiError(f'{telescope.device} is set to ALTAZ, but its axes are hour angle and '
                        'declination: set its MOUNT_TYPE to EQ_FORK or EQ_GEM. For an alt-azimuth '
                        'one: python examples/simulated_servers/indi_simulator.py --kind altaz')


def knows_where_it_looks(telescope):
    """Raise IndiError if the position that a driver reports is only its estimate."""
    if telescope.get(TRUE_PLACE) is None and not is_simulator(telescope):
        raise IndiError(f'{telescope.device} reports a computed, not a measured position: start a '
                        'camera of your own that publishes camera/miss_distance, and leave '
                        'indi_sky out')


class IndiTelescope:
    """One device.

    Parameters
    ----------
    client : IndiClient
        Connected or about to be.
    device : str
        See `find_device`.
    axes : str
        Property with the axis angles and its two elements, degrees, ``NAME:FIRST,SECOND``; '':
        `AXES` if the driver has it, `HORIZONTAL` for an alt-azimuth mount, else the position that
        it reports.
    altaz : bool
        Whether it is an alt-azimuth mount.
    """

    doubt = ''

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
        """A `Vector`, None if none was received."""
        return self.client.get(self.device, name)

    def last(self, name):
        """A `Vector`, without values if none was received."""
        return self.client.get(self.device, name, Vector({}))

    def connect(self, timeout=PATIENCE):
        """Let the server connect to the mount, and receive all properties of its driver.

        Raises IndiError on failure.
        """
        state = self.client.property(self.device, CONNECTION, timeout)
        if state.on != 'CONNECT':
            self.client.switch(self.device, CONNECTION, 'CONNECT')
        self.client.wait(lambda: self.get(CONNECTION).on == 'CONNECT' and self.get(PLACE),
                         f'{self.device} does not connect to its mount', timeout)
        # its kind, site and axes may not have arrived yet
        self.client.settle(self.device, CONNECTION, SETTLING)

    @property
    def has_axes(self):
        """Whether it reports axis angles: of encoders, or the driver's estimates."""
        return self.get(self._axes_property) is not None

    @property
    def believed(self):
        """Whether its axes are those of its reported position, which include its own model."""
        return self._reported or not self.has_axes

    @property
    def kind(self):
        """Kind of mount if the driver reports it, else ''."""
        return KINDS.get(self.last(KIND).on, '')

    @property
    def site(self):
        """Latitude and longitude, rad, and height, m, set in the driver; None if not reported."""
        values = self.last(SITE).values
        if not values:
            return None
        return (values['LAT'] * DEG, float(wrap(values['LONG'] * DEG)), values.get('ELEV', 0.0))

    @property
    def parked(self):
        """Whether it reports to be parked."""
        return self.last(PARK).on == 'PARK'

    @property
    def tracks(self):
        """Whether it reports to track the sky; None if not reported."""
        track = self.get(TRACK)
        return None if track is None else track.on == 'TRACK_ON'

    @property
    def taken_up(self):
        """Time of the last report that it tracks, ns; 0 if it reports not to track."""
        track = self.last(TRACK)
        return track.received if track.on == 'TRACK_ON' else 0

    @property
    def takes_rates(self):
        """Whether tracking rates of its axes can be set."""
        return CUSTOM in self.last(MODE).values and self.get(RATES) is not None

    @property
    def side(self):
        """Side of the pier by the driver's name, '' if not reported."""
        return self.last(SIDE).on

    @property
    def beyond(self):
        """Whether it reports to point through the pole; None if not reported."""
        return {'PIER_WEST': True, 'PIER_EAST': False}.get(self.side)

    @property
    def slewing(self):
        """Whether it is moving."""
        return self.last(PLACE).state == 'Busy'

    @property
    def axes(self):
        """Last axis angles, rad, shape (2,), and time of reception, ns; None if there are none."""
        axes = self.get(self._axes_property)
        if axes is None:
            return None
        return np.array([axes.values[name] for name in self._elements]) * DEG, axes.received

    @property
    def place(self):
        """Reported position: right ascension and declination of date, rad, and time of reception.

        The true pointing if a simulator provides it separately.
        """
        for name, elements in ((TRUE_PLACE, ('RA_PE', 'DEC_PE')), (PLACE, ('RA', 'DEC'))):
            place = self.get(name)
            if place is not None:
                hours, degrees = (place.values[element] for element in elements)
                return np.array([hours * HOUR, degrees * DEG]), place.received
        return None

    def is_axes(self, name):
        """Whether a property contains the axis angles."""
        return name == self._axes_property

    def is_place(self, name):
        """Whether a property contains the position."""
        return name == (TRUE_PLACE if self.get(TRUE_PLACE) is not None else PLACE)

    # --- orders -------------------------------------------------------------------------------

    def prepare(self, site=None, timeout=PATIENCE):
        """Make it ready to be pointed: at rest, not parked, tracking after slews, at full speed.

        Parameters
        ----------
        site : Site, optional
            Site to set in the driver, with its clock set to current UTC.
        timeout : float
            s.
        """
        self.connect(timeout)
        if self.slewing or self.tracks:
            self.abort()  # its motion was not commanded here and would not be renewed
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
        """Send the driver the site, and the time if it takes it."""
        self.client.property(self.device, SITE, timeout)
        self.client.send(self.device, SITE, LAT=site.latitude / DEG,
                         LONG=float(np.mod(site.longitude / DEG, 360.0)), ELEV=site.height)
        if self.get(CLOCK) is not None:
            time.sleep(-time.time() % 1.0)  # it takes whole seconds, and one is 15 arcsec
            now = time.gmtime(round(time.time()))
            self.client.send(self.device, CLOCK, OFFSET='0.00',
                             UTC=time.strftime('%Y-%m-%dT%H:%M:%S', now))

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
            # some drivers continue as before the slew
            self.track(True)
        if self.last(MODE).on == CUSTOM:  # accepted only while it tracks
            self.client.switch(self.device, MODE, 'TRACK_SIDEREAL')
        self.client.send(self.device, PLACE, RA=float(np.mod(ra, 2.0 * np.pi)) / HOUR,
                         DEC=dec / DEG)

    def track(self, on):
        """Let it track the sky, or stand still."""
        if self.get(TRACK) is not None:
            self.client.switch(self.device, TRACK, 'TRACK_ON' if on else 'TRACK_OFF')

    def turn(self, rates):
        """Continue tracking with other rates of the axes, shape (2,), rad/s."""
        if self.last(MODE).on != CUSTOM:
            self.client.switch(self.device, MODE, CUSTOM)
        through = np.where(rates * self._rates < 0.0, 0.0, rates)
        # stop an axis before reversing it: drivers refuse a direct reversal
        for row in ([through] if np.any(through != rates) else []) + [rates]:
            self.client.send(self.device, RATES, **dict(zip(
                ('TRACK_RATE_RA', 'TRACK_RATE_DE'), (row / ARCSEC).tolist())))
        self._rates = rates

    def abort(self):
        """Stop immediately, without tracking."""
        self.client.switch(self.device, ABORT, 'ABORT')
        self.track(False)


class Ticks:
    """Pairs the messages of a telescope by their time of reception.

    Parameters
    ----------
    tick : callable
        ``tick(Tick)``, in the thread of the connection.

    Attributes
    ----------
    telescope : IndiTelescope or None
        Set when it has been found.
    """

    def __init__(self, tick):
        self.telescope = None
        self._tick = tick
        self._lock = threading.Lock()

    def __call__(self, device, name, vector):
        """`update` of an `IndiClient`."""
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
            elif tracking and telescope.tracks is False:  # axes at rest are not sent again

                self._tick(Tick(vector.received, axes[0], place[0], tracking))
        elif telescope.is_axes(name):
            self._tick(Tick(vector.received, telescope.axes[0], None, not telescope.slewing))
