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

"""Whether a night of `close-the-loop` found the simulated error, and the improvement."""

import numpy as np

#: verdicts without a named cause
_UNCLAIMED = ('unknown', 'none', 'wanders', 'undecided')
#: verdicts of a claim that failed the hold-out comparison
_REFUSED = ('withheld', 'taken_back')


def outcome(shows_as, effects, verdict='', harmful=False, follows=()):
    """Whether the diagnosis found the effects of the scenario.

    Parameters
    ----------
    shows_as : list of str or None
        Beginnings of names of effects.
    effects : list of dict
        Effects of the diagnosis, with ``name``, ``alternatives`` and ``aliases``.
    verdict : str
        Verdict of the diagnosis.
    harmful : bool
        See `points_worse`.
    follows : sequence of str
        Names of the axes whose zero tracks the absolute encoder.

    Returns
    -------
    found : str or None
        'yes': every effect was found by name or alias, and nothing else; 'followed': the same,
        but an effect of the zero is removed by tracking the absolute encoder; 'in the set':
        every one is among the reported alternatives; 'in part'; 'no'. For a scenario without
        effects: 'rightly none'; 'unknown', something without a name; 'wrong', a cause was
        claimed; 'withheld', 'taken back', a claim failed the comparison. 'harmful' takes
        precedence. None: unknown.
    false : list of str
        Reported effects that are not in the scenario.
    """
    if shows_as is None:
        return None, []

    def among(wanted, names):
        return any(name.startswith(wanted) for name in names)

    first = [[e['name'], *e['aliases']] for e in effects]
    sets = [[*names, *e['alternatives']] for names, e in zip(first, effects)]
    false = [e['name'] for e, names in zip(effects, sets)
             if not any(among(wanted, names) for wanted in shows_as)]
    if harmful:
        return 'harmful', false
    if not shows_as:
        if verdict in _REFUSED:
            return verdict.replace('_', ' '), false
        if not effects:
            return 'rightly none', false
        return ('unknown' if verdict in _UNCLAIMED else 'wrong'), false
    named = [any(among(wanted, names) for names in first) for wanted in shows_as]
    followed = [any(wanted.startswith(f'{axis}_zero') for axis in follows) for wanted in shows_as]
    there = [any(among(wanted, names) for names in sets) or at_zero
             for wanted, at_zero in zip(shows_as, followed)]
    if all(named):
        return 'yes', false
    if all(one or at_zero for one, at_zero in zip(named, followed)):
        return 'followed', false
    if all(there):
        return 'in the set', false
    return ('in part' if any(there) else 'no'), false


def points_worse(before, after, comparison=None):
    """Whether blind stars after a change are missed significantly more than before.

    Parameters
    ----------
    before, after : dict or None
        See `telescope_mount.observing.night_memory.blind_summary`; different stars in each.
    comparison : dict, optional
        Both models on the stars of `after`, with ``radial`` if there were enough. If both got
        worse, the night is the cause, not the change.

    Returns
    -------
    bool
        Whether the logarithm of the ratio exceeds 2 sigma: an RMS over n stars, 2 n values, has
        sigma^2 = 1 / (4 n), so 2 % of harmless changes exceed it. On the same stars the change
        must also increase the RMS by at least 5 %.
    """
    if not (before and after and before['stars'] and after['stars']):
        return False
    same = (comparison or {}).get('radial')
    if same and same['after_arcsec'] < 1.05 * same['before_arcsec']:
        return False
    sigma = np.sqrt(0.25 / before['stars'] + 0.25 / after['stars'])
    return bool(after['rms_arcsec'] > before['rms_arcsec'] * np.exp(2.0 * sigma))


def paired(report):
    """The error with the old and the new model on the same data.

    Parameters
    ----------
    report : dict
        Report of `close_the_loop`.

    Returns
    -------
    dict
        ``of`` names the data: 'fresh stars', both models on the stars after the change; without
        these 'rows kept out', 'cross-validated rows' or 'rows fitted'. ``rows``: their number,
        None if unknown. ``before`` and ``after``: ``rms_arcsec`` (radial), ``rms_x_arcsec``,
        ``rms_y_arcsec``; None for an unknown axis.
    """
    comparison, blind = report['judged'] or {}, report['blind_after'] or {}
    if comparison.get('radial'):
        return {'of': 'fresh stars', 'rows': comparison['rows'], **{
            when: {f'rms_{part}arcsec': comparison[axis][f'{when}_arcsec']
                   for part, axis in (('', 'radial'), ('x_', 'az'), ('y_', 'el'))}
            for when in ('before', 'after')}}
    if blind.get('stars') and not report['published']:  # the model stayed as it was
        same = {key: blind[key] for key in ('rms_arcsec', 'rms_x_arcsec', 'rms_y_arcsec')}
        return {'of': 'fresh stars', 'rows': blind['stars'], 'before': same, 'after': same}
    for key, label, rows in (('holdout_rms_arcsec', 'rows kept out', report['kept_out']),
                             ('cv_rms_arcsec', 'cross-validated rows', report['rows_used'])):
        values = [report[when][key] for when in ('before', 'after')]
        if None not in values:
            return {'of': label, 'rows': rows, **{
                when: {'rms_arcsec': value, 'rms_x_arcsec': None, 'rms_y_arcsec': None}
                for when, value in zip(('before', 'after'), values)}}
    return {'of': 'rows fitted', 'rows': report['rows_used'], **{
        when: {key: report[when][key] for key in ('rms_arcsec', 'rms_x_arcsec', 'rms_y_arcsec')}
        for when in ('before', 'after')}}
