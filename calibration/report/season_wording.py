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

"""Words for a season: causes of changes in the terms from night to night."""

from datetime import datetime, timezone

from calibration.analysis.season.season_nights import NO_DATE
from pointing_model.pointing_terms import term_cause, terms_of


def _moved(found):
    moved = ', '.join(f'{term} by {v[0]:+.1f} ± {s[0]:.1f}″' for term, v, s in found['terms'])
    return f'{moved}, between {" and ".join(found["between"])}'


def _year(found):
    term, v, _ = found['terms'][0]
    month = datetime.fromtimestamp(found['peak'], timezone.utc).strftime('%B')
    size = (v[0]**2 + v[1]**2)**0.5
    return f'{term} vs time of year: ± {size:.1f}″, highest in {month}'


def _slope(found):
    term, v, s = found['terms'][0]
    return f'{v[0]:+.2f} ± {s[0]:.2f}″', term


def _trend(found):
    slope, term = _slope(found)
    return f'{term} vs time: {slope}/yr'


def _column(found):
    slope, term = _slope(found)
    return f'{term} vs {found["cause"]}: {slope} per unit'


def _left_out(found):
    advice = ': name the file YYYY-MM-DD, or give UTC in the column time'
    return f'{found["night"]}: left out, {found["why"]}{advice * (found["why"] == NO_DATE)}'


def cause_rows(findings, mount):
    """Table rows: term, change, driver, likely cause, check; steps first, by size.

    Parameters
    ----------
    findings : sequence of Finding
    mount : pointing_model.mounts.Mount

    Returns
    -------
    list of tuple of str
    """
    rows, known = [], terms_of(mount)
    for found in findings:
        kind = found.kind.removeprefix('season ')
        for term, v, s in found['terms']:
            step = kind in ('step', 'declared')
            if step:
                change = f'{v[0]:+.1f} ± {s[0]:.1f}″'
                with_ = f'between {" and ".join(found["between"])}'
            elif kind == 'year':
                size = (v[0]**2 + v[1]**2)**0.5
                change, with_ = f'± {size:.1f}″', 'time of year'
            else:
                change, with_ = f'{v[0]:+.2f} ± {s[0]:.2f}″', {
                    'trend': 'per year'}.get(kind) or f'per unit of {found["cause"]}'
            part, check = term_cause(term, mount) if term in known else (term, '')
            cause = f'{part}: ' + (str(found['cause']) if kind == 'declared' else
                            'work on the mount, or a part slipped' if kind == 'step' else
                            'age, wear or ground' if kind == 'trend' else
                            'temperature or ground' if kind == 'year' else str(found['cause']))
            rows.append((not step, -abs(v[0]), (
                term, change.replace('-', '−'), with_, cause,
                'what was done to the mount then' + f'; {check}' * bool(check) if kind == 'step'
                else check)))
    return [row for *_, row in sorted(rows, key=lambda one: one[:2])]


KINDS = {
    'night left out': _left_out,
    'odd night': lambda found: (
        f'{found["date"]} ({found["source"]}) is left out: its {found["term"]} is '
        f'{found.size:+.0f}\u2033 from the nights around it, {found["times"]:.0f} times their '
        'scatter. Check what was wrong then'),
    'step outside the season': lambda found: f'{found["step"]}: no night before or after it',
    'cause unknown tonight': lambda found: (
        f'{", ".join(found.causes)} of the coming night is unknown: the season mean is used '
        '(--tonight COLUMN=VALUE)'),
    'cause far outside': lambda found: (
        f'{found["what"]} of {found.size:g} is far outside what was measured '
        f'({found["low"]:.3g} to {found["high"]:.3g}): the prediction extrapolates. Check value '
        'and unit'),
    'season declared': lambda found: f'{found["cause"]}: {_moved(found)}',
    'season step': lambda found: f'{_moved(found)}: what was done to the mount then?',
    'season year': _year,
    'season trend': _trend,
    'season column': _column,
}
