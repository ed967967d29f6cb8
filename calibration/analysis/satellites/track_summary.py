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

"""Result of a fit of tracks as a document: terms, clock, each satellite and each arc."""

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.rms import rms_arcsec

from ..finding import Finding
from .track_columns import CLOCK, power_ons
from .track_fit import HIDDEN

#: smallest reported time of a satellite along its orbit, s
_LATE = 1e-4
#: ratio of residual RMS to the white noise of the rows that correlated noise cannot explain
_DISAGREE = 5.0
#: fewest rows to test stamps and signs; tolerance of the slope 2 of residuals on a miss distance;
#: smallest significance of the slope, sigmas
_FEWEST, _NEAR_TWO, _CERTAIN = 10, 0.3, 8.0
#: stamps that scatter: smallest ratio of scatter along the track to that across; smallest scatter
#: of rounded ones, s (0.29 s expected)
_SCATTERED, _ROUNDED = 2.0, 0.2


def track_document(fit):
    """The document, JSON-ready except for its findings.

    Parameters
    ----------
    fit : TrackFit

    Returns
    -------
    dict
    """
    tracks = fit.tracks
    white, process, memory = fit.noise_of_rows()
    out = {
        'rows': len(tracks), 'rows_set_aside': int(np.count_nonzero(fit.weights == 0.0)),
        'mount': tracks.run.mount.kind,
        'terms': [{'name': name, 'value_arcsec': value / ARCSEC, 'sigma_arcsec': float(sigma)}
                  for (name, value), sigma in zip(fit.model.terms.items(),
                                                  fit.model.sigmas / ARCSEC)],
        'determined': fit.determines, 'sky_sigma_arcsec': fit.sky_sigma() / ARCSEC,
        'noise': {'memory_s': float(memory), **{
            name or 'stars': {'white_arcsec': float(a / ARCSEC), 'memory_arcsec': float(b / ARCSEC)}
            for name, a, b in zip(tracks.objects, white, process)}},
        'before': _rms(fit.before, fit.weights), 'after': _rms(fit.after, fit.weights),
        'satellites': [_satellite(fit, name) for name in tracks.satellites],
        'arcs': [_arc(fit, arc) for arc in np.unique(tracks.arc)],
        'left_out': list(fit.left_out), 'suspects': dict(fit.suspects)}
    if CLOCK in fit.columns.names:
        value, sigma = fit[CLOCK]
        out['clock'] = {'late_s': value, 'sigma_s': sigma, 'separated': fit.separated(CLOCK)}
    stamps = _scattered_stamps(fit)
    if any(one.kind == 'whole stamps' for one in stamps):
        out.pop('clock', None)  # rounding makes it wrong
    out['notes'] = [*fit.notes, *stamps, *_reversed_miss(fit), *_findings(fit, out)]
    return out


def _scattered_stamps(fit):
    """Finding if stamps scatter: rows do along the track, row to row, much more than across."""
    tracks = fit.tracks
    rows = ~tracks.is_star & (fit.weights > 0.0)
    time = np.asarray(tracks.run['time'], float)[rows]
    along, across = (one[rows] for one in tracks.along(*fit.after))
    if len(time) < _FEWEST or np.std(along) < _SCATTERED * np.std(across):
        return []
    # a wrong orbit drifts: its next row is off by as much
    step, aside = (np.diff(one)[np.diff(tracks.arc[rows]) == 0] for one in (along, across))
    if len(step) < _FEWEST or np.std(step) < _SCATTERED * np.std(aside):
        return []
    late = float(np.std(along / np.hypot(*tracks.ahead[:, rows])))
    whole = late > _ROUNDED and np.all(time == np.round(time))
    return [Finding('whole stamps' if whole else 'stamps scatter', late, unit='s')]


def _reversed_miss(fit):
    """Finding if columns of the camera have the wrong sign: the residuals are twice the columns."""
    run = fit.tracks.run
    names = [name for name in ('miss_x', 'miss_y') if name in run]
    left, wrong = fit.after.copy(), []
    for name, axis in zip(names, (0, 1)):
        miss = np.nan_to_num(np.asarray(run[name], float))
        rows = (fit.weights > 0.0) & (miss != 0.0)
        if np.count_nonzero(rows) < _FEWEST:
            continue
        x, y = (one[rows] - np.mean(one[rows]) for one in (miss, fit.after[axis]))
        slope = float(x @ y / max(x @ x, 1e-30))
        sigma = float(np.std(y - slope * x) / np.sqrt(max(x @ x, 1e-30)))
        if abs(slope - 2.0) < _NEAR_TWO and slope > _CERTAIN * sigma:
            wrong.append(name)
            left[axis] = left[axis] - 2.0 * miss
    if not wrong:
        return []
    left = left - np.mean(left[:, fit.weights > 0.0], axis=1)[:, None]
    return [Finding('miss reversed', causes=tuple(wrong),
                    before=_rms(fit.after, fit.weights)['radial_arcsec'],
                    after=_rms(left, fit.weights)['radial_arcsec'])]


def _findings(fit, document):
    out, sky = [], document['sky_sigma_arcsec']
    white = fit.noise_of_rows()[0][fit.tracks.object[fit.weights > 0.0]] / ARCSEC
    noise, left = float(np.sqrt(2.0 * np.mean(white**2))), document['after']['radial_arcsec']
    if left > _DISAGREE * noise:
        out.append(Finding('tracks disagree', left, evidence={'noise': noise}))
    if document['rows_set_aside']:
        first = int(np.flatnonzero(fit.weights == 0.0)[0])
        out.append(Finding('outliers of tracks', document['rows_set_aside'], unit='rows', causes=(
            fit.tracks.objects[fit.tracks.object[first]] or 'stars',), evidence={
                'of': document['rows'], 'first': float(fit.tracks.run['time'][first])}))
    *earlier, newest = power_ons(fit.tracks.run) or [None]
    for number in earlier:
        zeros = {name.split('[')[0]: tuple(v / ARCSEC for v in fit[name])
                 for name in fit.columns.names if name.endswith(f'[{number:g}]')}
        out.append(Finding('zero of a power-on', evidence={
            'run': number, 'newest': newest, 'zeros': zeros}))
    if not document['determined']:
        out.append(Finding('tracks determine no terms', sky))
    clock = document.get('clock')
    if clock and fit.own_part(CLOCK) < HIDDEN:
        out.append(Finding('clock not separated', clock['late_s'], clock['sigma_s'], 's'))
    elif clock and abs(clock['late_s']) > 3.0 * clock['sigma_s']:
        out.append(Finding('clock late', clock['late_s'], clock['sigma_s'], 's'))
    for one in document['satellites']:
        if abs(one['ahead_s']) < _LATE and one['ahead_sigma_s'] < _LATE:
            continue
        if not one['separated']:
            out.append(Finding('time along the orbit not separated', one['ahead_s'],
                               one['ahead_sigma_s'], 's', (one['name'],)))
        elif abs(one['ahead_s']) > 3.0 * one['ahead_sigma_s']:
            out.append(Finding('satellite ahead', one['ahead_s'], one['ahead_sigma_s'], 's',
                               (one['name'],)))
    return out


def _rms(left, weights):
    x, y, radial, _ = rms_arcsec(*left[:, weights > 0.0])
    return {'x_arcsec': x, 'y_arcsec': y, 'radial_arcsec': radial}


def _satellite(fit, name):
    tracks = fit.tracks
    rows = tracks.object == tracks.objects.index(name)
    value, sigma = fit[f'ahead {name}']
    return {'name': name, 'rows': int(rows.sum()), 'arcs': len(np.unique(tracks.arc[rows])),
            'orbit_sigma_m': float(np.mean(tracks.orbit_sigma[rows])), 'ahead_s': value,
            'ahead_sigma_s': sigma, 'separated': fit.separated(f'ahead {name}')}


def _arc(fit, arc):
    """Mean and scatter of one arc, before and after, by axes, and along and across the track."""
    tracks = fit.tracks
    rows = np.flatnonzero((tracks.arc == arc) & (fit.weights > 0.0))
    everywhere = np.flatnonzero(tracks.arc == arc)
    time, run = np.asarray(tracks.run['time'], float), tracks.run
    out = {'object': tracks.objects[tracks.object[everywhere[0]]] or 'stars',
           'begin': float(time[everywhere].min()), 'end': float(time[everywhere].max()),
           'rows': len(everywhere),
           'el_min_deg': float(_elevation(run, everywhere).min() / DEG),
           'el_max_deg': float(_elevation(run, everywhere).max() / DEG)}
    for when, left in (('before', fit.before), ('after', fit.after)):
        axes = {'x': left[0], 'y': left[1]}
        if not tracks.is_star[everywhere[0]]:
            axes['along'], axes['across'] = tracks.along(*left)
        out[when] = {f'{axis}_{what}_arcsec': float(of(value[rows]) / ARCSEC) if len(rows) else
                     float('nan') for axis, value in axes.items()
                     for what, of in (('mean', np.mean), ('std', np.std))}
    return out


def _elevation(run, rows):
    return run.mount.horizon_of(run['az'][rows], run['el'][rows])[1]
