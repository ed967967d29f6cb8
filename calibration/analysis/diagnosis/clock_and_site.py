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

"""Readings of a run with another clock or site: catalogue positions recomputed for them."""

from dataclasses import dataclass, replace

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.mounts import Mount
from pointing_model.sky.places import sidereal_time

from .readings import Places

#: time zone offsets from UTC that are no whole or half hours, h
_ODD_ZONES = (5.75, 8.75, 12.75, 13.75)
_LARGEST_ZONE = 14.0
_TIMES, _SITE = 'times', 'site'
_SET_SITE = 'set the site right'


@dataclass(frozen=True, eq=False)
class MovedRun:
    """The run as written, with catalogue positions for another time or site.

    Attributes
    ----------
    sentence : str
        The mistake.
    kind : {'times', 'site'}
    advice : str
        What to do.
    az, el : ndarray, shape (n,)
        Catalogue positions, radians; NaN where there is none.
    mount : Mount
        The mount at that site.
    turn : ndarray, shape (n,)
        Correction of the mount's hour angles that were computed with the clock, radians.
    """

    sentence: str
    kind: str
    advice: str
    az: np.ndarray
    el: np.ndarray
    mount: Mount
    turn: np.ndarray = 0.0
    mistakes, elsewhere = 1, True
    catalogue = encoders = ()
    offsets, exchanged, given = '', False, ''

    def places(self, az, el, az_enc, el_enc, held=False, **clock):
        """Like `Reading.places`, but the catalogue positions as written are not used."""
        reach = np.cos(self.el)
        if held:
            x = wrap(az_enc - az) * np.cos(el)
            return Places(self.az, self.el, self.az + x / reach, self.el + el_enc - el,
                          np.ones(len(az)))
        return Places(self.az, self.el, az_enc + self.turn, el_enc, np.abs(reach))

    def text(self, zero=0.0, names=None):
        """Description for users."""
        return self.sentence


def other_places(rows):
    """All other clocks and sites that are tried for a run.

    Parameters
    ----------
    rows : FileRows

    Returns
    -------
    list of MovedRun
    """
    out = []
    if rows.solved is not None:
        site = rows.solved.site
        out = [_of_stars(rows, *_clock(hours), site, hours) for hours in _zones()]
        out += [_of_stars(rows, text, _SITE, _SET_SITE, other) for text, other in _sites(site)]
        out = [one for one in out if one is not None]
    elif rows.mount.celestial:
        az, el = rows.columns[:2]
        out.append(MovedRun('the latitude with the other sign', _SITE, _SET_SITE, az, el,
                             Mount.equatorial(-rows.mount.latitude, rows.mount.kind)))
    return out


def _zones():
    whole = np.arange(0.5, _LARGEST_ZONE + 0.5, 0.5).tolist()
    return [sign * hours for hours in (*whole, *_ODD_ZONES) for sign in (1.0, -1.0)]


def _clock(hours):
    """Mistake, kind and advice for a clock this many hours ahead of UTC."""
    minutes, size = round(60.0 * abs(hours)), f'{abs(hours):g} hour' + 's' * (abs(hours) != 1.0)
    zone = f'{"+" if hours > 0.0 else "-"}{minutes // 60:02d}:{minutes % 60:02d}'
    return (f'a clock {size} {"ahead of" if hours > 0.0 else "behind"} UTC (local time?)', _TIMES,
            f'write the times in UTC, or with their zone, {zone}')


def _sites(site):
    """Sites with exchanged coordinates or wrong signs."""
    lat, lon = site.latitude, float(wrap(site.longitude))
    yield 'the longitude with the other sign', replace(site, longitude=-lon)
    yield 'the latitude with the other sign', replace(site, latitude=-lat)
    yield ('latitude and longitude with the other sign',
           replace(site, latitude=-lat, longitude=-lon))
    if abs(lon) <= 90.0 * DEG:
        yield 'latitude and longitude exchanged', replace(site, latitude=lon, longitude=lat)


def _of_stars(rows, text, kind, advice, site, hours=0.0):
    """The run with its stars as seen from a site, `hours` earlier than its clock."""
    solved = rows.solved
    there = np.isin(rows.line, solved.lines)
    if not there.any():
        return None
    stars = solved.at(rows.line[there])
    try:
        az, el = replace(stars, time=stars.time - 3600.0 * hours, site=site).observed()
    except ValueError:  # beyond the tables of the Earth's rotation
        return None
    mount = rows.mount
    if not mount.vertical:
        if mount.celestial:
            mount = Mount.equatorial(site.latitude, mount.kind)
        az, el = mount.axes_of(az, el)
    turn = 0.0
    if rows.reads_by_clock:
        turn = sidereal_time(stars.time - 3600.0 * hours, site) - sidereal_time(stars.time,
                                                                                solved.site)
    places = np.full((3, len(rows.line)), np.nan)
    places[:2, there], places[2, there] = (az, el), turn
    return MovedRun(text, kind, advice, *places[:2], mount, places[2])
