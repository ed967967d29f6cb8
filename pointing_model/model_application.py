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

"""Applies a model to directions: columns of degrees in, columns of degrees out."""

from pathlib import Path

import numpy as np

from msg_tools.units import ARCSEC, DEG

from .context import Context
from .model import PointingModel
from .runs.run import COLUMNS, column_name
from .sky.site import SITE
from .zero import NO_ZERO, carried_zeros

#: name in a file -> (name in memory, its unit in SI)
_DRIVERS = {csv_name: (name, unit) for name, (csv_name, unit, _) in COLUMNS.items()}
#: names of zeros, as alternatives to a run number
NEWEST, NO_ZEROS = 'newest', 'none'
_ROUNDS, _SETTLED = 100, 1e-7 * ARCSEC


def apply(model, az_deg, el_deg, *, reverse=False, zero=NEWEST, latitude_deg=None,
          longitude_deg=None, **drivers):
    """Encoder angles at which the mount points at directions, or the inverse.

    Parameters
    ----------
    model : PointingModel, what has one as ``model`` (a fit, a diagnosis), str or Path
        A path is a model file of this program, or of another that `model_files.read_model` reads.
    az_deg, el_deg : float or array_like, shape (n,)
        Observed place, degrees, azimuth from north through east. With `reverse`: encoder
        readings. For other mounts: angles of the axes, such as hour angle and declination
        (beyond 90 degrees through the pole).
    reverse : bool
    zero : {'newest', 'none'} or number
        Which zero of those stored in the model to use: the newest, that of the run with this
        number, or none. A driver ``run`` selects the zero of its run for each row.
    latitude_deg, longitude_deg : float, optional
        Site, for effects that depend on sidereal time.
    **drivers : float or array_like, shape (n,)
        Drivers of the model's effects, by the names and units of a CSV: ``temperature_c=4.5``,
        ``time`` (UTC, seconds since 1970), ``approach_az``, ... An effect without its driver
        counts as zero; `PointingModel.unknown` reports which.

    Returns
    -------
    az_deg, el_deg : ndarray, shape (n,)
        Degrees. The azimuth is on the branch nearest to the given one. NaN where the mount
        cannot point.

    Raises
    ------
    ValueError
        No such zero, a file without a model, drivers of another length, or a site out of range.
    OSError
        The file cannot be read.
    """
    if isinstance(model, str | Path):
        from .runs.model_reader import read_model
        model = read_model(model)
    given, model = model, getattr(model, 'model', model)
    if not isinstance(model, PointingModel):
        raise ValueError(f'{type(given).__name__} is no model: give a model file, or what has one: '
                         'a fit, a diagnosis')
    _refuse_misspelled(model, drivers)
    az, el = np.asarray(az_deg, float) * DEG, np.asarray(el_deg, float) * DEG
    try:
        shape = np.broadcast_shapes(az.shape, el.shape)
    except ValueError:
        shape = az.shape  # the elevations are refused, by name
    az, el = _each_direction(az, shape, 'az_deg'), _each_direction(el, shape, 'el_deg')
    columns = {}
    for name, value in drivers.items():
        key, unit = _DRIVERS.get(name, (name, 1.0))
        columns[key] = _each_direction(value, shape, name).ravel()
        columns[key] = columns[key] * unit if unit != 1.0 else columns[key]
    place = [None if v is None else v * DEG for v in (latitude_deg, longitude_deg)]
    context = Context(az.ravel(), el.ravel(), columns, *place, mount=model.mount)
    for name, value in (('latitude_deg', latitude_deg), ('longitude_deg', longitude_deg)):
        if value is not None:
            SITE[name].check(context)
    zeros = zeros_of_rows(model, zero, columns.get('run'))[0]
    out = turned(model, context, zeros, reverse)
    return tuple(v.reshape(az.shape) / DEG for v in out)


def _each_direction(value, shape, name):
    """A value for each direction; ValueError that names it if their numbers differ."""
    try:
        return np.broadcast_to(np.asarray(value), shape)
    except ValueError:
        raise ValueError(f'{name} has the shape {np.shape(value)}, the directions have {shape}: '
                         'give one value for all, or one for each') from None


def _refuse_misspelled(model, drivers):
    """Refuse an unknown driver if one that an effect needs is missing: it may be misspelled."""
    given = {_DRIVERS.get(name, (name,))[0] for name in drivers}
    followed = {name for one in model.effects for name in one.effect.requires}
    unknown, missing = given - followed - set(COLUMNS), followed - given
    if unknown and missing:
        raise ValueError(f'no effect follows {", ".join(sorted(unknown))}; not given is '
                         + ', '.join(sorted(map(column_name, missing))))


def axis_angles(mount, ra_deg, dec_deg, time, *, longitude_deg, latitude_deg=None, height_m=0.0,
                pressure_hpa=None, temperature_c=None, of_date=False, beyond=None):
    """Axis angles at which a perfect mount points at places of the sky, without a model.

    Parameters
    ----------
    mount : Mount or PointingModel
    ra_deg, dec_deg : float or array_like, shape (n,)
        ICRS (J2000), or apparent places with `of_date`, degrees.
    time : float or array_like, shape (n,)
        UTC, seconds since 1970.
    longitude_deg, latitude_deg, height_m : float
        Site. An equatorial mount has its own latitude.
    pressure_hpa, temperature_c : float or array_like, optional
        Weather, for the refraction; pressure 0: no refraction. By default the standard
        atmosphere at the height of the site, 10 C.
    of_date : bool
    beyond : bool or array_like of bool, optional
        Whether a German mount points through the pole; by default with its counterweight down.

    Returns
    -------
    first, second, height : ndarray, shape (n,)
        Degrees: azimuth from 0 to 360, other angles within the travel of the mount; `height` is
        the elevation above the horizon.

    Raises
    ------
    ValueError
        No latitude, or not that of the mount; site, time or air out of range.
    """
    from pointing_model.sky.refraction import air_at

    from .runs.plate_solves.frames import ICRS, OF_DATE, to_icrs
    from .sky.places import observed_directions
    from .sky.site import Site
    mount = getattr(mount, 'mount', mount)
    if mount.celestial:
        own = mount.latitude / DEG
        if latitude_deg is not None and abs(latitude_deg - own) > SITE['latitude_deg'].same:
            raise ValueError(f'latitude {latitude_deg:g} is not that of the mount ({own:.4f})')
        latitude_deg = own
    if latitude_deg is None:
        raise ValueError('places of the sky need the latitude of the site')
    ra, dec, time = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, float)) for v in (
        ra_deg, dec_deg, time)))
    icrs = to_icrs(ra * DEG, dec * DEG, OF_DATE if of_date else ICRS, time)
    given = {'pressure_hpa': pressure_hpa, 'temperature_c': temperature_c}
    weather = air_at(height_m, {name: v for name, v in given.items() if v is not None})
    seen = observed_directions(*icrs, time, Site(latitude_deg * DEG, longitude_deg * DEG, height_m),
                               weather)
    if beyond is None:
        beyond = mount.side_for(*mount.axes_of(seen.az, seen.el), 0.0, False)
    first, second = mount.on_travel(*mount.axes_of(seen.az, seen.el, beyond))
    if mount.vertical:
        first = np.mod(first, 2.0 * np.pi)
    return first / DEG, second / DEG, seen.el / DEG


def turned(model, context, zero=(0.0, 0.0), reverse=False):
    """Convert directions of a context to encoder angles, or back.

    Parameters
    ----------
    model : PointingModel
    context : Context
        n rows; with `reverse` its directions are encoder readings.
    zero : pair of float or of ndarray, shape (n,)
        Zero offset of the encoders, azimuth and elevation, radians.
    reverse : bool

    Returns
    -------
    az, el : ndarray, shape (n,)
        Radians; NaN where the mount cannot point.
    """
    az, el = context.az, context.el
    if not reverse:
        out = model.sky_to_encoder(az, el, context)
        if model.follows_reading and not {'az_enc', 'el_enc', 'az_raw', 'el_raw'} & set(
                context.columns):
            # graduation errors depend on the raw reading, zero included: iterate; each round
            # divides the error by period / (2 pi amplitude)
            for _ in range(_ROUNDS):
                last, out = out, model.sky_to_encoder(az, el, context.at(
                    az, el, az_raw=out[0] + zero[0], el_raw=out[1] + zero[1]))
                if np.nanmax(np.abs(np.subtract(out, last)), initial=0.0) < _SETTLED:
                    break
        return out[0] + zero[0], out[1] + zero[1]
    # graduation errors depend on the raw reading, zero included
    context = context.at(az, el, **{'az_raw': az, 'el_raw': el, **{
        name: context.columns[name] for name in ('az_raw', 'el_raw') if name in context.columns}})
    return model.encoder_to_sky(az - zero[0], el - zero[1], context)


def zeros_of_rows(model, wanted=NEWEST, run=None):
    """The zeros to apply, selected from those stored in a model.

    Parameters
    ----------
    model : PointingModel
    wanted : {'newest', 'none'} or number
        See `apply`.
    run : ndarray, shape (n,), optional
        Run number of each row; takes precedence over 'newest'.

    Returns
    -------
    zero : pair of float or of ndarray, shape (n,)
        Azimuth and elevation, radians.
    applied : list of PowerOnZero
        The zeros used.

    Raises
    ------
    ValueError
        The model has no zero of that run, or `wanted` is something else.
    """
    known = carried_zeros(model)
    if wanted == NO_ZEROS:
        return (0.0, 0.0), []
    if wanted != NEWEST:
        try:
            number = float(wanted)
        except (TypeError, ValueError):
            raise ValueError(f'zero={wanted!r} names no zero: newest, none or the number of a run'
                             ) from None
        if number not in known:
            there = ', '.join(f'{n:g}' for n in known) or 'none'
            raise ValueError(f'the model carries no zero of run {number:g}; it has: {there}')
        return (known[number].az, known[number].el), [known[number]]
    if not known:
        return (NO_ZERO.az, NO_ZERO.el), []
    if run is None:
        return (known.newest.az, known.newest.el), [known.newest]
    numbers = np.asarray(run, float)
    missing = sorted(set(numbers.tolist()) - set(map(float, known)))
    if missing:
        there = ', '.join(f'{n:g}' for n in known)
        raise ValueError(f'the model carries no zero of run {missing[0]:g} (it has: {there}); '
                         'leave the column run out, or say --zero newest, none or a number')
    zeros = np.array([known[n].angles for n in numbers.tolist()]).reshape(len(numbers), 2)
    return tuple(zeros.T), [known[n] for n in sorted(set(numbers.tolist()))]
