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

"""A telescope of an ASCOM Alpaca server: its properties in SI, by polling.

alpyca implements the protocol. The telescope is slewed, tracked and stopped, but never
synchronised: that would move the zero that is to be measured.
"""

import contextlib
import time

import numpy as np

from msg_tools.units import DEG, wrap

from ..axes_and_places import HOUR
from ..connection import BridgeError

#: AlignmentMode -> `pointing_model.mounts.KINDS`
KINDS = {0: 'altaz', 1: 'equatorial', 2: 'german'}
#: EquatorialSystem values of places of date; 0 is 'other', of unspecific drivers
OF_DATE = (0, 1)
OTHER = ('the driver does not say the equinox of its places (EquatorialSystem 0): taken as of '
         'date. Places of J2000 would be up to 0.4 deg off')
#: SideOfPier: pierEast points west, without going through the pole; -1 is unknown
SIDES = {0: 'pierEast', 1: 'pierWest'}
#: properties polled at each tick
POLLED = ('RightAscension', 'Declination', 'Slewing', 'Tracking', 'SideOfPier', 'AtPark')
#: action of our simulator: right ascension and declination of date at which its tube points,
#: and the angle of its second axis, rad
TRUE_PLACE = 'TelescopeMount:TruePlace'
#: age from which a place is not used, s
OLD = 1.0


class AlpacaError(BridgeError):
    """The server or the driver did not do what was requested; the text is one line."""


@contextlib.contextmanager
def _asking(what):
    """Converts errors of alpyca and of the connection to one line."""
    try:
        import requests
        from alpaca import exceptions
    except ImportError:
        raise AlpacaError('the bridge to Alpaca needs the package alpyca: '
                          './install.sh ros,alpaca') from None
    # alpyca has one exception class per ASCOM error number
    theirs = tuple(value for value in vars(exceptions).values()
                   if isinstance(value, type) and issubclass(value, Exception))
    try:
        yield
    except requests.RequestException as error:
        raise Unanswered(f'{what}: no answer ({type(error).__name__})') from None
    except theirs as error:
        text = ' '.join(str(getattr(error, 'message', error)).split())
        raise AlpacaError(f'{what}: {text or type(error).__name__}') from None


class Unanswered(AlpacaError):
    """There is no answer: the connection is lost."""


class AlpacaTelescope:
    """One telescope.

    Parameters
    ----------
    host : str
    port : int
    number : int
        Number of the device on the server.
    """

    #: the protocol has no axis angles, and its rates are not used
    has_axes, believed, axes, takes_rates = False, True, None, False

    def __init__(self, host, port, number=0):
        with _asking(f'{host}:{port}'):
            from alpaca.telescope import Telescope
            self._device = Telescope(f'{host}:{port}', number)
        self.device = f'telescope {number} of {host} port {port}'
        self._state, self._received = {}, 0
        self.doubt = ''  # what its answers leave open
        self._at_once = True  # whether the server gives all properties in one answer

    def ask(self, name, default=None):
        """Value of a property; `default` if the driver does not have it."""
        try:
            with _asking(f'{self.device}, {name}'):
                return getattr(self._device, name)
        except AlpacaError as error:
            if default is None or isinstance(error, Unanswered):
                raise
            return default

    def set(self, name, value):
        """Set a property."""
        with _asking(f'{self.device}, {name}'):
            setattr(self._device, name, value)

    def call(self, name, *args):
        """Call a method; return its answer."""
        with _asking(f'{self.device}, {name}'):
            return getattr(self._device, name)(*args)

    def true_place(self):
        """True pointing of a simulator: right ascension, declination and second axis, rad.

        Returns
        -------
        stamp : int
            ns, middle of the request.
        ndarray, shape (3,)

        Raises
        ------
        AlpacaError
            It is not such a simulator.
        """
        before = time.time_ns()
        text = self.call('Action', TRUE_PLACE, '')
        return (before + time.time_ns()) // 2, np.array(text.split(), float)

    @property
    def is_simulator(self):
        """Whether it reports its true pointing."""
        return TRUE_PLACE in self.ask('SupportedActions', [])

    def knows_where_it_looks(self):
        """Raise AlpacaError if the position that it reports is only its estimate."""
        if not self.is_simulator:
            raise AlpacaError(f'{self.device} reports a computed, not a measured position: start a '
                              'camera of your own that publishes camera/miss_distance, and leave '
                              'alpaca_sky out')

    # --- its state ----------------------------------------------------------------------------

    def poll(self):
        """Poll its state; ns, middle of the request.

        Raises
        ------
        AlpacaError
        """
        before = time.time_ns()
        state = {}
        if self._at_once:
            with contextlib.suppress(AlpacaError, KeyError, TypeError):
                rows = self.ask('DeviceState')
                state = {row['Name']: row['Value'] for row in rows}
        if not {'RightAscension', 'Declination', 'Slewing', 'Tracking'} <= set(state):
            self._at_once = False
            before = time.time_ns()
            state = {'RightAscension': self.ask('RightAscension'),
                     'Declination': self.ask('Declination')}
            after = time.time_ns()
            state |= {name: self.ask(name, default) for name, default in zip(
                POLLED[2:], (None, None, -1, False))}
        else:
            after = time.time_ns()
        self._state, self._received = state, (before + after) // 2
        return self._received

    @property
    def kind(self):
        """Kind of mount, '' if it is not reported."""
        return KINDS.get(int(self.ask('AlignmentMode', -1)), '')

    @property
    def site(self):
        """Latitude and longitude, rad, and height, m; None if not reported."""
        latitude, longitude, height = (self.ask(f'Site{name}', default) for name, default in (
            ('Latitude', np.nan), ('Longitude', np.nan), ('Elevation', 0.0)))
        known = np.isfinite(latitude + longitude)
        return (latitude * DEG, float(wrap(longitude * DEG)), float(height)) if known else None

    @property
    def parked(self):
        """Whether it reports to be parked."""
        return bool(self._state.get('AtPark', False))

    @property
    def slewing(self):
        """Whether it is moving."""
        return bool(self._state.get('Slewing', False))

    @property
    def tracks(self):
        """Whether it reports to track the sky."""
        return self._state.get('Tracking')

    @property
    def taken_up(self):
        """Time of the last report that it tracks, ns; 0 if it does not track."""
        return self._received if self.tracks else 0

    @property
    def side(self):
        """Side of the pier by ASCOM's name, '' if not reported."""
        return SIDES.get(int(self._state.get('SideOfPier', -1)), '')

    @property
    def beyond(self):
        """Whether it reports to point through the pole; None if not reported."""
        return {'pierWest': True, 'pierEast': False}.get(self.side)

    @property
    def place(self):
        """Right ascension and declination of date, rad, and their time; None if they are old."""
        if time.time_ns() - self._received > OLD * 1e9:
            return None
        return np.array([self._state['RightAscension'] * HOUR,
                         self._state['Declination'] * DEG]), self._received

    # --- orders -------------------------------------------------------------------------------

    def connect(self):
        """Let the server connect to the mount."""
        if not self.ask('Connected'):
            self.set('Connected', True)

    def prepare(self, site=None):
        """Make it ready to be pointed: connected, at rest, not parked.

        Parameters
        ----------
        site : Site, optional
            Site to set in the driver.
        """
        self.connect()
        system = int(self.ask('EquatorialSystem', 0))
        if system not in OF_DATE:
            raise AlpacaError(f'{self.device} uses another equinox (EquatorialSystem '
                              f'{system}): set it to topocentric coordinates')
        self.doubt = OTHER * (system == 0)
        if not self.ask('CanSlewAsync', False):
            raise AlpacaError(f'{self.device} cannot slew (CanSlewAsync is false)')
        if site is not None:
            self.set('SiteLatitude', site.latitude / DEG)
            self.set('SiteLongitude', float(wrap(site.longitude)) / DEG)
        self.poll()
        if self.parked:
            self.call('Unpark')
        if self.slewing or self.tracks:
            self.abort()
        self.poll()

    def goto(self, ra, dec):
        """Slew to a place of date, rad, and track it."""
        if not self.tracks:
            self.set('Tracking', True)
        self.call('SlewToCoordinatesAsync', float(np.mod(ra, 2.0 * np.pi)) / HOUR, dec / DEG)
        self._state['Slewing'] = True  # until the next tick

    def abort(self):
        """Stop immediately, without tracking."""
        try:
            self.call('AbortSlew')
        finally:
            self.set('Tracking', False)
