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

"""A run from solved images: FITS files, and a YAML file that maps their keywords."""

import difflib
from collections import Counter

import numpy as np

from pointing_model.runs.plate_solves.fits_images import (
    NotThere,
    read_header,
    row_of,
    site_of,
    solution_of,
)
from pointing_model.runs.plate_solves.mapping import load_mapping
from pointing_model.runs.run import COLUMNS, column_name
from pointing_model.sky.site import SITE

from ..columns.declarations import declare
from ..columns.run_table import RunTable, numbered_runs, own_name
from ..columns.solve_columns import one_mount

_TEXT = ('star', 'block', 'run', 'pier_side')


def read_images(path):
    """Read a folder of images with the YAML file that maps their keywords.

    Parameters
    ----------
    path : Path
        The YAML file, see `pointing_model.runs.plate_solves.mapping`.

    Returns
    -------
    RunTable
        One row per image, in the order of file names, which are in ``meta['row_names']``. Images
        without a solution are excluded with a reason.

    Raises
    ------
    ValueError
        The YAML file is invalid, there are no images, a keyword is in none of them, they are of
        several mounts or sites, or astropy is not installed.
    """
    mapping = load_mapping(path)
    files = mapping.images()
    rows, reasons, absent = [], [], Counter()
    headers = []
    for file in files:
        try:
            header = read_header(file)
        except NotThere as error:
            rows.append({})
            reasons.append(str(error))
            continue
        headers.append((file, header))
        row, reason, missing = one_image(header, mapping)
        absent.update(missing)
        rows.append(row)
        reasons.append(reason)
    if not headers:
        raise ValueError(f'{path}: none of {len(files)} images can be read '
                         f'({files[0].name}: {reasons[0]})')
    refuse_absent(path, absent, headers)
    meta = {'format': 'images', 'notes': [],
            'taken': 'the keywords were taken as the mapping names them',
            'row_names': {i: file.name for i, file in enumerate(files, 1)}}
    for name, value in common_site(path, mapping, headers).items():
        declare(meta, name, value, str(path))
    one_mount(path, ((file.name, row.pop('telescope', None)) for file, row in zip(files, rows)))
    _settle_frame(mapping, rows, reasons, meta)
    if mapping.mount is not None:
        meta['mount_declared'] = mapping.mount
    if mapping.readings is not None:
        meta['readings_frame'] = mapping.readings
    columns = _columns(rows, mapping, meta)
    table = RunTable(columns, np.arange(1, len(files) + 1), meta,
                     names=mapping.names)
    for i, reason in enumerate(reasons):
        if reason:
            table.exclude_row(i, reason)
    return table


def one_image(header, mapping, solve=True):
    """Row of an image, the reason for excluding it (or None), and its missing keywords."""
    row, missing = {}, []
    try:
        row, missing = row_of(header, mapping)
        needed = (*mapping.needed, 'exposure_s') if mapping.shift else mapping.needed
        lacking = [name for name in needed if name not in row]
        if lacking:
            return row, f'no keyword {", ".join(missing)} for {", ".join(lacking)}', missing
        if solve:
            row.update(solution_of(header, mapping.boresight)._asdict())
    except NotThere as error:
        return row, str(error), missing
    return row, None, missing


def refuse_absent(path, absent, headers):
    """Refuse a mapping with a keyword that no image has.

    Raises
    ------
    ValueError
        It names the most similar keyword.
    """
    for name, count in absent.items():
        if headers and count == len(headers):
            there = [k for k in headers[0][1] if k and k not in ('COMMENT', 'HISTORY')]
            near = difflib.get_close_matches(name, there, 1, 0.5)
            text = f'closest: {near[0]}' if near else f'they have {", ".join(there[:40])}'
            raise ValueError(f'{path}: keyword {name} is in none of {count} images ({text})')


def common_site(path, mapping, headers):
    """The common site of all images; empty if the mapping has no site.

    Raises
    ------
    ValueError
        The images are of several sites, or none has the keywords.
    """
    first, where = None, None
    for file, header in headers:
        try:
            site = site_of(header, mapping)
        except NotThere:
            continue
        if first is None:
            first, where = site, file
        elif any(abs(site[name] - first[name]) > SITE[name].same for name in site):
            raise ValueError(f'{path}: {file.name} has another site than {where.name}: split the '
                             'folder')
    if mapping.site and headers and first is None:
        raise ValueError(f'{path}: no image has the keywords of the site')
    return first or {}


def _settle_frame(mapping, rows, reasons, meta):
    """Set the frame: that of the mapping, else that of most images; others are excluded."""
    frames = Counter(row['frame'] for row, reason in zip(rows, reasons) if not reason)
    if mapping.frame is not None:
        meta['sky_frame'] = mapping.frame
        others = sum(n for frame, n in frames.items() if frame not in (None, mapping.frame))
        if others:
            meta['notes'].append(f'frame {mapping.frame.text} used, from the mapping; '
                                 f'{others} images declare another')
        return
    if not frames:
        return
    usual = frames.most_common(1)[0][0]
    for i, row in enumerate(rows):
        if not reasons[i] and row['frame'] != usual:
            names = [frame.text if frame else 'not said' for frame in (row['frame'], usual)]
            reasons[i] = f'the frame of its WCS is {names[0]}, of the others {names[1]}'
    if usual is not None:
        meta['sky_frame'] = usual


def _columns(rows, mapping, meta):
    """Columns for a `RunTable`, in the units of the images."""
    names = list(dict.fromkeys(name for row in rows for name in row if name != 'frame'))
    needed, columns = ('ra_deg', 'dec_deg', *mapping.needed), {}
    known = {**{column_name(name, mapping.names): name for name in COLUMNS},
             **{name: name for name in (*needed[:2], 'pier_side', 'ra_enc_deg')}}
    for csv_name in [*names, *(n for n in needed if n not in names)]:
        values = [row.get(csv_name) for row in rows]
        name = known.get(csv_name)
        if name is None:
            name = csv_name if csv_name in ('scale_arcsec_px', 'parity', 'sigma_arcsec') \
                else own_name(csv_name, names, meta['notes'])
        if name in _TEXT and any(isinstance(v, str) for v in values):
            columns[name] = np.array(['' if v is None else str(v) for v in values])
            continue
        columns[name] = np.array([np.nan if v is None or isinstance(v, str) else v
                                  for v in values], float)
    if 'run' in columns and columns['run'].dtype.kind == 'U':
        columns['run'] = numbered_runs(columns['run'].tolist(), meta['notes'])
    return columns
