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

"""Display of a graph's state in a terminal: numbers, a sky chart, the last stars.

Numbers are never cut, whatever the width: what does not fit continues on the next line.
"""

import math
import textwrap
from itertools import zip_longest
from typing import NamedTuple

from rich.text import Text

from msg_tools.terminal_signs import spelled

#: least columns for the sky beside the numbers; columns of the sky; its lines
BESIDE, SKY_WIDE, SKY_HIGH = 76, 31, 15
#: columns for a name, and for a number
_NAME, _NUMBER = 12, 13
#: most stars in a row of bars; most alarms, and lines of each, in a full window
BARS, ALARMS, ALARM_LINES = 30, 5, 3
_BARS, _PLAIN_BARS = '▁▂▃▄▅▆▇█', '_.-:=+*#'
_BAD = 'bold red'


class _Screen(NamedTuple):
    """Size of a terminal in columns, and its encoding."""

    width: int
    encoding: str

    def lines(self, text, style='', indent='  '):
        """Wrap a text to lines of this width, each with its style."""
        # texts from other nodes may contain anything: escapes, line ends
        text = ''.join(sign if sign.isprintable() else ' ' for sign in text)
        text = ' '.join(self.spelled(text).split())
        return [(line, style) for line in textwrap.wrap(
            text, max(self.width, 1), subsequent_indent=indent,
            break_on_hyphens=False) or ['']]

    def spelled(self, text):
        """A text in characters that the terminal can show."""
        return spelled(text, self.encoding)


class Dashboard:
    """A renderable of `rich`.

    Parameters
    ----------
    state : WatchState
    note : str
        Shown at the end of the first line, which is visible even in a low window.
    whole : bool
        Show all alarms completely; else only as many as leave room for the rest.
    """

    def __init__(self, state, note='', whole=True):
        self._state, self._note, self._whole = state, note, whole

    def __rich_console__(self, console, options):
        state, whole = self._state, _Screen(options.max_width, console.encoding)
        wide = whole.width >= BESIDE
        beside = whole._replace(width=whole.width - SKY_WIDE - 2) if wide else whole
        numbers = [*_axes(state, beside), *_stars(state, beside)]
        sky = _sky(state, whole._replace(width=min(SKY_WIDE, whole.width)))
        lines = [*_head(state, whole, self._note), *_alarms(state, whole, self._whole)]
        yield _text([[line] for line in lines])
        if wide:
            yield _text([(chart.ljust(SKY_WIDE + 2), style), number] for (chart, style), number in
                        zip_longest(sky, numbers, fillvalue=('', '')))
        else:
            yield _text([[line] for line in (*numbers, *sky)])


def _text(lines):
    """Lines of styled parts as one `Text` that is not wrapped."""
    rows = [Text.assemble(*line) for line in lines]
    for row in rows:
        row.rstrip()
    return Text('\n', no_wrap=True, overflow='ignore').join(rows)


def _head(state, screen, note):
    when = (state.time_utc or 'no time yet').replace('T', ' ')
    lines = screen.lines(f'{state.source} at {when}' + (note and f'; {note}'), 'bold')
    plan = state.plan
    if plan:
        of = f' {plan["done"]} of {plan["total"]}' if plan['total'] else ''
        step = f': {plan["step"]}{of}' if plan['step'] and plan['state'] != 'done' else ''
        refused = f', {plan["refused"]} refused' if plan['refused'] else ''
        lines += screen.lines(f'plan {plan["state"]}{step}; {plan["observations"]} stars observed, '
                            f'{plan["lost"]} lost{refused}, power-on {plan["run"]}')
    if 'guard' in state.messages:
        doing = f'{state.guard}: ' if state.guard else ''
        lines += screen.lines(f'guard {doing}{state.messages["guard"]}')
    if 'calibration' in state.messages:
        lines += screen.lines(f'calibration {state.messages["calibration"]}')
    return lines


def _alarms(state, screen, every):
    if not state.alarms:
        nodes = len(state.nodes)
        return screen.lines(f'no alarms, {nodes} nodes report' if nodes else 'no node reports')
    lines = []
    for alarm in state.alarms[:None if every else ALARMS]:
        warns = alarm['level'] == 'warning'
        style = 'yellow' if warns else _BAD
        texts = screen.lines(f'{"warning" if warns else "ALARM"} {alarm["said"]}', style)
        lines += texts if every or len(texts) <= ALARM_LINES else [
            *texts[:ALARM_LINES], ('  and so on: watch --once', style)]
    more = 0 if every else len(state.alarms) - ALARMS
    return lines + ([(f'and {more} more', _BAD)] if more > 0 else [])


def _pair(name, values, screen, form, style=''):
    """A name and two numbers, in columns if they fit."""
    if values is None:
        return []
    texts = [screen.spelled(form(value)) for value in values]
    line = f'{name:<{_NAME}}' + ''.join(f'{one:>{_NUMBER}}' for one in texts)
    if len(name) < _NAME and max(map(len, texts)) < _NUMBER and len(line) <= screen.width:
        return [(line, style)]
    return screen.lines(f'{name} {"  ".join(texts)}', style)


def _number(form, unit):
    return lambda value: 'not known' if value is None or not math.isfinite(value) else (
        f'{value:{form}}{unit}')


_DEGREES, _SECONDS, _PLAIN = _number('.4f', '°'), _number('+.2f', '″'), _number('.2f', '″')


def _axes(state, screen):
    stars, rate = state.stars, state.rate_deg_s
    lines = _pair('', [name.replace('_', ' ') for name in state.joints], screen, str, 'bold')
    for name, values, form in (
            ('reading', state.reading_deg, _DEGREES),
            ('asked for', state.wanted_deg, _DEGREES),
            ('rate, per s', rate and [3600.0 * value for value in rate], _SECONDS),
            ('zero', state.zero_arcsec, _SECONDS),
            ('  sigma', state.zero_sigma_arcsec, _PLAIN),
            ('inc - abs', state.encoders_arcsec, _SECONDS),
            ('miss', state.miss_arcsec, _SECONDS)):
        lines += _pair(name, values, screen, form)
    if stars['time_s']:
        offset = stars['offset_x_arcsec'][-1], stars['offset_y_arcsec'][-1]
        left = stars['left_x_arcsec'][-1], stars['left_y_arcsec'][-1]
        lines += _pair('last offset', offset, screen, _SECONDS)
        lines += _pair('  left', left if state.left_by else None, screen, _SECONDS)
    return lines


def _stars(state, screen):
    """Rows of bars: what is left of the last stars, and the encoders' difference."""
    stars = state.stars
    left = _finite(math.hypot(x, y) for x, y in zip(stars['left_x_arcsec'], stars['left_y_arcsec']))
    lines = []
    if left:
        rms = math.sqrt(sum(value * value for value in left) / len(left))
        of = 'the last star' if len(left) == 1 else f'the last {len(left)} stars'
        lines += _bars(f'{state.left_by} leave {rms:.2f}″ RMS of {of}' if ' and ' in state.left_by
                       else f'the zero leaves {rms:.2f}″ RMS of {of}', left, 0.0, screen)
    for name, values in zip(state.joints, (stars['encoders_first_arcsec'],
                                           stars['encoders_second_arcsec'])):
        # the difference changes at a power-on
        values = _finite(value for value, power_on in zip(values, stars['power_on'])
                         if power_on == stars['power_on'][-1])
        if values:
            low, most = min(values), max(values)
            lines += _bars(f'inc - abs, {name.replace("_", " ")}: {low:.2f} to {most:.2f}″', values,
                           low, screen)
    return lines


def _finite(values):
    return [value for value in values if math.isfinite(value)][-BARS:]


def _bars(title, values, low, screen):
    """A title and a bar for each value, from `low` up to the largest."""
    signs = _BARS if screen.spelled(_BARS) == _BARS else _PLAIN_BARS
    span = max(values) - low or 1.0
    bars = ''.join(signs[round((value - low) / span * (len(signs) - 1))] for value in values)
    return [*screen.lines(title), (bars[-screen.width:], 'cyan')]


def _sky(state, screen):
    """A sky chart: the zenith in the middle, the horizon dotted, east on the right."""
    width = screen.width
    high = min(SKY_HIGH, max(5, width // 2))
    middle, up = (width - 1) / 2.0, (high - 1) / 2.0
    rows = [[' '] * width for _ in range(high)]

    def put(az, el, sign):
        if not math.isfinite(az + el):
            return
        away = min(max((90.0 - el) / 90.0, 0.0), 1.0)
        x, y = away * math.sin(math.radians(az)), away * math.cos(math.radians(az))
        rows[round(up - y * up)][round(middle + x * middle)] = sign

    for az in range(0, 360, 5):
        put(az, 0.0, '.')
    star = screen.spelled('•')
    for az, el in zip(state.stars['az_deg'], state.stars['el_deg']):
        put(az, el, star)
    for az, name in zip(range(0, 360, 90), 'NESW'):
        put(az, 0.0, name)
    legend = [f'{star} star'] if state.stars['time_s'] else []
    for place, sign, name in ((state.sent_to_deg, 'O', 'sent to'),
                              (state.looks_at_deg, '+', 'looks at')):
        if place:
            put(*place, sign)
            legend.append(f'{sign} {name} {place[0]:.1f}° {place[1]:.1f}°')
    return [*((''.join(row), '') for row in rows),
            *(line for part in legend for line in screen.lines(part))]
