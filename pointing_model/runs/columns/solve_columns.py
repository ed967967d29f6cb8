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

"""Columns of plate solutions besides their places: sigma and scale."""

import numpy as np

from pointing_model.sky.places import icrs_to_observed

#: fraction by which the scale of a solution may differ from the others'
_SCALE = 0.03
_LIKE = 0.005  # the same for the scales of one other camera or binning
_HOURS = 24.0
_FEW = 8
SCALE, PARITY, SIGMA = 'scale_arcsec_px', 'parity', 'sigma_arcsec'


def take_sigma(table):
    """Set `sigma_x`, `sigma_y` (arcsec) of a plate-solved table from ``sigma_arcsec``, in place.

    A solution without a sigma gets the median of the others.
    """
    columns, notes = table.columns, table.meta['notes']
    if 'ra_deg' not in columns or SIGMA not in columns:
        return
    sigma = columns.pop(SIGMA)
    if {'sigma_x', 'sigma_y'} & set(columns):
        notes.append(f'{SIGMA} left out: {table.label("sigma_x")}, {table.label("sigma_y")} are '
                     'used')
        return
    known = sigma[np.isfinite(sigma) & (sigma > 0.0)]
    if not known.size:
        notes.append(f'{SIGMA} left out: no solution has a value')
        return
    missing = np.isnan(sigma)
    if missing.any():
        notes.append(f'{SIGMA} is empty in {missing.sum()} of {len(sigma)} rows: the median of '
                     f'the others, {np.median(known):.3g}, is taken there')
    sigma = np.where(missing, np.median(known), sigma)
    table.exclude(~(sigma > 0.0), f'{SIGMA} is not positive')
    columns['sigma_x'], columns['sigma_y'] = sigma, sigma.copy()
    table.meta['solver_sigma'] = True


def flag_scales(table):
    """Exclude solutions whose image scale or parity differs from that of the others."""
    columns, notes = table.columns, table.meta['notes']
    if 'ra_deg' not in columns:
        return
    for name in (SCALE, PARITY):
        if name not in columns:
            continue
        values = columns.pop(name)
        table.meta['from_images'] = True
        sound = (table.reasons == 0) & np.isfinite(values)
        if sound.sum() < 3:
            continue
        usual = np.median(values[sound])
        odd = sound & (np.sign(values) != np.sign(usual)) if name == PARITY else \
            sound & ~(np.abs(values - usual) <= _SCALE * abs(usual))
        other = np.median(values[odd]) if odd.any() else usual
        if odd.sum() > sound.sum() / 3:
            notes.append(f'{name} differs in {odd.sum()} of {sound.sum()} solutions: several '
                         'cameras or binnings? No row excluded')
        elif name == PARITY:
            table.exclude(odd, 'its solution is mirrored, the others are not: a false solve, or a '
                               'flipped image')
        elif odd.sum() >= 3 and np.all(np.abs(values[odd] - other) <= _LIKE * abs(other)):
            notes.append(f'{odd.sum()} solutions have a scale of {other:.4g} arcsec a pixel, the '
                         f'others {usual:.4g}: another camera or binning?')
        else:
            for i in np.flatnonzero(odd):
                flipped = ' (opposite sign)' if values[i] * usual < 0.0 else ''
                table.exclude_row(i, f'image scale {values[i]:.4g} arcsec/pixel{flipped}, in the '
                                  f'other solutions {usual:.4g}: a false solve')


def may_be_hours(degrees):
    """Whether right ascensions, shape (n,), may be hours: at least `_FEW`, all from 0 to 24."""
    return len(degrees) >= _FEW and degrees.min() >= 0.0 and degrees.max() <= _HOURS


def refuse_hours(path, ra, dec, time, site):
    """Refuse right ascensions in hours: as hours they are above the horizon, as degrees not.

    Parameters
    ----------
    path : Path
    ra, dec, time : ndarray, shape (n,)
        ICRS with the frame of the file, radians; UTC, seconds since 1970. Finite.
    site : Site

    Raises
    ------
    ValueError
    """
    degrees = np.degrees(ra)
    if not may_be_hours(degrees):
        return
    below = icrs_to_observed(ra, dec, time, site)[1] < 0.0
    as_hours = icrs_to_observed(15.0 * ra, dec, time, site)[1] < 0.0
    if below.mean() > 1.0 / 3.0 and as_hours.mean() < 0.1:
        raise ValueError(
            f'{path}: ra_deg looks like hours (at most {degrees.max():.3g}): {below.sum()} of '
            f'{len(ra)} rows are below the horizon, as hours {as_hours.sum()}; give degrees')


def one_mount(path, mounts):
    """Refuse observations of more than one mount.

    Parameters
    ----------
    path : Path
    mounts : sequence of (str, object)
        Place of each observation in the file, and the name of its mount; without one it counts
        for none.

    Raises
    ------
    ValueError
        It names the first observation of another mount.
    """
    named = [(place, str(mount)[:40]) for place, mount in mounts if mount]
    for place, mount in named:
        if mount != named[0][1]:
            raise ValueError(f'{path}: {place} is of mount {mount!r}, {named[0][0]} of '
                             f'{named[0][1]!r}: a run is of one mount; split it')
