"""The folder of images that ``bolts --live`` watches: each is solved, and what is left is told."""

import time
from dataclasses import replace

import numpy as np

from calibration.report.alignment_wording import axis_document, watch_lines
from msg_tools.units import ARCSEC, DEG
from pointing_model.alignment import polar_axis
from pointing_model.bolt_turns import Image
from pointing_model.mounts import Mount, parse_mount, through_pole
from pointing_model.runs.formats.images import common_site, one_image
from pointing_model.runs.plate_solves.fits_images import NotThere, read_header
from pointing_model.runs.plate_solves.frames import ICRS, to_icrs
from pointing_model.runs.plate_solves.mapping import load_mapping
from pointing_model.runs.plate_solves.solvers import NotSolved, find_solver
from pointing_model.sky.places import DEFAULT_WEATHER, Site, observed_directions

from .bolt_watch import STOPPED, THREE, BoltWatch

#: of a solution without a sigma, as a part of a pixel
_SIGMA = 0.3
#: least sigma of an image, rad: what solvers give knows no seeing and no wind
_SEEING = 1.0 * ARCSEC
_TIMEOUT = 60.0


class LiveFolder:
    """The images of a folder, each solved once.

    Parameters
    ----------
    args : argparse.Namespace
        Of the command.
    latitude : float, optional
        Of the model, rad: where neither options nor images give it.
    """

    def __init__(self, args, latitude=None):
        self.folder, self._args, self._latitude = args.live, args, latitude
        path = args.keywords or args.live / 'mount.yaml'
        if not path.exists():
            raise ValueError(f'{path} is not there: it says which keywords of the images are what '
                             '(docs/plate_solved.md has one to copy); --keywords names another')
        self.mapping = load_mapping(path)
        if not self.mapping.names.celestial:
            raise ValueError(f'{path}: bolts are of equatorial mounts, whose images give '
                             'ha_enc_deg and dec_enc_deg')
        self._solver = find_solver(args.solver, _TIMEOUT, args.scale and tuple(args.scale)) \
            if args.solver else None
        self._seen, self.site = {}, None

    def new_images(self):
        """Images that were not looked at, in the order in which they were taken.

        Yields
        ------
        path, image, reason : Path, Image or None, str or None
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
            if reason is None:
                try:
                    yield path, self._image(path, *found), None
                    continue
                except (NotThere, NotSolved) as error:
                    reason = str(error)
            yield path, None, reason

    def _files(self):
        try:
            return self.mapping.images(self.folder)
        except ValueError:  # none yet
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
        sigma = row.get('sigma_arcsec', sigma)
        if not (sigma is not None and np.isfinite(sigma)):
            sigma = _SIGMA * solution.scale_arcsec_px
        ra, dec = to_icrs(*(np.atleast_1d(v * DEG) for v in (solution.ra_deg, solution.dec_deg)),
                          self.mapping.frame or solution.frame or ICRS, np.atleast_1d(row['time']))
        weather = {name: value for name, value in (
            ('pressure_hpa', _first(self._args.pressure, row.get('pressure_hpa'))),
            ('temperature_c', _first(self._args.temperature, row.get('temperature_c'))))
            if value is not None}
        seen = observed_directions(ra, dec, np.atleast_1d(row['time']), self.site,
                                   replace(DEFAULT_WEATHER, **weather))
        az, el = float(seen.az[0]), float(seen.el[0])
        first, second = row['ha_enc_deg'] * DEG, row['dec_enc_deg'] * DEG
        side = str(row.get('pier_side', '')).strip().lower().removeprefix('pier').lstrip('_ ')
        if side in ('west', 'w') and np.cos(second) > 0.0:
            first, second = (float(v) for v in through_pole(first, second, True))
        place = np.array([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)])
        return Image(first, second, place, float(np.hypot(sigma * ARCSEC, _SEEING)),
                     row['time'], path.name)

    def _solved(self, path, header):
        """The solution in the header, or of the solver."""
        if self._solver is None:
            try:
                found, _ = one_image(header, self.mapping)[:2]
                if 'ra_deg' in found:
                    from pointing_model.runs.plate_solves.fits_images import solution_of
                    return solution_of(header, self.mapping.boresight), None
            except NotThere:
                pass
            self._solver = find_solver(None, _TIMEOUT, self._args.scale and tuple(self._args.scale))
        if self._solver.kind == 'solve-field':
            try:
                return replace(self._solver, quick=True).solve(path, self.mapping.boresight)
            except NotSolved as error:
                if error.hung:
                    raise
        return self._solver.solve(path, self.mapping.boresight)


def _first(*values):
    return next((v for v in values if v is not None), None)


def live(args):
    """Watch the folder until the axis is on the pole, an error doubles, or nothing comes."""
    from .commands import bolts as command
    from .commands.console import new_console, write_outputs
    if not args.live.is_dir():
        raise ValueError(f'{args.live} is no folder of images')
    model = command.model_of(args)[0] if args.file is not None else None
    if model is not None and not model.mount.celestial:
        raise ValueError(f'a mount that is {model.mount.kind} has no polar axis')
    folder = LiveFolder(args, model and model.mount.latitude)
    console, watch, told = new_console(), None, []
    per_turn = args.per_turn and [60.0 * v for v in args.per_turn]
    console.print('Three images first: turn the hour axis alone by 15 degrees or more between '
                  'them.' if model is None else 'What is left is told after each image.')
    quiet, code = time.monotonic(), 1
    while time.monotonic() - quiet < args.patience and not (told and told[-1].get('end')):
        for path, image, reason in folder.new_images():
            quiet = time.monotonic()
            if watch is None and folder.site is not None:
                watch = _watch(folder, args, model, command)
            if reason is None:
                try:
                    found = watch.add(image)
                except ValueError as error:
                    reason = str(error)
            if reason is not None:
                console.print(f'{path.name}: left out, {reason}', soft_wrap=True)
                continue
            entry = axis_document(found.axis, args.pole != 'true') if found.axis else None
            late = time.time() - path.stat().st_mtime
            near = entry and entry['apart_arcsec'] < max(
                args.within, 2.0 * entry['apart_sigma_arcsec'])
            done = near and found.kind == THREE and found.again
            console.print(f'{path.name}, {late:.1f} s after it was written:', soft_wrap=True)
            for line in watch_lines(found, entry, near, per_turn):
                console.print(f'  {line}', soft_wrap=True)
            told.append({'image': path.name, 'by': found.kind, 'images': found.count,
                         'seconds': late, 'polar_axis': entry,
                         'end': bool(done) or found.kind == STOPPED})
            code = 0 if done else 1
            if told[-1]['end']:
                break
        else:
            time.sleep(args.every)
    if not told:
        console.print('No image came.')
    write_outputs(console, args, {'images': told})
    return code


def _watch(folder, args, model, command):
    """The watch, once the site is known."""
    latitude = folder.site.latitude if model is None else model.mount.latitude
    kind = folder.mapping.mount or 'equatorial'
    Mount.equatorial(latitude, parse_mount(kind, latitude).kind)
    refraction = command.refraction_of(args, latitude)
    return BoltWatch(latitude, refraction, model,
                     None if model is None else polar_axis(model, refraction))
