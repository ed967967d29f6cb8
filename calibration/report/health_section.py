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

"""Section on the state of encoders and other instruments; shown if all is well, too."""

import numpy as np

from msg_tools.units import ARCSEC, wrap

from . import page_parts as page
from .drawing import Panel, limit_of, padded, svg
from .number_wording import number

#: nodes whose diagnostic values are all shown
_INSTRUMENTS = ('encoder', 'frame_reader', 'camera', 'inclinometer', 'mount')
AXES = ('azimuth', 'elevation')


def health_section(health, run=None, axes=AXES):
    """Section on the instruments.

    Parameters
    ----------
    health : dict or None
        Result of `log_health.log_health`.
    run : PointingRun, optional
        All rows of the night, to compare the two encoders.
    axes : tuple of str
        Names of the axes of the mount.

    Returns
    -------
    Markup
    """
    health = health or {'streams': [], 'marks': [], 'sigmas_arcsec': {}, 'nodes': [],
                        'problems': [], 'whole': True}
    return page.folded_section(
        'Encoders and instruments', [
            page.sentence_list(_sentences(health)), _agreement(run, axes),
            _streams(health['streams']), _marks(health['marks']),
            _decoding(health), _nodes(health['nodes']), page.sentence_list(health['problems'])],
        ' '.join([
            'From the log of the night.' if health['whole'] else 'The log is large: rates are '
            'from its index, single messages were not read.',
            *['Simulated clock: it jumps while the mount rests, which looks like a '
              'gap.'] * bool(health.get('simulated_clock'))]) if health['streams'] else '')


def _sentences(health):
    """Summary sentences."""
    streams = [row for row in health['streams'] if row['lost'] is not None]
    lost = sum(row['lost'] for row in streams)
    out = []
    if streams:
        out.append('No message of an instrument was lost.' if not lost else
                   f'{lost} messages of instruments were lost: ' + ', '.join(
                       f'{row["what"]} {row["lost"]}' for row in streams if row['lost']) + '.')
    marks = [row for row in health['marks'] if row['homed']]
    if marks:
        worst = [row['worst_error_counts'] for row in marks
                 if row['worst_error_counts'] is not None]
        out.append(f'{sum(row["passages"] for row in marks)} passages of reference marks'
                   + (f', the counter off by {max(worst):g} counts at most' if worst else '')
                   + f'; {sum(row["missed"] for row in marks)} index pulses missed (too short).')
    rejected = _counted(health['nodes'], 'rejected')
    if rejected is not None:
        corrected = _counted(health['nodes'], 'corrected') or 0
        exact = _counted(health['nodes'], 'exact') or 0
        out.append(f'Absolute encoder: {exact} readings decoded at once, {corrected} corrected, '
                   f'{rejected} rejected.')
    bad = [node for node in health['nodes'] if node['level'] != 'ok']
    out += [f'{node["name"]} ended with {node["level"]}: {node["message"]}.' for node in bad]
    if health['nodes'] and not bad:
        out.append(f'All {len(health["nodes"])} nodes ended without a warning.')
    return out


def _counted(nodes, word):
    """Sum of the counters of this name over the absolute encoder's nodes; None if there is none."""
    values = [int(value) for node in nodes if 'absolute' in node['name']
              or 'frame_reader' in node['name'] for key, value in node['values'].items()
              if key.endswith(f' {word}') and value.isdigit()]
    return sum(values) if values else None


def _agreement(run, axes):
    """Figures: incremental - absolute encoder in each row, minus the median of its power-on."""
    if run is None or 'az_abs' not in run or not len(run):
        return None
    x = (run['time'] - np.nanmin(run['time'])) / 3600.0 if 'time' in run \
        else np.arange(float(len(run)))
    numbers = run['run'] if 'run' in run else np.zeros(len(run))
    out = []
    for key, axis in zip(('az', 'el'), axes):
        difference = wrap(run[f'{key}_enc'] - run[f'{key}_abs']) / ARCSEC
        for one in np.unique(numbers):
            own = (numbers == one) & np.isfinite(difference)
            if own.any():
                difference[own] -= np.median(difference[own])
        good = np.isfinite(difference)
        if not good.any():
            continue
        limit = limit_of(difference[good])
        panel = Panel((56, 24, 372, 130), padded(x[good], 0.02, 1e-3), (-limit, limit))
        panel.axes('hours since the first row' if 'time' in run else 'row', 'arcsec', axis)
        panel.points(x[good], difference[good], 'third')
        spread = 1.4826 * float(np.median(np.abs(difference[good])))
        what = f'{axis}: incremental − absolute encoder at {int(good.sum())} exposures, about ' \
               f'the middle of each power-on; scatter {number(spread)} arcsec'
        out.append(page.figure(svg(440, 202, panel.parts, what), f'{what[0].upper()}{what[1:]}.'))
    return page.subsection('Incremental against absolute encoder', out and page.figure_pair(out))


def _streams(rows):
    return page.subsection('Rates and gaps', page.table(
        ('stream', 'messages', 'mean rate Hz', 'usual interval s', 'longest gap s', 'lost'),
        [(row['what'], row['count'], page.number(row['rate_hz'], 3),
          page.number(row['interval_s'], 3), page.number(row['longest_s'], 1), row['lost'])
         for row in rows], 'numbers', 'Messages of the instruments'))


def _marks(rows):
    return page.subsection('Reference marks', page.table(
        ('power-on', 'axis', 'homed', 'met from', 'passages', 'missed', 'worst error, counts',
         'supply V', 'temperature °C'),
        [(row['power_on'], row['axis'], 'yes' if row['homed'] else 'no', row['side'] or None,
          row['passages'], row['missed'], None if row['worst_error_counts'] is None
          else f'{row["worst_error_counts"]:g}', page.number(row['supply'], 3),
          page.number(row['temperature'], 1)) for row in rows], 'numbers', 'Reference marks'))


def _decoding(health):
    return page.subsection('Quality of the absolute readings', page.table(
        ('axis', 'readings looked at', 'σ, middle ″', 'σ of 95 % below ″', 'largest σ ″',
         'without σ'),
        [(axis, row['count'], *(page.number(row.get(key), 3) for key in (
            'middle', 'beyond_95', 'largest')), row['none'])
         for axis, row in health['sigmas_arcsec'].items()],
        'numbers', 'Errors of the readings, by the absolute encoder'))


def _nodes(nodes):
    return page.folded('Last status of each node', page.table(
        ('node', 'at the end', 'worst', 'message', 'counters'),
        [(node['name'], node['level'], node['worst'], node['message'],
          page.sentence_list([f'{key} {value}' for key, value in node['values'].items()])
          if any(word in node['name'].rsplit('/', 1)[-1] for word in _INSTRUMENTS) else '')
         for node in nodes], 'nodes', 'Last status of each node'))
