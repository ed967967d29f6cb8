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

"""Normal points: rows of tracks averaged to a run that can be diagnosed like one of stars."""

import numpy as np

from pointing_model.mounts import is_beyond
from pointing_model.runs.run import PointingRun
from pointing_model.runs.satellite_tracks import STARS

#: length of a track in one point, s; largest number of points
_SECONDS, _MOST = 120.0, 400


def normal_points(fit):
    """Pointing run with the errors of the mount alone, from a fit of tracks.

    Errors of clock and orbits are subtracted; rows of a track are averaged over two minutes, longer
    if there would be too many points.

    Parameters
    ----------
    fit : TrackFit

    Returns
    -------
    PointingRun
        Star names are those of the satellites.
    """
    tracks = fit.tracks
    run, time = tracks.run, np.asarray(tracks.run['time'], float)
    used = fit.weights > 0.0
    seconds = max(_SECONDS, float(np.count_nonzero(~tracks.is_star) and _length(tracks) / _MOST))
    cell = np.where(tracks.is_star, np.arange(len(time)), np.floor(time / seconds))
    # separate sides of the pier
    _, which = np.unique(np.stack((tracks.arc, cell, is_beyond(run['el']))), axis=1,
                         return_inverse=True)
    which = which.reshape(-1)
    weight = np.bincount(which, used)
    good = weight > 0.0
    mean = lambda v: np.bincount(which, v * used)[good] / weight[good]  # noqa: E731
    # position of the row nearest to the mean time, with the mean residual
    middle = np.bincount(which, time * used) / np.maximum(weight, 1.0)
    nearest = np.lexsort((np.abs(time - middle[which]), ~used, which))
    first = nearest[np.searchsorted(which[nearest], np.arange(len(weight)))][good]
    x, y = (mean(one) for one in np.array(run.offsets()) - fit.columns.orbits(fit.values))
    columns = {name: run[name][first] for name in ('time', 'az', 'el', 'star', 'az_rate',
                                                   'el_rate')}
    for name in ('temperature', 'pressure'):
        if name in run and np.isfinite(run[name][first].astype(float)).any():
            columns[name] = run[name][first]
    columns['az_enc'] = columns['az'] + x / np.cos(columns['el'])
    columns['el_enc'] = columns['el'] + y
    columns['star'] = np.where(columns['star'] == STARS, 'star', columns['star'])
    order = np.argsort(columns['time'], kind='stable')
    return PointingRun({name: value[order] for name, value in columns.items()},
                       {**run.meta, 'source': 'tracks', 'notes': [], 'excluded': []})


def _length(tracks):
    """Total length of all arcs of satellites, s."""
    time = np.asarray(tracks.run['time'], float)
    return sum(float(np.ptp(time[tracks.arc == arc]))
               for arc in np.unique(tracks.arc[~tracks.is_star]))
