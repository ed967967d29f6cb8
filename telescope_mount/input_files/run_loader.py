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

"""Loads pointing runs from files and logs."""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from calibration.analysis.diagnosis.mistaken_columns import check_columns
from calibration.analysis.solve_check import check_solves
from calibration.report.wording import wording
from msg_tools import topics
from msg_tools.bag.topic_names import prefix_of
from pointing_model.context import Context
from pointing_model.effects import declared_graduation, declared_worms
from pointing_model.mounts import centred, is_beyond, mount_text, parse_mount
from pointing_model.runs.columns.row_checks import NoUsableRow
from pointing_model.runs.columns.run_table import NoObservations
from pointing_model.runs.copies import copies, without_copies, written_twice
from pointing_model.runs.row_exclusion import without_excluded
from pointing_model.runs.run import PointingRun, known_site
from pointing_model.runs.run_messages import cloud_to_run
from pointing_model.runs.run_reader import read_run, swap_encoders
from pointing_model.sky.site import SITE
from pointing_model.sky.skyline import parse_horizon

from ..nights.night_files import is_log, log_of

_SAME_START = 2e-3  # s: messages give it to the millisecond


def load_run(path, azimuth_origin=None, *, site=None, weather=None, encoder=None,
             graduation=None, worms=None, drivers=(), mount=None, equinox=None, exclude=(),
             satellites=False):
    """Read a pointing run from any file that `read_run` accepts, or from a log.

    Rows for validation (``check`` not 0) are excluded, with a note.

    Parameters
    ----------
    path : str or Path
        A file, the folder of a log, or of a night.
    azimuth_origin : {'N', 'S'}, optional
        Where azimuth 0 is in a TPOINT file.
    site : pointing_model.sky.site.Site, optional
        Stored in ``meta``; needed for a CSV with ``ra_deg, dec_deg``.
    weather : pointing_model.sky.refraction.Weather or dict, optional
        For the refraction of such a CSV; entries of a dict override the file's.
    encoder : {'enc', 'abs'}, optional
        'abs' swaps in the second encoder as the first.
    graduation : str or dict, optional
        Lines per turn of the first encoder, ``grating=47200``, overrides a log; see
        `pointing_model.effects.declared_graduation`.
    worms : str or dict, optional
        Numbers of teeth of worm wheels, ``ha=180``: see `pointing_model.effects.declared_worms`.
    drivers : sequence of str, optional
        Columns of the file that may be causes although their names do not suggest it.
    mount : str or Mount, optional
        Mount of a file, overrides it; see `pointing_model.mounts.parse_mount`.
    equinox : {'j2000', 'date'}, optional
        Equinox of the catalogue places of a file, see `read_run`.
    exclude : sequence of str
        Rows to exclude, see `pointing_model.runs.row_exclusion.excluded_rows`.
    satellites : bool
        Whether to include satellites of a log.

    Returns
    -------
    PointingRun

    Raises
    ------
    MistakenColumns
        A ValueError: no row is usable, since the columns do not match their names.
    ValueError
        Not a run, a log of the simulator's truth, or no such driver.
    OSError
        The file cannot be read.
    """
    path = log_of(path)
    if not is_log(path):
        try:
            run = _without_check_rows(_worded(check_solves(read_run(
                path, azimuth_origin=azimuth_origin, site=site, weather=weather, encoder=encoder,
                mount=mount, equinox=equinox))))
        except NoUsableRow as error:
            if error.run is not None:  # mistaken columns are the better explanation
                check_columns(error.run)
            raise
    else:
        if equinox is not None:
            raise ValueError(f'{path} is a log, which has no catalogue places; leave out --equinox')
        run = run_of_log(path, satellites)
        if mount is not None and not run.mount.agrees(parse_mount(mount, run.mount.latitude)):
            raise ValueError(f'{path} is a log of a night with a mount that is '
                             f'{mount_text(run.mount)}; leave out --mount')
        if site is not None:
            run.meta['site'] = {**known_site(run.meta), **site} if isinstance(
                site, dict) else site
        if encoder == 'abs':
            swap_encoders(path, run.columns, run.meta)
    if exclude:
        run = without_excluded(run, exclude)
    if graduation:
        run.meta['graduation'] = declared_graduation(graduation, run.mount.names)
    if worms:
        run.meta['worms'] = declared_worms(worms, run.mount.names)
    if drivers:
        run.meta['drivers'] = _drivers(path, run, drivers)
    return run


def _worded(run):
    """The run, with findings about its own rows put into words."""
    names = run.meta.get('row_names') or {}
    if run.meta.get('solves_checked'):
        run.meta['notes'] = list(map(wording, run.meta['notes']))
        run.meta['excluded'] = [
            {**one, 'reason': ': '.join([*([names[one['row']]] if one['row'] in names else []),
                                         wording(one['reason'])])}
            for one in run.meta['excluded']]
    return run


def _drivers(path, run, names):
    """Internal names of the user's columns."""
    own = Context.from_run(run).own_columns()
    kept = [f'column_{name}' if f'column_{name}' in own else name for name in names]
    missing = [name for name, there in zip(names, kept) if there not in own]
    if missing:
        raise ValueError(f'{path}: no column {", ".join(missing)} to take as a cause; '
                         'known ones, such as temperature_c, are causes already, others of the '
                         f'file are: {", ".join(own) or "none"}')
    return tuple(kept)


def load_runs(paths, seen=(), **options):
    """Several runs of one mount; each observation counts once.

    Parameters
    ----------
    paths : sequence of Path
    seen : sequence of PointingRun
        Runs whose observations are excluded from these, such as runs for validation.
    **options
        See `load_run`.

    Returns
    -------
    runs : list of PointingRun
        One per file, in the given order.
    skipped : list of str
        A line for each file that is not a run, has no observation, or has only known rows.

    Raises
    ------
    ValueError
        None of the files is a run with observations (the line is that of the first), or all
        observations are in `seen`.
    OSError
        The only file cannot be opened.
    """
    runs, wrong = [], []
    for path in paths:
        try:
            runs.append(load_run(path, **options))
        except (OSError, ValueError) as error:
            wrong.append((path, error))
    if not runs:
        if not wrong:
            raise ValueError('no file with a pointing run is given')
        if len(wrong) == 1:
            raise wrong[0][1]
        raise ValueError(f'none of {len(wrong)} files could be read: {_line_of(*wrong[0])}')
    runs, copied = without_copies(runs, seen)
    return runs, copied + [
        line if isinstance(error, NoObservations) else f'{line} (file left out)'
        for path, error in wrong for line in [_line_of(path, error)]]


def _line_of(path, error):
    """One line about a file."""
    if isinstance(error, OSError):
        return f'{path}: {error.strerror or error}'
    return str(error)


def run_of_log(path, satellites=False):
    """The observations in a log, with the newest zero of each power-on subtracted.

    Parameters
    ----------
    path : Path
    satellites : bool
        Whether to include satellites.

    Returns
    -------
    PointingRun
        ``az_raw``, ``el_raw`` are raw encoder readings, without zero and miss distance.

    Raises
    ------
    ValueError
        The log has no observation, or the simulator's truth.
    """
    from calibration.distrust import distrusted, notes_of
    from msg_tools.bag.bag_pair import parameters_of
    from msg_tools.units import wrap
    from pointing_model.calibration_messages import ZeroPairs, joints_to_zero
    from pointing_model.zero import NO_ZERO, is_for_zero, way_of

    bag = _log(path)
    parts, zeros, prefix = [], {}, prefix_of(bag)
    names = [f'{prefix}{topic.name}' for topic in (
        topics.OBSERVATION, topics.ZERO, topics.ZERO_IDENTITY)]
    identified = any(topic.name == names[2] and topic.count for topic in bag.topics)
    take = ZeroPairs().take if identified else joints_to_zero
    for message in bag.messages(names, decode=True):
        if message.topic == names[0]:
            parts.append(cloud_to_run(message.data))
        elif parts:
            found = take(message.data, run=parts[-1]['run'][-1])
            if found is not None:
                key = found[1].run, found[1].started
                zeros.pop(key, None)  # keep the newest of a number last
                zeros[key] = found[1]
    if not parts:
        raise NoObservations(f'{path} has no observation in it')
    run, notes = PointingRun.concatenate(parts), []
    copied = copies(run) >= 0  # in a log that recorded the replay of another
    if copied.any():
        notes.append(written_twice(copied))
        run = run.select(~copied)
    run, zeros = _power_ons(run, zeros, notes)
    columns = dict(run.columns)
    columns['az_raw'], columns['el_raw'] = _readings(columns, not run.mount.vertical
                                                     and is_beyond(run['el']))
    if zeros:
        notes.append(f'zeros of the night subtracted, one on each of {len(zeros)} power-ons'
                     if len(zeros) > 1 else 'zero of the night subtracted')
        az, el = zeros.filled(np.unique(run['run']), NO_ZERO).row_angles(run)
        columns['az_enc'], columns['el_enc'] = columns['az_enc'] - az, columns['el_enc'] - el
    columns['az_enc'] = run['az'] + wrap(columns['az_enc'] - run['az'])
    stars = ~is_for_zero(run)
    way = way_of(run.select(~stars)) or 'Polaris'
    notes.append(f'{int((~stars).sum())} exposures of {way} left out')
    notes += notes_of(run)
    passes = (run['star'] < 0) & (not satellites)
    if passes.any():
        notes.append(f'{int((passes & stars).sum())} exposures of satellites left out: '
                     '"satellite" fits them')
    stars &= ~distrusted(run) & ~passes
    meta = {**run.meta, 'source': str(path), 'notes': notes + bag.problems, 'excluded': []}
    calibration, guard, observer = (parameters_of(bag.metadata, f'{prefix}{name}') or {}
                                    for name in ('calibration', 'mount_guard', 'star_observer'))
    meta |= declared_by({**guard, **{k: v for k, v in calibration.items() if v}}, meta['notes'])
    site = {one.field: observer[name] * one.size for name, one in SITE.items() if name in observer}
    if site:
        meta['site'] = {**site, **known_site(meta)}
    return _without_check_rows(PointingRun({n: v[stars] for n, v in columns.items()}, meta))


def _power_ons(run, zeros, notes):
    """Unique power-on numbers, if nights in one log share them, and their zeros.

    Parameters
    ----------
    run : PointingRun
    zeros : dict of (number, number or None) to PowerOnZero
        Keys: number of the power-on, and when it began, UTC s.
    notes : list of str
        A note is added.

    Returns
    -------
    PointingRun, Zeros
    """
    from pointing_model.zero import Zeros
    began = np.nan_to_num(np.asarray(run.get('encoder_start', np.zeros(len(run))), float))
    keys, rows = np.unique([began, run['run']], axis=1, return_inverse=True)
    number = np.arange(len(keys.T)) + int(np.min(run['run']))
    if len(keys.T) == len(np.unique(keys[1])):
        return run, Zeros(zeros.values())
    notes.append(f'{len(keys.T)} power-ons share {len(np.unique(keys[1]))} numbers: they are '
                 'from several nights, and were renumbered')
    return PointingRun({**run.columns, 'run': number[rows.ravel()]}, run.meta), Zeros(
        replace(zero, run=int(new)) for new, (start, old) in zip(number, keys.T)
        for (of, when), zero in zeros.items()
        if of == old and when is not None and abs(when - start) < _SAME_START)


def declared_by(parameters, notes):
    """``meta`` entries of runs from recorded parameters: ``graduation``, ``skyline``.

    Parameters
    ----------
    parameters : dict
    notes : list of str
        Unknown values are noted.

    Returns
    -------
    dict
    """
    out = {}
    if parameters.get('graduation'):
        out['graduation'] = declared_graduation(parameters['graduation'])
    horizon = parameters.get('horizon') or ''
    try:
        out['skyline'] = parse_horizon(horizon)
    except OSError:
        notes.append(f'skyline file {horizon} not found: proposed directions may be below the '
                     'skyline')
    return out


def _log(path):
    """Reader of a log; a folder of images gets its own message."""
    from msg_tools.bag.sqlite import open_bag  # slow to import, needed for logs only
    try:
        return open_bag(path)
    except (ValueError, OSError):
        from pointing_model.runs.plate_solves.mapping import PATTERNS
        if not path.is_dir() or not any(any(path.glob(pattern)) for pattern in PATTERNS):
            raise
        mapping = path / 'mount.yaml'
        raise ValueError(
            f'{path} is a folder of images: give {mapping}' if mapping.is_file() else
            f'{path} is a folder of images: write {mapping}, which says what their keywords are '
            '(docs/plate_solved.md has one to copy), and give that') from None


def _without_check_rows(run):
    """The run without rows for validation, with a note of their number."""
    kept = np.asarray(run.get('check', 0.0)) != 0.0
    if not kept.any():
        return run
    return run.part(~kept, notes=[*run.meta.get('notes', ()), f'{int(kept.sum())} rows excluded '
                                  'that are for validation (check = 1)'])


def _readings(columns, beyond=False):
    """Raw readings at the exposure, from readings with the star centred."""
    az, el = columns['az_enc'], columns['el_enc']
    if 'miss_x' not in columns or 'miss_y' not in columns:
        return az, el
    az_raw, el_raw = az, el
    for _ in range(5):  # each reduces the error by a factor of about the miss distance
        az_centred, el_centred = centred(az_raw, el_raw, columns['miss_x'], columns['miss_y'],
                                         beyond)
        az_raw, el_raw = az_raw + (az - az_centred), el_raw + (el - el_centred)
    return az_raw, el_raw


def with_rows_before(kept, folder):
    """Rows of a night together with all earlier ones.

    Parameters
    ----------
    kept : PointingRun
        With the column ``time``.
    folder : Path
        Folder of the night: its logs are ``bag*``, one for each start.

    Returns
    -------
    PointingRun
        Unreadable logs are skipped.
    """
    rows = {}
    for path in sorted(folder.glob('bag*')):
        with suppress(ValueError, OSError):  # the log of a killed graph may be damaged
            rows.update(_rows_of(path))
    before = [rows[time] for time in sorted(rows) if time < kept['time'][0]]
    return PointingRun.concatenate([*before, kept])


def _rows_of(path):
    """Time and row of each observation of a log; nothing for the simulator's truth."""
    from msg_tools.bag import BagReader
    log = BagReader(path)
    if log.has_truth:
        return
    for message in log.messages(f'{prefix_of(log)}{topics.OBSERVATION.name}', decode=True):
        row = cloud_to_run(message.data)
        yield row['time'][0], row
