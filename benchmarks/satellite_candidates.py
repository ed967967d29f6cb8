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

"""Candidate causes of the errors in the satellite check of paper 000, section 3.

The paper tracked GPS satellite 26690 before and after the zero calibration and prints mean and
standard deviation of measured minus orbit on each axis. A constant zero shifts the means; it can
neither reduce the scatter from 11.33" to 2.04" nor leave 5.94" and -3.49". A candidate is an error
of known shape on the sky, per unit of its size; `satellite_search` finds the sizes that reproduce
the paper's numbers.

Assumptions, because the paper does not say (`Assumptions`): azimuth is the coordinate, as in table
1 as interpreted here; a curve has as much information as 10 independent samples; the zero
calibration of that night was as good as those of table 1; "before" and "after" may be different
arcs; noise accounts for the remaining scatter.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.pointing_terms import design
from pointing_model.sky.earth import TURN_RATE
from pointing_model.sky.refraction import DEFAULT_WEATHER, refracted_elevation
from pointing_model.sky.satellite_place import Corrections, satellite_place
from pointing_model.sky.site import DEFAULT_SITE

_RATE_STEP = 0.5  # s
_MOUNT = ('IA', 'IE', 'CA', 'NPAE', 'AN', 'AW', 'TF')


@dataclass(frozen=True)
class Assumptions:
    """Assumptions of the comparison that the paper does not state.

    Attributes
    ----------
    samples : int
        Independent samples in a curve: sets how far mean and std may be off (95 %).
    zero_az_arcsec, zero_el_arcsec : float
        Zero error left on a night after calibration: by default the RMS of table 1.
    drift_arcsec : float
        Largest zero offset before the calibration: three times the scatter of table 1.
    on_sky : bool
        The printed azimuth is on the sky instead of the coordinate.
    """

    samples: int = 10
    zero_az_arcsec: float = 1.37
    zero_el_arcsec: float = 0.54
    drift_arcsec: float = 27.0
    on_sky: bool = False

    def windows(self, published):
        """What counts as the published numbers.

        Parameters
        ----------
        published : dict
            As `PAPER`.

        Returns
        -------
        mean, mean_tolerance : ndarray, shape (2,)
            Of "after", azimuth and elevation, arcsec: sampling and twice the zero error.
        most_after : ndarray, shape (2,)
            Largest scatter of "after" that a candidate may make.
        least_before, most_before : ndarray, shape (2,)
            The same of "before"; the least with the noise of "after" taken off.
        """
        from scipy.stats import chi2, t
        free = self.samples - 1
        low, high = np.sqrt(free / chi2.ppf([0.975, 0.025], free))
        mean = four_numbers(published['after'], 'mean')
        noise = four_numbers(published['after'], 'std')
        before = four_numbers(published['before'], 'std')
        zero = np.array([self.zero_az_arcsec, self.zero_el_arcsec])
        tolerance = np.hypot(t.ppf(0.975, free) * noise / np.sqrt(self.samples), 2.0 * zero)
        least = np.sqrt(np.maximum((low * before)**2 - noise**2, 0.0))
        return mean, tolerance, high * noise, least, high * before


def four_numbers(four, which):
    """Both axes of ``which``, 'mean' or 'std', from one curve's numbers as in `PAPER`."""
    return np.array([four[f'{axis}_{which}_arcsec'] for axis in ('az', 'el')])


@dataclass(frozen=True)
class Candidate:
    """A possible cause.

    Attributes
    ----------
    name, cause : str
    effects : tuple of str
        Names of `track_effects`, one for each size.
    units : tuple of str
        Of the sizes.
    limit : tuple of float
        Largest size that other knowledge allows.
    reason : str
        That knowledge.
    fixed : float or None
        The only size there is.
    zeroed : bool
        The zero calibration takes away what the candidate does at Polaris.
    """

    name: str
    cause: str
    effects: tuple
    units: tuple
    limit: tuple
    reason: str
    fixed: float = None
    zeroed: bool = False


def _candidates():
    nothing = 'nothing in the paper bounds it below a second'
    mount = 'the whole pointing error was 20" when the mount was not calibrated (section 1.1)'
    known = 'it has one size'
    make = Candidate

    def fixed(name, cause, effect, size=1.0):
        return make(name, cause, (effect,), ('times',), (abs(size),), known, fixed=size)

    def mounted(name, cause, *effects):
        n = len(effects)
        return make(name, cause, effects, ('"',) * n, (20.0,) * n, mount, zeroed=True)

    return (
        make('time error', 'the tracking data carry a late time', ('rate',), ('s',), (1.0,),
             nothing),
        make('clock in the model', 'clock error that the star model has absorbed as a rotation',
             ('rate_on_sky',), ('s',), (1.0,), nothing),
        make('UT1 for the stars', 'UT1-UTC left out of the star places, right for the satellite',
             ('sidereal',), ('s',), (0.9,),
             'UTC keeps within 0.9 s of UT1; the size is -(UT1-UTC)'),
        fixed('light time ignored', 'orbit at the time of arrival', 'light_time'),
        fixed('light time reversed', 'applied with the wrong sign', 'light_time', 2.0),
        fixed('light time twice', 'applied to data that had it', 'light_time', -1.0),
        fixed('annual aberration', 'applied to the satellite', 'annual'),
        fixed('annual aberration reversed', 'taken off the satellite', 'annual', -1.0),
        fixed('diurnal aberration', 'diurnal aberration ignored', 'diurnal'),
        fixed('parallactic refraction', 'refraction as of a star', 'parallactic'),
        fixed('refraction', 'refraction ignored for the satellite', 'refraction'),
        make('refraction scale', 'pressure or temperature wrong, for Polaris too',
             ('refraction_percent',), ('%',), (5.0,), '5 % is 50 hPa or 14 degrees', zeroed=True),
        make('servo lag', 'lag in proportion to the rate, its own constant on each axis',
             ('rate_az', 'rate_el'), ('s', 's'), (1.0, 1.0), nothing),
        make('acceleration lag', 'lag in proportion to the acceleration, likewise',
             ('acceleration_az', 'acceleration_el'), ('s2', 's2'), (1.0, 1.0),
             'an acceleration constant below 1 /s2 is no servo'),
        mounted('CA', 'collimation not modelled', 'CA'),
        mounted('NPAE', 'axes not perpendicular, not modelled', 'NPAE'),
        mounted('AN', 'azimuth axis leans north', 'AN'),
        mounted('AW', 'azimuth axis leans west', 'AW'),
        mounted('tilt', 'azimuth axis leans anywhere', 'AN', 'AW'),
        mounted('flexure', 'TF not modelled', 'TF'),
        mounted('CA and flexure', 'both not modelled', 'CA', 'TF'),
        mounted('NPAE and flexure', 'both not modelled', 'NPAE', 'TF'),
        make('time error and CA', 'both', ('rate', 'CA'), ('s', '"'), (1.0, 20.0), mount,
             zeroed=True),
        make('time error and NPAE', 'both', ('rate', 'NPAE'), ('s', '"'), (1.0, 20.0), mount,
             zeroed=True),
        make('along the orbit', 'orbit ahead of the satellite', ('along',), ('km',), (0.01,),
             'broadcast orbits of GPS are good to metres, precise ones to decimetres'),
        make('site', 'site off east and north, as by a wrong datum', ('site_east', 'site_north'),
             ('m', 'm'), (150.0, 150.0), 'national and world datum differ by some 100 m in China'),
        make('zero left', 'the zero calibration itself is off', ('IA', 'IE'), ('"', '"'),
             (2.6, 0.8), 'largest night of table 1'),
        make('zero drifting', 'the zero moves during the pass', ('drift_az', 'drift_el'),
             ('"/h', '"/h'), (1.0, 1.0), 'the zero stayed all night (abstract)'),
    )


#: Every cause that is tried.
CANDIDATES = _candidates()


def satellite_rates(satellite, time, site=DEFAULT_SITE, weather=DEFAULT_WEATHER):
    """Rates of the observed place, for tracking.

    Parameters
    ----------
    satellite, time, site, weather
        As for `satellite_place`.

    Returns
    -------
    az_rate, el_rate : float or ndarray
        Radians a second: symmetric difference over 1 s, for a GPS satellite right to 1e-6
        arcsec/s below 85 degrees of elevation.
    """
    time = np.asarray(time, float)
    first = satellite_place(satellite, time - _RATE_STEP, site, weather)
    last = satellite_place(satellite, time + _RATE_STEP, site, weather)
    width = 2.0 * _RATE_STEP
    return wrap(last[0] - first[0]) / width, (last[1] - first[1]) / width


def track_effects(satellite, time, site=DEFAULT_SITE, weather=DEFAULT_WEATHER):
    """Contribution of a unit of each cause to measured minus orbit.

    Parameters
    ----------
    satellite : Satellite
    time : ndarray, shape (n,)
        UTC, seconds since 1970-01-01, rising.
    site : Site
    weather : Weather

    Returns
    -------
    dict of str to (ndarray, ndarray)
        Azimuth (coordinate) and elevation, arcsec per unit, shape (n,); an effect of the mount
        goes by its term's name.
    """
    az, el, distance = satellite_place(satellite, time, site, weather)
    zero = np.zeros_like(az)

    def computed_with(**wrong):
        """Correct place minus a wrongly computed place."""
        bias = wrong.pop('time_bias', 0.0)
        az_wrong, el_wrong, _ = satellite_place(satellite, time, site, weather,
                                                corrections=Corrections(**wrong), time_bias=bias)
        return wrap(az - az_wrong), el - el_wrong

    az_rate, el_rate = satellite_rates(satellite, time, site, weather)
    az_faster, el_faster = (np.gradient(rate, time) for rate in (az_rate, el_rate))
    tan, sin_lat, cos_lat = np.tan(el), np.sin(site.latitude), np.cos(site.latitude)
    sidereal = (TURN_RATE * (sin_lat - cos_lat * np.cos(az) * tan),
                TURN_RATE * cos_lat * np.sin(az))
    position, velocity = satellite.state(time[len(time) // 2])
    second = 1e3 / np.linalg.norm(velocity)  # in which it flies a kilometre
    hours = (time - time[0]) / 3600.0
    bent = computed_with(refraction=False)
    out = {
        'rate': (az_rate, el_rate), 'rate_az': (az_rate, zero), 'rate_el': (zero, el_rate),
        'acceleration_az': (az_faster, zero), 'acceleration_el': (zero, el_faster),
        'sidereal': sidereal,
        'rate_on_sky': (az_rate - sidereal[0], el_rate - sidereal[1]),
        'light_time': computed_with(light_time=False),
        'annual': computed_with(annual_aberration=True),
        'diurnal': computed_with(diurnal_aberration=False),
        'parallactic': computed_with(parallactic_refraction=False),
        'refraction': bent, 'refraction_percent': (zero, 0.01 * bent[1]),
        'along': computed_with(time_bias=second),
        # a site computed one metre too far east sees the satellite too far west
        'site_east': (np.cos(az) / (distance * np.cos(el)), -np.sin(az) * np.sin(el) / distance),
        'site_north': (-np.sin(az) / (distance * np.cos(el)), -np.cos(az) * np.sin(el) / distance),
        'drift_az': (ARCSEC * hours, zero), 'drift_el': (zero, ARCSEC * hours),
    }
    out = {name: (a / ARCSEC, e / ARCSEC) for name, (a, e) in out.items()}
    for name in _MOUNT:
        x, y = design([name], az, el)
        out[name] = x[:, 0] / np.cos(el), y[:, 0]
    return out


def polaris_effects(site, weather):
    """What of `track_effects` there is where the zero is set: azimuth 0, the latitude.

    Parameters
    ----------
    site : Site
    weather : Weather

    Returns
    -------
    dict of str to (float, float)
        Azimuth (coordinate) and elevation, arcsec per unit. What moves with the satellite is not
        in it.
    """
    out = {}
    for name in _MOUNT:
        x, y = (float(v[0, 0]) for v in design([name], 0.0, site.latitude))
        out[name] = x / np.cos(site.latitude), y
    bent = refracted_elevation(site.latitude, weather) - site.latitude
    out['refraction_percent'] = 0.0, 0.01 * bent / ARCSEC
    return out
