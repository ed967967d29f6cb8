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

"""Solves a folder of images into a run; solved images are not solved again."""

import json
from collections import Counter
from pathlib import Path

import numpy as np

from msg_tools.whole_files import beside
from pointing_model.runs.columns.cells import write_rows
from pointing_model.runs.columns.solve_columns import one_mount
from pointing_model.runs.formats.csv import iso_utc
from pointing_model.runs.formats.images import common_site, one_image, refuse_absent
from pointing_model.runs.plate_solves.fits_images import NotThere, read_header
from pointing_model.runs.plate_solves.solvers import NotSolved

SOLVED, FAILED, HUNG = 'solved', 'not solved', 'hung'
#: images in a row on which a solver may hang before it is given up
HANGS = 5
_SOLUTION = ('ra_deg', 'dec_deg', 'sigma_arcsec', 'scale_arcsec_px', 'parity')


class Journal:
    """Results by image: a line of JSON each, written immediately.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path):
        self.path = Path(path)
        self.entries = {}
        if self.path.exists():
            for line in self.path.read_text(encoding='utf-8', errors='replace').splitlines():
                try:
                    entry = json.loads(line)
                    self.entries[entry['image']] = entry
                except (ValueError, TypeError, KeyError):
                    continue  # a line truncated by a crash

    def of(self, image):
        """The entry of an image if it has not changed since, or None."""
        entry = self.entries.get(image.name)
        return entry if entry and entry.get('stamp') == _stamp(image) else None

    def add(self, image, **entry):
        """Write the entry of an image."""
        entry = {'image': image.name, 'stamp': _stamp(image), **entry}
        self.entries[image.name] = entry
        text = json.dumps(entry) + '\n'
        if self.path.exists():
            data = self.path.read_bytes()
            text = text if not data or data.endswith(b'\n') else '\n' + text
        with open(self.path, 'a', encoding='utf-8') as stream:
            stream.write(text)
        return entry


def _stamp(image):
    status = image.stat()
    return f'{status.st_size}.{status.st_mtime_ns}'


def solve_folder(folder, mapping, solver, out, *, again=False, report=lambda text: None,
                 progress=None):
    """Solve the images of a folder into a run.

    Parameters
    ----------
    folder : Path
    mapping : Mapping
        Keywords of the mount.
    solver : Solver
    out : Path
        The CSV, rewritten at the end, even after an error; ``out.jsonl`` in the same folder is
        the journal: unchanged images in it are not solved again.
    again : bool
        Try unsolved images again.
    report : callable
        Gets a line for people about each image.
    progress : callable, optional
        Called with (text, done, total).

    Returns
    -------
    Counter
        Number of images by result: `SOLVED`, `FAILED`, `HUNG`.

    Raises
    ------
    ValueError
        No images, images of several mounts or sites, a keyword that no image has, no solved image,
        or the solver hangs.
    """
    files = mapping.images(folder)
    journal = Journal(f'{out}.jsonl')
    rows, site = _rows(mapping, files)
    entries, counts, hangs = {}, Counter(), 0
    try:
        for done, file in enumerate(files):
            if progress:
                progress('solving', done, len(files))
            _, reason = rows[file.name]
            entry = journal.of(file)
            if reason is not None:
                entry = {'status': FAILED, 'reason': reason}
                report(f'{file.name}: left out, {reason}')
            elif entry is None or (again and entry['status'] != SOLVED):
                entry = _solve(file, mapping, solver, journal)
                report(f'{file.name}: {_outcome(entry)}')
            counts[entry['status']] += 1
            entries[file.name] = entry
            hangs = hangs + 1 if entry['status'] == HUNG else 0
            if hangs >= HANGS and not counts[SOLVED]:
                raise ValueError(
                    f'{solver.program} hangs: {hangs} images in a row did not end in '
                    f'{solver.timeout:g} s; give its scale (--scale), more time (--timeout), or '
                    'another solver')
    finally:
        if counts[SOLVED]:
            _write(out, [(rows[name][0], entry) for name, entry in entries.items()], mapping, site,
                   len(files))
    if not counts[SOLVED]:
        reason = entries[files[0].name].get('reason')
        raise ValueError(f'{folder}: none of {len(files)} images is solved ({files[0].name}: '
                         f'{reason})')
    return counts


def _rows(mapping, files):
    """Row from the keywords, and the reason if it is unusable, by image name; the common site."""
    rows, absent, headers = {}, Counter(), []
    for file in files:
        try:
            header = read_header(file)
        except NotThere as error:
            rows[file.name] = {}, str(error)
            continue
        headers.append((file, header))
        row, reason, missing = one_image(header, mapping, solve=False)
        absent.update(missing)
        rows[file.name] = row, reason
    refuse_absent(mapping.path, absent, headers)
    site = common_site(mapping.path, mapping, headers)
    one_mount(mapping.path, ((file.name, rows[file.name][0].pop('telescope', None))
                             for file in files))
    for file in files:
        rows[file.name][0].setdefault('star', file.name)
    return rows, site


def _solve(file, mapping, solver, journal):
    try:
        solution, sigma = solver.solve(file, mapping.boresight)
    except NotSolved as error:
        return journal.add(file, status=HUNG if error.hung else FAILED, reason=str(error))
    place = {**solution._asdict(), 'frame': solution.frame.text if solution.frame else 'ICRS'}
    if np.isfinite(sigma):
        place['sigma_arcsec'] = round(sigma, 4)
    return journal.add(file, status=SOLVED, solver=solver.kind, **place)


def _outcome(entry):
    if entry['status'] != SOLVED:
        return f'{entry["status"]}, {entry["reason"]}'
    sigma = f' +- {entry["sigma_arcsec"]:.2f} arcsec' if 'sigma_arcsec' in entry else ''
    return (f'solved, {entry["ra_deg"]:.5f} {entry["dec_deg"]:+.5f}{sigma}, '
            f'{entry["scale_arcsec_px"]:.4g} arcsec a pixel')


def _write(out, done, mapping, site, count):
    """Write the run of the solved images."""
    solved = [({**row, **{n: v for n, v in entry.items() if n in _SOLUTION}}, entry)
              for row, entry in done if entry['status'] == SOLVED]
    rows = [row for row, _ in solved]
    frame = solved[0][1].get('frame', 'ICRS')
    first = ('star', 'time', *_SOLUTION[:2], *mapping.needed[1:], *_SOLUTION[2:])
    names = [name for name in first if any(name in row for row in rows)]
    names += [name for name in dict.fromkeys(n for row in rows for n in row) if name not in names]
    with beside(out) as part, open(part, 'w', newline='', encoding='utf-8') as stream:
        stream.write(f'# frame: {frame}\n')
        if mapping.readings is not None:
            stream.write(f'# readings: {mapping.readings.text}\n')
        if mapping.mount is not None:
            stream.write(f'# mount: {mapping.mount}\n')
        stream.writelines(f'# {name}: {value!r}\n' for name, value in site.items())
        if len(rows) < count:
            stream.write(f'# unsolved: {count - len(rows)} of {count} images\n')
        write_rows(stream, [names, *([_cell(name, row.get(name)) for name in names]
                                     for row in rows)])


def _cell(name, value):
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return ''
    if name == 'time':
        return iso_utc(np.array([value]))[0]
    return repr(value) if isinstance(value, float) else value
