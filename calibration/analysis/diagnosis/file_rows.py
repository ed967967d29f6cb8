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

"""The four columns of a run as written in its file, for the check of the columns."""

from pathlib import PurePath

import numpy as np

from pointing_model.context import Context
from pointing_model.mounts import is_beyond, through_pole
from pointing_model.sky.places import SIDEREAL

ROWS = 600  # rows checked, evenly spaced: more would not change the result
_SOME = 20 * ROWS  # rows from which these are taken
_SAME = 1e-7  # largest difference of sines of equal angles


class FileRows:
    """Rows of a run with numbers in all four columns.

    Parameters
    ----------
    run : PointingRun
        With ``meta['as_written']`` if read from a file.
    encoder : {'enc', 'abs'}

    Attributes
    ----------
    where : str
        Prefix of messages: the name of the file.
    mount : Mount
    assumed : bool
        Whether nobody has said which mount it is.
    solved : Solved or None
        Celestial positions from which the catalogue angles were computed.
    reads_by_clock : bool
        Whether the hour angles of the mount were computed from its right ascensions and the time.
    held : bool
        Whether the file has on-sky offsets in place of encoder angles.
    rows_used, misplaced : int
        Number of rows of the run, and of rows that its reader excluded for their position.
    columns : list of ndarray, shape (n,)
        Catalogue and encoder angles, radians, before rows are moved beyond the pole.
    beyond : ndarray of bool, shape (n,), or None
        Rows that a column of the file places beyond the pole.
    label : ndarray of int, shape (n,)
        Run index of each row.
    line : ndarray of int, shape (n,)
    sidereal : bool
        Whether `lst` is the local sidereal time of the site.
    lst : ndarray, shape (n,), or None
        Sidereal time, radians; its zero is unknown unless `sidereal`.
    """

    def __init__(self, run, encoder='enc'):
        source = run.meta.get('source')
        self.where = f'{PurePath(str(source)).name}: ' if source else ''
        self.mount, self.solved = run.mount, run.meta.get('solved')
        self.assumed = bool(run.meta.get('mount_assumed'))
        self.reads_by_clock = bool(run.meta.get('reads_by_clock'))
        self.held = not run.meta.get('raw_reading', True) and encoder == 'enc'
        self.rows_used = len(run)
        written, place = _written(run, encoder)
        self.misplaced = written['misplaced_rows']
        self.rows_read = len(run) + self.misplaced
        names = ('az', 'el', f'az_{encoder}', f'el_{encoder}')
        finite = np.isfinite(np.sum([written[name] for name in names], axis=0))
        some = np.flatnonzero(finite & ((place >= 0) | written['misplaced']))
        some = some[_evenly(len(some), ROWS)]
        self.columns = [np.asarray(written[name], float)[some] for name in names]
        self.line = written['line'][some]
        self.beyond = written['beyond'][some] if 'beyond' in written else None
        self.label = _labels(run, place[some])
        self.lst, self.sidereal = (None, False) if self.mount.vertical else _clock(
            run, written, place, some)


def _written(run, encoder):
    """Rows as written in the file, and the index of each in the run, or -1."""
    names = (f'az_{encoder}', f'el_{encoder}')
    written = run.meta.get('as_written')
    if written is not None and set(names) <= set(written):
        order = np.argsort(run.lines, kind='stable')
        at = np.searchsorted(run.lines[order], written['line'])
        place = order[np.minimum(at, len(run) - 1)] if len(run) else np.zeros(len(at), int)
        there = (at < len(run)) & ~written['misplaced']
        there[there] = run.lines[place[there]] == written['line'][there]
        place = np.where(there, place, -1)
        if _same_readings(run, written, place, names):
            return written, place
    some = _evenly(len(run), _SOME)
    columns = {name: np.asarray(run[name][some], float) for name in ('az', 'el', *names)}
    beyond = is_beyond(columns['el'])
    if not run.mount.vertical or beyond.any():  # convert axis angles to positions on the sky
        columns['az'], columns['el'] = through_pole(columns['az'], columns['el'], beyond)
    return {**columns, 'line': run.lines[some], 'misplaced_rows': 0,
            'misplaced': np.zeros(len(some), bool)}, some


def _same_readings(run, written, place, names):
    """Whether the run still has the encoder angles of the file, on either side of the pole."""
    used = place >= 0
    az, el = (np.asarray(run[name], float)[place[used]] for name in names)
    away = np.concatenate((np.cos(2.0 * az) - np.cos(2.0 * written[names[0]][used]),
                           np.sin(el) - np.sin(written[names[1]][used])))
    away = away[np.isfinite(away)]
    return used.sum() >= min(len(run), 1) and bool(np.all(np.abs(away) < _SAME))


def _labels(run, place):
    """Run index of each row; excluded rows get the most frequent one."""
    if 'run' not in run or not len(run):
        return np.zeros(len(place), int)
    label = np.unique(run['run'], return_inverse=True)[1]
    usual = np.bincount(label).argmax()
    return np.where(place >= 0, label[np.maximum(place, 0)], usual)


def _clock(run, written, place, some):
    """Sidereal time if all rows have one, else None, and whether it is that of the site."""
    lst = None
    if len(run) and (place[some] >= 0).all():
        lst = Context.from_run(run).get('lst')
    if lst is not None:
        return _whole(np.asarray(lst, float)[place[some]]), True
    for name, unit in (('lst_h', np.pi / 12.0), ('time', SIDEREAL)):
        if name in written:
            return _whole(unit * np.asarray(written[name], float)[some]), name == 'lst_h'
        if name in run and len(run) and (place[some] >= 0).all():
            return _whole(unit * np.asarray(run[name], float)[place[some]]), name == 'lst_h'
    return None, False


def _whole(values):
    return values if np.isfinite(values).all() else None


def _evenly(count, most):
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).astype(int)
