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

"""Images for ``bolts --live``, from a folder or a camera: each is solved and evaluated."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.report.bolt_wording import axis_document, watch_lines
from msg_tools.units import ARCSEC, DEG
from pointing_model.bolts_and_feet import polar_axis
from pointing_model.image_alignment import LEAST_TURN, Image
from pointing_model.mounts import through_pole, unit_vector
from pointing_model.runs.formats.images import common_site, one_image
from pointing_model.runs.plate_solves.fits_images import NotThere, read_header, solution_of
from pointing_model.runs.plate_solves.frames import ICRS, to_icrs
from pointing_model.runs.plate_solves.mapping import load_mapping
from pointing_model.runs.plate_solves.solvers import NotSolved, find_solver
from pointing_model.sky.places import observed_directions
from pointing_model.sky.refraction import air_at
from pointing_model.sky.site import Site

from .bolt_watch import COLLECTED, STOPPED, THREE, BoltWatch

#: exposure time of a camera, s; interval between checks of a folder, s; it ends after this time
#: without a new image, s; sufficient distance from the pole, arcsec
EXPOSURE, EVERY, PATIENCE, WITHIN_ARCSEC = 1.0, 2.0, 600.0, 10.0
#: sigma of a solution without one, in pixels
_SIGMA = 0.3
#: least sigma of an image, rad: a solver's sigma excludes seeing and wind
_SEEING = 1.0 * ARCSEC
_TIMEOUT = 60.0


class LiveFolder:
    """The images of a folder, each solved once.

    Parameters
    ----------
    folder : Path
    args : argparse.Namespace
        Arguments of the command.
    latitude : float, optional
        Latitude of the model, rad: used if neither options nor images give it.
    """

    def __init__(self, folder, args, latitude=None):
        self.folder, self._args, self._latitude = folder, args, latitude
        path = args.keywords or folder / 'mount.yaml'
        if not path.exists():
            raise ValueError(f'{path} is not there: it says which keywords of the images are what '
                             '(docs/plate_solved.md has one to copy); --keywords names another')
        self.mapping = load_mapping(path)
        if 'ha_enc_deg' not in self.mapping.columns:
            raise ValueError(f'{path}: bolts are of equatorial mounts, whose images give '
                             'ha_enc_deg and dec_enc_deg')
        self._solver = find_solver(args.solver, _TIMEOUT, args.scale and tuple(args.scale)) \
            if args.solver else None
        self._seen, self.site = {}, None

    def new_images(self):
        """New images, in the order in which they were taken.

        Yields
        ------
        name, written, image, reason : str, float, Image or None, str or None
            `written` is when the file was written, s since 1970.
        """
        rows = []
        for path in self._files():
            stamp = (path.stat().st_size, path.stat().st_mtime_ns)
            if self._seen.get(path.name) == stamp:
                continue
            self._seen[path.name] = stamp
            try:
                header = read_header(path)
            except NotThere as error:
                rows.append((np.inf, path, None, str(error)))
                continue
            row, reason, _ = one_image(header, self.mapping, solve=False)
            self.site = self.site or self._site_of(path, header)
            rows.append((row.get('time', np.inf), path, (header, row), reason))
        for _, path, found, reason in sorted(rows, key=lambda row: (row[0], row[1].name)):
            written = self._seen[path.name][1] * 1e-9
            if reason is None:
                try:
                    yield path.name, written, self._image(path, *found), None
                    continue
                except (NotThere, NotSolved) as error:
                    reason = str(error)
            yield path.name, written, None, reason

    def _files(self):
        try:
            return self.mapping.images(self.folder)
        except ValueError:  # no images yet
            return []

    def _site_of(self, path, header):
        given = common_site(self.mapping.path, self.mapping, [(path, header)])
        site = {'latitude': given.get('latitude_deg'), 'longitude': given.get('longitude_deg'),
                'height': given.get('height_m')}
        for name in site:
            if getattr(self._args, name) is not None:
                site[name] = getattr(self._args, name)
        if site['latitude'] is None and self._latitude is not None:
            site['latitude'] = self._latitude / DEG
        if None in (site['latitude'], site['longitude']):
            raise ValueError(f'{self.mapping.path} gives no site: --latitude and --longitude')
        return Site(site['latitude'] * DEG, site['longitude'] * DEG, site['height'] or 0.0)

    def _image(self, path, header, row):
        solution, sigma = self._solved(path, header)
        first, second = row['ha_enc_deg'] * DEG, row['dec_enc_deg'] * DEG
        side = str(row.get('pier_side', '')).strip().lower().removeprefix('pier').lstrip('_ ')
        if side in ('west', 'w') and np.cos(second) > 0.0:
            first, second = (float(v) for v in through_pole(first, second, True))
        air = {name: _first(getattr(self._args, option), row.get(name)) for name, option in (
            ('pressure_hpa', 'pressure'), ('temperature_c', 'temperature'))}
        return image_of(solution, row.get('sigma_arcsec', sigma), row['time'], first, second,
                        self.site, path.name, air, self.mapping.frame)

    def _solved(self, path, header):
        """The solution in the header, or by the solver."""
        if self._solver is None:
            try:
                found, _ = one_image(header, self.mapping)[:2]
                if 'ra_deg' in found:
                    return solution_of(header, self.mapping.boresight), np.nan
            except NotThere:
                pass
            self._solver = find_solver(None, _TIMEOUT, self._args.scale and tuple(self._args.scale))
        return solved(self._solver, path, self.mapping.boresight)


def solved(solver, path, boresight=None):
    """Solve an image, the quick way if possible; see `PlateSolver.solve`."""
    if solver.kind == 'solve-field':
        try:
            return replace(solver, quick=True).solve(path, boresight)
        except NotSolved as error:
            if error.hung:
                raise
    return solver.solve(path, boresight)


def image_of(solution, sigma, moment, first, second, site, name, air=None, frame=None):
    """Convert a solution to an `Image`.

    Parameters
    ----------
    solution : PlateSolution
    sigma : float
        arcsec per axis; NaN if the solver gives none.
    moment : float
        UTC, s.
    first, second : float
        Readings, rad.
    site : Site
    name : str
    air : dict, optional
        Fields of a `Weather`, if known.
    frame : Frame, optional
        Replaces that of the solution.

    Returns
    -------
    pointing_model.image_alignment.Image
    """
    if not np.isfinite(sigma):
        sigma = _SIGMA * solution.scale_arcsec_px
    time_of = np.atleast_1d(moment)
    icrs = to_icrs(*(np.atleast_1d(v * DEG) for v in (solution.ra_deg, solution.dec_deg)),
                   frame or solution.frame or ICRS, time_of)
    known = {key: value for key, value in (air or {}).items() if value is not None}
    seen = observed_directions(*icrs, time_of, site, air_at(site.height, known))
    az, el = float(seen.az[0]), float(seen.el[0])
    return Image(first, second, unit_vector(az, el), float(np.hypot(sigma * ARCSEC, _SEEING)),
                 moment, name)


def _first(*values):
    return next((v for v in values if v is not None), None)


def live(args):
    """Take images until the axis is at the pole, an error doubles, or no more images come."""
    from .commands import bolts as command
    model = command.model_of(args)[0] if args.file is not None else None
    if model is not None and not model.mount.celestial:
        raise ValueError(f'{model.mount.names.words} has no polar axis')
    if not args.live.startswith('indi:'):
        folder = Path(args.live)
        if not folder.is_dir():
            raise ValueError(f'{folder} is no folder of images')
        return _watched(LiveFolder(folder, args, model and model.mount.latitude), args, model)
    from .bridges.indi.bolt_camera import BoltCamera
    solver = find_solver(args.solver, _TIMEOUT, args.scale and tuple(args.scale))
    air = {'pressure_hpa': args.pressure, 'temperature_c': args.temperature}
    site = {name: getattr(args, name) for name in ('latitude', 'longitude', 'height')}
    if model is not None and site['latitude'] is None:
        site['latitude'] = model.mount.latitude / DEG
    with BoltCamera(args.live, args.exposure, lambda path: solved(solver, path),
                    lambda *of: image_of(*of, air), site) as camera:
        return _watched(camera, args, model)


def _watched(source, args, model):
    """Report the images of a folder or camera; returns the exit code."""
    from .commands import bolts as command
    from .commands.console import new_console, write_outputs
    console, watch, readings, last = new_console(), None, [], None
    per_turn = args.per_turn and [60.0 * v for v in args.per_turn]
    console.print('What is left is reported after each image.' if model is not None else
                  f'Three images first: turn the hour axis alone by {LEAST_TURN / DEG:.0f} degrees '
                  'or more between them, better by 15.')
    quiet, code = time.monotonic(), 1
    while time.monotonic() - quiet < args.patience and not (readings and readings[-1].get('end')):
        for name, written, image, reason in source.new_images():
            quiet = time.monotonic()
            if watch is None and source.site is not None:
                watch = _watch(source, args, model, command)
            if reason is None:
                try:
                    found = watch.add(image)
                except ValueError as error:
                    reason = str(error)
            if reason is not None:
                console.print(f'{name}: left out, {reason}', soft_wrap=True)
                continue
            entry = axis_document(found.axis, args.pole != 'true') if found.axis else None
            late = time.time() - written
            near = entry and entry['pole_distance_arcsec'] < max(
                args.within, 2.0 * entry['pole_distance_sigma_arcsec'])
            done = near and found.kind == THREE and found.again
            lines = watch_lines(found, entry, near, per_turn)
            if found.kind != COLLECTED or lines != last:  # a camera continues while nothing turns
                console.print(f'{name}, {late:.1f} s after it was written:', soft_wrap=True)
                for line in lines:
                    console.print(f'  {line}', soft_wrap=True)
            last = lines
            readings.append({'image': name, 'by': found.kind, 'images': found.count,
                         'seconds': late, 'polar_axis': entry,
                         'end': bool(done) or found.kind == STOPPED})
            code = 0 if done else 1
            if readings[-1]['end']:
                break
        else:
            time.sleep(args.every)
    if not readings:
        console.print('No image came.')
    write_outputs(console, args, {'images': readings})
    return code


def _watch(source, args, model, command):
    """The `BoltWatch`, once the site is known."""
    latitude = source.site.latitude if model is None else model.mount.latitude
    refraction = command.refraction_of(args, latitude)
    return BoltWatch(latitude, refraction, model,
                     None if model is None else polar_axis(model, refraction))
