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

"""Sentences on tracks of satellites, their orbits and the station's clock."""

from datetime import datetime, timezone

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.effects.base import arcsec

from .number_wording import value_and_error


def _seconds(value, sigma):
    if abs(value) < 1.0:
        return f'{1e3 * abs(value):.1f} ± {1e3 * sigma:.1f} ms'
    return f'{abs(value):.2f} ± {sigma:.2f} s'


def _utc(time, seconds=''):
    return datetime.fromtimestamp(time, timezone.utc).strftime(f'%Y-%m-%d %H:%M{seconds} UTC')


def _percent(chance):
    return 'over 99 %' if chance > 0.995 else f'{100.0 * chance:.0f} %'


def _signed(found):
    return f'{1e3 * found.size:+.1f} ± {1e3 * found.sigma:.1f} ms'


def _pass_left_out(found):
    why = ('most are outliers' if np.isnan(found.size) else
           f'they disagree with the others by {arcsec(found.size / ARCSEC)}')
    return (f'The pass of {found.causes[0]} that begins {_utc(found["begin"])} is excluded with '
            f'its {found["rows"]} rows: {why}. Check stamps, satellite and power-on')


def _zero_of_power_on(found):
    each = ', '.join('{} {} ± {}″'.format(name, *value_and_error(*one))
                      for name, one in found['zeros'].items())
    return (f'The zeros in the terms are those of power-on {found["newest"]:g}, the newest. '
            f'Power-on {found["run"]:g} differs by {each}')


def _stamps(found):
    word = 'late' if found.size > 0.0 else 'early'
    scale = f', as if in {found.causes[0]} time' if found.causes[0] and found.size > 0.0 else ''
    late = abs(found.size)
    size = f'{late / 3600.0:g} h' if late >= 3600.0 else f'{late:g} s'
    return (f'the time stamps are {size} {word}{scale}: corrected, {found.before:.0f}" becomes '
            f'{found.after:.0f}"; give UTC')


#: error common to all rows -> its name, its unit, and the size of the unit in the fit
_SHARED = {
    'height': ('height of the site', 'm', 1.0),
    'height and air': ('height of the site (with the standard air there)', 'm', 1.0),
    'latitude': ('latitude', 'deg', DEG), 'longitude': ('longitude', 'deg', DEG),
    'refraction': ('refraction', '% of that of ordinary air', 0.01),
    'clock': ("station's clock", 's', 1.0)}


def _one_of_these(found):
    each = [f'the orbit of {name} along the track' for name in found.causes]
    for name, (value, sigma) in found.evidence.items():
        what, unit, size = _SHARED[name]
        error = max(sigma / size, 1e-9)
        digits = max(0, 1 - int(np.floor(np.log10(error))))
        each.append(f'the {what} {value / size:+.{digits}f} ± {error:.{digits}f} {unit} from '
                    'the given value')
    which = 'One of these' if len(each) > 1 else 'This'
    next_step = ('to be sure, track more arcs, also of other satellites' if found.causes
                 else 'no orbit need be wrong: correct it')
    return (f'{which} is wrong ({_percent(found.size)}): {", or ".join(each)}. The fit allows for '
            f'it; {next_step}')


def _old_elements(found):
    age = 'old' if found.size >= 0.0 else 'younger than the track'
    return (f'elements of {found.causes[0]} are {abs(found.size):.1f} days {age}: expect errors '
            f'of {found["error_km"]:.1f} km; use a precise orbit if there is one')


KINDS = {
    'old elements': _old_elements,
    'orbit wrong': lambda found: (
        f'The orbit of {found.causes[0]} is wrong along the track '
        f'({_percent(found.size)}): its rows are left out'),
    'one of these wrong': _one_of_these,
    'most orbits wrong': lambda found: (
        f'The orbits of {" and ".join(found.causes)} seem wrong, of most satellites: rather a zero '
        'jumped or the clock was set between passes. Number the power-ons (column run); do not '
        'trust these terms'),
    'pass left out': _pass_left_out,
    'tracks disagree': lambda found: (
        f'The tracks disagree: {found.size:.1f}" RMS are left, {found.size / found["noise"]:.0f} '
        'times the noise of the rows. An orbit, a pass or a stamp is wrong, or a zero has moved: '
        'do not trust these terms'),
    'outliers of tracks': lambda found: (
        f'{found.size} of {found["of"]} rows are excluded as outliers, the first at '
        f'{_utc(found["first"], ":%S")} ({found.causes[0]})'),
    'whole stamps': lambda found: (
        f'Every time stamp is a whole second, and rows scatter along the track by {found.size:.2f} '
        's. The stamps are rounded or truncated: useless for the clock. Log fractions of seconds'),
    'stamps scatter': lambda found: (
        f'Rows scatter along the track by {found.size:.3f} s from one to the next, far more than '
        'across: their stamps do. Stamp each row where the encoder is latched or the shutter '
        'opens, not where a message or file comes'),
    'miss reversed': lambda found: (
        f'The sign of {" and ".join(found.causes)} looks reversed: the other sign would leave '
        f'{found.after:.1f} instead of {found.before:.1f} arcsec'),
    'zero of a power-on': _zero_of_power_on,
    'stamps off': _stamps,
    'not the satellite': lambda found: (
        f'the rows are {found.size:.1f} degrees from the orbits, too far for zeros of the '
        'axes. Check satellite, time, site and the columns of the angles'),
    'tracks determine no terms': lambda found: (
        f'These tracks do not determine the terms: {found.size:.1f}" over the sky (RMS), worse '
        'than by a dozen stars. Add arcs in other parts of the sky, or give a model (--model)'),
    'clock late': lambda found: (
        f"The station's clock is {_seconds(found.size, found.sigma)} "
        f'{"late" if found.size > 0.0 else "early"}'),
    'clock not separated': lambda found: (
        f"The station's clock cannot be separated from the zeros and the orbits: "
        f'{_signed(found)}. Track another satellite, in another direction'),
    'satellite ahead': lambda found: (
        f'{found.causes[0]} is {_seconds(found.size, found.sigma)} '
        f'{"ahead of" if found.size > 0.0 else "behind"} its orbit'),
    'time along the orbit not separated': lambda found: (
        f'{found.causes[0]}: its time along the orbit cannot be separated from the zeros and the '
        f'clock: {_signed(found)}'),
}
