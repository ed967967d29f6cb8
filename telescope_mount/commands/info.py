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

"""The command ``info``: contents of a log, and whether it is complete."""

from pathlib import Path

from . import options

#: messages have a wrong time if they are farther than this from all others, ns, and at most this
#: fraction of all
PAUSE, FEW = 86_400 * 10**9, 0.01


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'info', help='what is in a log, and whether it is whole',
        description='Print topics, counts, rates, losses, time span, size and integrity of a log '
        'of ours or of rosbag2. Exit code 1 where it is damaged.')
    parser.add_argument('log', type=options.log_path, metavar='BAG')
    parser.add_argument('--quick', action='store_true',
                        help='print the index, without reading the messages')
    parser.add_argument('--report', type=Path, metavar='FILE', help='write the page of the night '
                        'that it is the log of (.html)')
    options.add_verbose(parser, 'topics, with types')
    options.add_json(parser, 'it')


def run(args):
    """Read and print."""
    from .console import files_of, new_console, print_all, write_outputs
    info = log_info(args.log, quick=args.quick)
    console = new_console()
    print_all(console, info_parts(info, args.verbose, files_of(args)))
    page = None
    if args.report:
        from calibration.report.night_page import page_of_log
        page = page_of_log(args.log)
    write_outputs(console, args, info, page=page)
    return int(bool(info['problems']) or not info['complete'])


def log_info(path, *, quick=False):
    """Topics, counts, rates, gaps, size and integrity of a log.

    Parameters
    ----------
    path : str or Path
        A bag of ours or of rosbag2: a folder, ``.mcap`` or ``.db3``.
    quick : bool
        Use only the index; messages are not read, and gaps and damage are not searched.

    Returns
    -------
    dict
        JSON-ready. ``topics`` has rows with ``count``, ``rate_hz`` (None below two
        messages), ``lost`` (None if the log has no sequence numbers, or if `quick`),
        ``publishers``; ``start``, ``end`` ISO 8601 UTC or None; ``problems`` is empty if the log
        is complete.

    Raises
    ------
    ValueError, OSError
        It is not a log, or not readable.
    """
    from msg_tools.bag import OWN_RECORD
    from msg_tools.bag.losses import utc
    from msg_tools.bag.sqlite import open_bag
    bag = open_bag(path)
    seen, gaps, odd = ({}, None, []) if quick else _read_through(bag)
    span = 0.0 if bag.start_time is None else (bag.end_time - bag.start_time) * 1e-9
    topics = []
    for topic in sorted(bag.topics):
        key = topic.name, topic.type
        first, last, count = seen.get(key, (bag.start_time, bag.end_time, topic.count))
        lost, publishers = gaps.counts(key) if gaps else (None, None)
        between = (last - first) * 1e-9 if count > 1 else 0.0
        topics.append({
            'name': topic.name, 'type': topic.type, 'count': count if seen else topic.count,
            'rate_hz': (count - 1) / between if between > 0.0 else None,
            'lost': lost, 'publishers': publishers, 'latched': topic.latched})
    return {
        'path': str(path), 'files': [file.name for file in bag.files],
        'size_bytes': sum(Path(file).stat().st_size for file in bag.files),
        'start': utc(bag.start_time), 'end': utc(bag.end_time), 'duration_s': span,
        'messages': sum(row['count'] for row in topics), 'topics': topics,
        'complete': bag.complete, 'read_through': not quick, 'checksums': bag.checksums,
        'truth': bag.has_truth,
        'written_with': dict(bag.metadata.get(OWN_RECORD, {})),
        'nodes': sorted(name.split(' ', 1)[1] for name in bag.metadata
                        if name.startswith('parameters ')),
        'attachments': [{'name': a.name, 'bytes': a.size} for a in bag.attachments],
        'problems': bag.problems + odd}


def _read_through(bag):
    """(first, last log time, count) by topic and type; `LogGaps`; and problems, sentences."""
    from msg_tools.bag.file import attachment_data
    from msg_tools.bag.losses import counted, span
    from msg_tools.gaps import LogGaps
    gaps = LogGaps({(t.name, t.type): t.latched for t in bag.topics})
    seen, odd, parts, before = {}, [], [], None  # parts: times and numbers between long pauses
    twice, same = 0, set()  # same: messages of one time
    for message in bag.messages():
        key, now = (message.topic, message.type), message.log_time
        row = seen.get(key)
        if row is None:
            row = seen[key] = [now, 0, 0]
        row[1] = now
        row[2] += 1
        gaps.add(key, message.sequence)
        if now != before:
            same.clear()
        one = hash((key, message.publish_time, message.sequence, message.data))
        twice += message.sequence > 0 and one in same
        same.add(one)
        if before is None or now - before > PAUSE:
            parts.append([now, now, 0, set()])
        before = parts[-1][1] = now
        parts[-1][2] += 1
        parts[-1][3].add(message.topic)
    if twice:
        odd.append(f'{counted(twice, True)} occur twice, as if a file was copied')
    total = sum(part[2] for part in parts)
    for first, last, count, topics in parts:
        if count <= FEW * total:
            odd.append(f'{counted(count, True)} {span(first, last)}, the other {total - count} '
                       f'on other days; topics: {", ".join(sorted(topics)[:5])}')
    for attachment in bag.attachments:
        try:
            attachment_data(attachment)
        except ValueError as error:
            odd.append(str(error))
    return seen, gaps, odd


def info_parts(info, verbose=True, files=0):
    """Result of `log_info` as lines and tables for the console.

    Parameters
    ----------
    info : dict
    verbose : bool
        Include all topics and their types, not only those with most messages.
    files : int
        Number of lines printed after it.
    """
    from calibration.report.terminal_layout import LINES, MORE, height_of, layered
    from calibration.report.terminal_tables import new_table
    *lines, problems = info_lines(info)
    if verbose:
        return [*lines, *problems, _topics(info)]
    some = layered(problems[:3], problems[3:], files=LINES - 8)
    room = LINES - files - sum(map(height_of, [*lines, *some])) - 4
    rows = sorted(info['topics'], key=lambda row: -row['count'])
    shown = rows[:max(3, room)]
    short = new_table('', f'{info["messages"]} messages', 'number', 'rate [Hz]', 'lost')
    for row in shown:
        short.add_row(row['name'], str(row['count']), _figure(row['rate_hz'], '.4g'),
                      _figure(row['lost'], ''))
    left = len(rows) - len(shown)
    return [*lines, *some, short, *([MORE.format(f'types, and {left} topics')] if left else [])]


def _figure(value, form):
    return '' if value is None else format(value, form)


def _topics(info):
    from calibration.report.terminal_tables import new_table
    table = new_table(f'{info["path"]}: {info["messages"]} messages', 'topic', 'type', 'messages',
                      'rate [Hz]', 'publishers', 'lost')
    table.columns[1].justify = 'left'
    for row in info['topics']:
        table.add_row(
            row['name'], row['type'], str(row['count']), _figure(row['rate_hz'], '.4g'),
            _figure(row['publishers'], ''), _figure(row['lost'], ''))
    return table


def info_lines(info):
    """Files, time, programs and integrity of a log, list of str; the last entry lists problems."""
    return [
        f'files              {", ".join(info["files"])} ({info["size_bytes"] / 1e6:.2f} MB)',
        f'time               {info["start"]} to {info["end"]} ({info["duration_s"]:.1f} s)',
        *(f'{key:<18} {value}' for key, value in info['written_with'].items()),
        *([f'attachments        {", ".join(a["name"] for a in info["attachments"])}']
          if info['attachments'] else []),
        'integrity          ' + (
            'damaged or not closed, see below' if not info['complete'] else
            'complete, but with problems, see below' if info['problems'] else
            'closed properly' if not info['read_through'] else
            'whole, every checksum is right' if info['checksums'] else
            'whole, without checksums'),
        [f'problem: {problem}' for problem in info['problems']]]
