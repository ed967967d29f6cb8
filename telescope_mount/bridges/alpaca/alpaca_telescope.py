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

"""A telescope of an ASCOM Alpaca server: its properties in SI, asked for again and again.

alpyca speaks the protocol. It is slewed, tracked and stopped, and never synchronised: that would
move the zero that is to be measured.
"""

import contextlib
import time

import numpy as np

from msg_tools.units import DEG, wrap

from ..axes_and_places import HOUR
from ..connection import BridgeError

#: AlignmentMode -> `pointing_model.mounts.KINDS`
KINDS = {0: 'altaz', 1: 'equatorial', 2: 'german'}
#: EquatorialSystem of places of date; 0 is 'other', of drivers that do not care
OF_DATE = (0, 1)
#: SideOfPier: pierEast looks west, as without going through the pole; -1 is unknown
SIDES = {0: 'pierEast', 1: 'pierWest'}
#: what is requested at each tick
POLLED = ('RightAscension', 'Declination', 'Slewing', 'Tracking', 'SideOfPier', 'AtPark')
#: action of the simulator here: right ascension and declination of date at which its tube looks,
#: and the angle of its second axis, rad
TRUE_PLACE = 'TelescopeMount:TruePlace'
#: a place that is older is none, s
OLD = 1.0


class AlpacaError(BridgeError):
    """The server or the driver did not do what it was asked; the text is one line."""


@contextlib.contextmanager
def _asking(what):
    """Errors of alpyca, and of the connection, as one line."""
    try:
        import requests
        from alpaca import exceptions
    except ImportError:
        raise AlpacaError('the bridge to Alpaca needs the package alpyca: '
                          './install.sh ros,alpaca') from None
    # one of the package for each number of ASCOM's
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
    """Nobody answers: the connection is lost."""


class AlpacaTelescope:
    """One telescope.

    Parameters
    ----------
    host : str
    port : int
    number : int
        Of the device on the server.
    """

    #: the protocol gives no axis angles, and the rates that it has are left alone
    has_axes, believed, axes, takes_rates = False, True, None, False

    def __init__(self, host, port, number=0):
        with _asking(f'{host}:{port}'):
            from alpaca.telescope import Telescope
            self._device = Telescope(f'{host}:{port}', number)
        self.device = f'telescope {number} of {host} port {port}'
        self._state, self._received = {}, 0
        self._at_once = True  # the server gives all of it in one answer

    def ask(self, name, default=None):
        """A property; `default` where the driver does not have it."""
        try:
            with _asking(f'{self.device}, {name}'):
                return getattr(self._device, name)
        except Unanswered:
            raise
        except AlpacaError:
            if default is None:
                raise
            return default

    def set(self, name, value):
        """Set a property."""
        with _asking(f'{self.device}, {name}'):
            setattr(self._device, name, value)

    def call(self, name, *args):
        """Call a method; what it answers."""
        with _asking(f'{self.device}, {name}'):
            return getattr(self._device, name)(*args)

    def true_place(self):
        """Where a simulator's tube looks, right ascension, declination and second axis, rad.

        Returns
        -------
        stamp : int
            ns, in the middle of the question.
        ndarray, shape (3,)

        Raises
        ------
        AlpacaError
            It is no simulator that gives it.
        """
        before = time.time_ns()
        text = self.call('Action', TRUE_PLACE, '')
        return (before + time.time_ns()) // 2, np.array(text.split(), float)

    @property
    def is_simulator(self):
        """Whether it tells where it truly looks."""
        return TRUE_PLACE in self.ask('SupportedActions', [])

    def knows_where_it_looks(self):
        """Raise AlpacaError where the position that it reports is what it believes."""
        if not self.is_simulator:
            raise AlpacaError(f'{self.device} reports what it believes, not what is seen: start a '
                              'camera of your own that publishes camera/miss_distance, and leave '
                              'alpaca_sky out')

    # --- its state ----------------------------------------------------------------------------

    def poll(self):
        """Ask for its state; ns, in the middle of the question.

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
        """Kind of mount, '' where it does not say."""
        return KINDS.get(int(self.ask('AlignmentMode', -1)), '')

    @property
    def site(self):
        """Latitude and longitude, rad, and height, m; None where it does not say."""
        try:
            return (self.ask('SiteLatitude') * DEG, float(wrap(self.ask('SiteLongitude') * DEG)),
                    float(self.ask('SiteElevation', 0.0)))
        except Unanswered:
            raise
        except AlpacaError:
            return None

    @property
    def parked(self):
        """Whether it says so."""
        return bool(self._state.get('AtPark', False))

    @property
    def slewing(self):
        """Whether it is under way."""
        return bool(self._state.get('Slewing', False))

    @property
    def tracks(self):
        """Whether it says that it follows the sky."""
        return self._state.get('Tracking')

    @property
    def taken_up(self):
        """When it was received last that it follows the sky, ns; 0 where it does not."""
        return self._received if self.tracks else 0

    @property
    def side(self):
        """Side of the pier by ASCOM's name, '' where it does not say."""
        return SIDES.get(int(self._state.get('SideOfPier', -1)), '')

    @property
    def beyond(self):
        """Whether it says that it looks through the pole; None where it does not say."""
        return {'pierWest': True, 'pierEast': False}.get(self.side)

    @property
    def place(self):
        """Right ascension and declination of date, rad, and when; None where they are old."""
        if time.time_ns() - self._received > OLD * 1e9:
            return None
        return np.array([self._state['RightAscension'] * HOUR,
                         self._state['Declination'] * DEG]), self._received

    # --- orders -------------------------------------------------------------------------------

    def connect(self):
        """Have the server connect to the mount."""
        if not self.ask('Connected'):
            self.set('Connected', True)

    def prepare(self, site=None):
        """Make it ready to be pointed: connected, standing, not parked.

        Parameters
        ----------
        site : Site, optional
            To be set in the driver.
        """
        self.connect()
        system = int(self.ask('EquatorialSystem', 0))
        if system not in OF_DATE:
            raise AlpacaError(f'{self.device} takes places of another equinox (EquatorialSystem '
                              f'{system}): set it to topocentric coordinates')
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
        self._state['Slewing'] = True  # until the next tick tells

    def abort(self):
        """Stop at once, and stand."""
        try:
            self.call('AbortSlew')
        finally:
            self.set('Tracking', False)
