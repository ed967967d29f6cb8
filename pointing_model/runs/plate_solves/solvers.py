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

"""Run a plate solver (solve-field or ASTAP) on an image."""

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .fits_images import NotThere, astropy_fits, read_header, solution_of

#: solver -> names of its program, and what to install
PROGRAMS = {
    'solve-field': (('solve-field',), 'astrometry.net and index files for the field, in Debian '
                    'astrometry.net, astrometry-data-tycho2-10-19 (fields wider than 1 degree)'),
    'astap': (('astap_cli', 'astap'), 'astap and its star database'),
}
#: time limit for one image, s
TIMEOUT = 120.0
_GRACE = 5.0  # s: a solver is killed this long after its own time limit
_FREE = 6  # with fewer degrees of freedom the scatter of the stars gives no sigma
_BLEND = 10.0  # times the median distance: matched stars farther off are false matches
_TAIL = 120  # characters of a solver's last output line to quote


class NoSolver(ValueError):
    """No plate solver is installed, or it cannot be started."""


class NotSolved(Exception):
    """One image is not solved; the text says why.

    Parameters
    ----------
    text : str
    hung : bool
        Whether the solver had to be killed.
    """

    def __init__(self, text, hung=False):
        super().__init__(text)
        self.hung = hung


@dataclass(frozen=True)
class PlateSolver:
    """An installed solver.

    Attributes
    ----------
    kind : str
        One of `PROGRAMS`.
    program : str
        Path.
    timeout : float
        Seconds for one image.
    scale : tuple of float, or None
        Smallest and largest image scale, arcsec per pixel.
    quick : bool
        Skip solve-field's steps for crowded and striped images: each is a separate process, and
        together they take three quarters of the time.
    """

    kind: str
    program: str
    timeout: float = TIMEOUT
    scale: tuple | None = None
    quick: bool = False

    def solve(self, image, boresight=None):
        """Solve one image.

        Parameters
        ----------
        image : Path
        boresight : tuple of float, optional
            See `solution_of`.

        Returns
        -------
        solution : pointing_model.runs.plate_solves.fits_images.PlateSolution
        sigma_arcsec : float
            1-sigma error of the place in each axis, from the scatter of the matched stars; NaN if
            the solver gives none.

        Raises
        ------
        NotSolved
            There is no solution, the time is over, or the solver failed.
        NoSolver
            The solver cannot be started.
        """
        with tempfile.TemporaryDirectory(prefix='solve_') as folder:
            folder = Path(folder)
            output = self._run(image, folder)
            read = _read_solve_field if self.kind == 'solve-field' else _read_astap
            header, sigma = read(folder, image, output)
            try:
                return solution_of(header, boresight), sigma
            except NotThere as error:
                raise NotSolved(f'{self.kind} gave no place: {error}') from None

    def command(self, image, folder):
        """Arguments of the command that solves `image` and writes into `folder`."""
        if self.kind == 'astap':
            words = [self.program, '-f', str(image), '-r', '180', '-o', str(folder / 'solved')]
            return words if self.scale is None else [*words, '-fov', f'{self._height(image):.6g}']
        words = [self.program, '--no-plots', '--overwrite', '--no-verify', '--new-fits', 'none',
                 # about another reference point the field is curved, and the fit must absorb it
                 '--crpix-center',
                 '--dir', str(folder), '--temp-dir', str(folder), '--out', 'solved',
                 '--cpulimit', str(max(int(self.timeout), 1))]
        if self.quick:
            words += ['--no-remove-lines', '--uniformize', '0']
        if self.scale is not None:
            words += ['--scale-units', 'arcsecperpix', '--scale-low', f'{self.scale[0]:g}',
                      '--scale-high', f'{self.scale[1]:g}']
        return [*words, str(image)]

    def _height(self, image):
        """Height of the field, degrees, at the geometric mean of the scales."""
        try:
            rows = float(read_header(image)['NAXIS2'])
        except (NotThere, KeyError) as error:
            raise NotSolved(f'no height of the image ({error})') from None
        return rows * float(np.sqrt(self.scale[0] * self.scale[1])) / 3600.0

    def _run(self, image, folder):
        """Run the solver, with a time limit for all its processes; its last line of output."""
        with open(folder / 'said.txt', 'w+', encoding='utf-8', errors='replace') as output:
            try:
                # a process group: killing solve-field alone leaves its engine running
                process = subprocess.Popen(
                    self.command(image.absolute(), folder), stdin=subprocess.DEVNULL, stdout=output,
                    stderr=subprocess.STDOUT, cwd=folder, start_new_session=True)
            except OSError as error:
                raise NoSolver(f'{self.program} cannot be started: {error.strerror}') from None
            try:
                process.wait(self.timeout + _GRACE)
            except subprocess.TimeoutExpired:
                raise NotSolved(f'no end after {self.timeout + _GRACE:.0f} s', hung=True) from None
            finally:
                _end(process)
            output.seek(0)
            lines = [line.strip() for line in output.read().splitlines() if line.strip()]
        last = lines[-1][-_TAIL:] if lines else 'nothing'
        if process.returncode < 0:
            raise NotSolved(f'{self.kind} died of signal {-process.returncode} (it said: {last})')
        if process.returncode and not (folder / 'solved.ini').exists():
            raise NotSolved(f'{self.kind} ended with code {process.returncode} (it said: {last})')
        return last


def _end(process):
    """Kill a process that still runs, with its process group."""
    if process.poll() is None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def find_solver(name=None, timeout=TIMEOUT, scale=None):
    """The requested solver, or the first that is installed.

    Parameters
    ----------
    name : str, optional
        One of `PROGRAMS`, or the path of one of their programs.
    timeout, scale
        See `PlateSolver`.

    Returns
    -------
    PlateSolver

    Raises
    ------
    NoSolver
        It is not installed, or unknown.
    """
    astropy_fits()
    for kind, (programs, _) in PROGRAMS.items():
        if name is None or name in (kind, *programs):
            for program in programs:
                path = shutil.which(program)
                if path:
                    return PlateSolver(kind, path, timeout, scale)
    if name is not None and name not in PROGRAMS:
        kind = next((kind for kind, (programs, _) in PROGRAMS.items()
                     if Path(name).name.startswith((kind, *programs))), None)
        if kind is None:
            raise NoSolver(f'solver {name!r} is none that is known: {", ".join(PROGRAMS)}, or the '
                           'path of one of them')
        path = shutil.which(name)
        if path is None:
            raise NoSolver(f'{name} is no program that can be started')
        return PlateSolver(kind, path, timeout, scale)
    wanted = PROGRAMS if name is None else {name: PROGRAMS[name]}
    raise NoSolver('no plate solver is installed; install ' + ', or '.join(
        where for _, where in wanted.values()))


# ------------------------------------------------------------------------------------- results

def _read_solve_field(folder, image, output):
    if not (folder / 'solved.wcs').is_file():
        why = '' if 'did not solve' in output.lower() else f' (it said: {output})'
        raise NotSolved(f'no solution{why}')
    try:
        header = read_header(folder / 'solved.wcs')
        size = header.get('IMAGEW', 1), header.get('IMAGEH', 1)
        return header, _match_sigma(folder / 'solved.corr', size)
    except NotThere as error:
        raise NotSolved(f'its solution cannot be read: {error}') from None


def _match_sigma(path, size):
    """Error of the place of the image centre in each axis, arcsec, from the matched stars.

    It is the standard error at the centre of a second-order polynomial fit in both pixel
    coordinates, as solve-field makes it. NaN if there are too few stars.
    """
    fits, _ = astropy_fits()
    try:
        stars = fits.getdata(path, 1)
        x, y, ra, dec, ra_seen, dec_seen = (np.asarray(stars[name], float) for name in (
            'field_x', 'field_y', 'index_ra', 'index_dec', 'field_ra', 'field_dec'))
    except (OSError, KeyError, TypeError, ValueError, IndexError):
        return np.nan
    away = 3600.0 * np.stack((
        ((ra_seen - ra + 180.0) % 360.0 - 180.0) * np.cos(np.radians(dec)), dec_seen - dec))
    u, v = (2.0 * value / pixels - 1.0 for value, pixels in zip((x, y), size))
    columns = np.stack((np.ones_like(u), u, v, u * u, u * v, v * v))
    # exclude blends and chance matches, to which the solver gives little weight
    far = np.hypot(*away)
    good = np.isfinite(far) & (far <= _BLEND * np.median(far))
    free = 2 * (int(good.sum()) - len(columns))
    if free < _FREE:
        return np.nan
    normal = columns[:, good] @ columns[:, good].T
    try:
        unit = np.linalg.inv(normal)[0, 0]
    except np.linalg.LinAlgError:
        return np.nan
    return float(np.sqrt(unit * np.sum(np.square(away[:, good])) / free))


def _read_astap(folder, image, output):
    path = folder / 'solved.ini'
    entries = {}
    if path.is_file():
        for line in path.read_text(encoding='utf-8', errors='replace').splitlines():
            name, _, value = line.partition('=')
            entries[name.strip().upper()] = value.strip()
    if entries.get('PLTSOLVD', 'F') != 'T':
        why = entries.get('ERROR') or entries.get('WARNING') or output
        raise NotSolved(f'no solution ({why[:_TAIL]})')
    fits, _ = astropy_fits()
    try:
        first = read_header(image)
        header = fits.Header({'CTYPE1': 'RA---TAN', 'CTYPE2': 'DEC--TAN', 'RADESYS': 'ICRS',
                              'NAXIS1': first['NAXIS1'], 'NAXIS2': first['NAXIS2']})
        for name in ('CRPIX1', 'CRPIX2', 'CRVAL1', 'CRVAL2', 'CD1_1', 'CD1_2', 'CD2_1', 'CD2_2'):
            header[name] = float(entries[name])
    except (NotThere, KeyError, ValueError) as error:
        raise NotSolved(f'its solution cannot be read: {error}') from None
    return header, np.nan
