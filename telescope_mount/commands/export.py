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

"""The command ``export``: logs, runs and models as files that other programs read."""

import math
import re
from collections import Counter
from importlib import resources
from itertools import islice
from pathlib import Path
from pkgutil import iter_modules

from msg_tools.whole_files import beside

from . import options

#: choices of ``--to``: programs by their file names, as they are slow to import, a table, and our
#: own document
PROGRAMS = (*sorted(module.name for module in iter_modules([str(
    resources.files('pointing_model.runs') / 'programs')])), 'table', 'model')
#: largest array whose elements become columns; for larger ones only the length is written
MAX_COLUMNS = 64
_BATCH = 5000
_CLOUD = 'sensor_msgs/msg/PointCloud2'


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'export', help='write the observations of a log, or any topic, as CSV or Parquet; a '
        'model for another program',
        description='Write a pointing run (a log of ours, or any file that fit reads) as a CSV '
        'that fit reads again. With --topics: the messages of a log, a table a topic. With --to: '
        'a model as another program reads it.')
    parser.add_argument('file', type=options.log_path, metavar='RUN', help='with --to a model')
    parser.add_argument('out', type=Path, metavar='OUT',
                        help='file, .csv or .parquet; with --topics a folder')
    parser.add_argument('--to', choices=PROGRAMS, metavar='PROGRAM',
                        help='the program that shall read the model: '
                        + ', '.join(PROGRAMS))
    parser.add_argument('--sky', type=options.log_path, metavar='RUN',
                        help='refit what the program cannot '
                        'represent over the directions of this run (default: a uniform sky '
                        'above 20 degrees)')
    parser.add_argument('--zero', type=options.zero, metavar='WHICH',
                        help='zero of the model to add to its index terms: newest, or the '
                        'number of a run (default: none)')
    parser.add_argument('--side', choices=('east', 'west'), help='side of the pier, for --to indi '
                        'of a German mount: INDI stores none (west: through the pole)')
    options.add_json(parser, 'what was written (with --to: what is held and lost)')
    parser.add_argument('--topics', type=options.names, metavar='NAMES',
                        help='comma-separated topics of a log, by full name or its end')
    parser.add_argument('--format', choices=('csv', 'parquet'), default='csv',
                        help='of the tables of --topics (default: csv)')
    parser.add_argument('--start', metavar='TIME',
                        help='seconds since the first row or message, or UTC in ISO 8601')
    parser.add_argument('--end', metavar='TIME', help='likewise; the end is left out')
    options.add(parser, *options.OF_RUNS)


def run(args):
    """Read, write, report what was left out."""
    from .console import new_console, print_all, print_lines, write_outputs
    console = new_console()
    if args.to:
        _run_model(args, console)
        return
    options.refuse(args, 'applies to models: name the program with --to',
                   sky=None, zero=None, side=None)
    if args.topics:
        files, problems = export_topics(args.file, args.out, args.topics, form=args.format,
                                        start=args.start, end=args.end,
                                        overwrite=args.overwrite)
        print_lines(console, 'note', problems)
        for path, rows in files.items():
            console.print(f'{rows} rows: {path}', soft_wrap=True)
        write_outputs(console, args, {'files': files, 'problems': problems})
        return
    options.refuse(args, 'applies to the tables of --topics; leave it out', format='csv')
    options.check_target(args.out, ('.csv', '.parquet') if args.out.suffix else ())
    _check_out(args)
    written = export_run(args.file, args.out, start=args.start, end=args.end,
                         **options.place_of(args))
    from calibration.analysis.diagnosis.row_counts import row_word
    from calibration.report.row_wording import left_out_lines
    print_all(console, left_out_lines(written.meta['excluded'], word=row_word(written)))
    print_lines(console, 'note', written.meta['notes'])
    console.print(f'{len(written)} observations: {args.out}', soft_wrap=True)
    write_outputs(console, args, {'observations': len(written), 'file': args.out, **{
        key: written.meta[key] for key in ('excluded', 'notes')}})


def _run_model(args, console):
    """Write a model for another program, and report what it contains."""
    from .. import model_export
    from .console import write_json
    options.refuse(args, 'applies to runs; leave it out with --to',
                   topics=None, start=None, end=None)
    options.check_target(args.out)
    _check_out(args)
    if args.sky is None:
        options.refuse(args, 'applies to the run of --sky; leave it out', equinox='auto')
    place = options.place_of(args) | {'mount': options.mount_of(args)}
    place['site'] = _whole_site(place.get('site'), args)
    written = model_export.export_model(args.file, args.out, args.to, sky=args.sky,
                                        zero=args.zero or 'none', side=args.side, **place)
    model_export.show(written, console)
    if args.json:
        write_json(args.json, written.to_dict())


def _whole_site(site, args):
    """Site for a model, as files have none: complete, or the latitude of an equatorial mount."""
    if site is None:
        return None
    if {'latitude', 'longitude'} <= set(site):
        from pointing_model.sky.site import Site
        return Site(**{'height': 0.0, **site})
    if args.mount is None or set(site) != {'latitude'}:
        raise ValueError('give --latitude and --longitude (for an equatorial mount --mount '
                         'and --latitude are enough)')
    return site


def _check_out(args):
    if args.out.exists() and args.file.exists() and args.out.samefile(args.file):
        raise ValueError(f'{args.out} is the input itself; name another output file')
    options.refuse_existing(args.out, args)


def export_run(source, path, *, start=None, end=None, **options):
    """Write a log, or a run in another format, as CSV or Parquet.

    Parameters
    ----------
    source : str or Path
        See `telescope_mount.input_files.run_loader.load_run`.
    path : str or Path
        Output file, ``.parquet`` or CSV; from CSV `load_run` reads the same run, and a fit gives
        the same terms to 1e-9 arcsec.
    start, end : str, optional
        Only rows in [start, end), see `time_of`.
    **options
        See `load_run`.

    Returns
    -------
    PointingRun
        The written run; its ``meta`` lists what was left out.

    Raises
    ------
    ValueError
        `source` is not a run, no row is in the range, or Parquet is unavailable.
    OSError
        It cannot be read, or `path` cannot be written.
    """
    import numpy as np

    from pointing_model.runs.formats.csv import write_csv

    from ..input_files.run_loader import load_run
    source, path = Path(source), Path(path)
    if path.suffix == '.parquet':
        _parquet()
    run = load_run(source, **options)
    if start is not None or end is not None:
        if 'time' not in run:
            raise ValueError(f'{source} has no column time: leave out --start and --end')
        low, high = _span(start, end, round(float(np.nanmin(run['time'])) * 1e9))
        ns = run['time'] * 1e9
        chosen = run.select((ns >= low) & (ns < high))
        if len(chosen) == 0:
            raise ValueError(f'{source} has no observation {_between(start, end)}')
        run = chosen
    if path.suffix == '.parquet':
        _write_parquet(run, path)
    else:
        write_csv(run, path)
    return run


def export_topics(source, out, topics, *, form='csv', start=None, end=None, overwrite=False):
    """Write the messages of topics as tables: one row per message, one column per number.

    For a PointCloud2, such as `observation`, each point is a row, with its fields as columns.

    Parameters
    ----------
    source : str or Path
        A bag of ours or of rosbag2.
    out : str or Path
        Folder, created if needed, for one file per topic.
    topics : list of str
        Full names, or their ends, as ``offset``.
    form : {'csv', 'parquet'}
    start, end : str, optional
        Only messages with log times in [start, end), see `time_of`.
    overwrite : bool
        Overwrite existing files.

    Returns
    -------
    files : dict of Path to int
        Number of rows in each file.
    problems : list of str
        What was left out.

    Raises
    ------
    ValueError
        A topic is not in the log, no message is in the range, a file already exists, or Parquet
        is unavailable.
    OSError
        The log cannot be read, or a file cannot be written.

    Notes
    -----
    ``log_time_ns`` and ``publish_time_ns`` come first. Columns are named as in the message, for
    instance ``header.stamp.sec`` or ``position[0]``; for an array of more than `MAX_COLUMNS`
    elements only the length is written.
    """
    if form == 'parquet':
        _parquet()
    from msg_tools.bag.sqlite import open_bag
    bag = open_bag(source)
    names = [_full_name(bag, source, topic) for topic in topics]
    low, high = _span(start, end, bag.start_time or 0)
    if (start, end) != (None, None) and next(bag.messages(names, low, high), None) is None:
        raise ValueError(f'{source} has no message of {", ".join(topics)} '
                         f'{_between(start, end)}')
    out, clouds = Path(out), Counter()
    out.mkdir(parents=True, exist_ok=True)
    files, problems = {}, []
    for name in dict.fromkeys(names):
        path = out / f'{re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_")}.{form}'
        if path.exists() and not overwrite:
            raise ValueError(f'{path} is there already; choose another folder, or give '
                             '--overwrite')

        def rows(name=name):
            clouds.clear()
            return (row for m in bag.messages(name, low, high, decode=True)
                    for row in (_points(m, clouds) if m.type == _CLOUD else [_flat(m)]))
        columns = _columns(rows())
        with beside(path) as part:
            files[path] = _write_table(part, form, columns, rows())
        problems += [f'{name}: {count} messages left out: {why}' for why, count in clouds.items()]
    return files, bag.problems + problems


def time_of(text, begin):
    """Nanoseconds since 1970 of a time given by the user.

    Parameters
    ----------
    text : str
        Seconds since the beginning, as ``12.5``, or UTC in ISO 8601.
    begin : int
        The beginning, ns since 1970.

    Raises
    ------
    ValueError
        Neither of these.
    """
    from msg_tools.iso_time import WANTED, iso_ns
    try:
        seconds = float(text)
        if math.isfinite(seconds):
            return begin + round(seconds * 1e9)
    except ValueError:
        pass
    try:
        return iso_ns(text)
    except ValueError:
        raise ValueError(f'time {text!r}: write seconds since the beginning, or UTC as '
                         f'{WANTED}') from None


def _span(start, end, begin):
    low = 0 if start is None else max(0, time_of(start, begin))
    high = 2**63 - 1 if end is None else time_of(end, begin)
    if high <= low:
        raise ValueError(f'the end {end} is not after the start {start or "of the log"}')
    return low, high


def _between(start, end):
    return f'from {start or "its start"} to {end or "its end"}'


def _full_name(bag, source, topic):
    there = [t.name for t in bag.topics]
    found = [n for n in there if n == topic] or [n for n in there if n.endswith('/' + topic)]
    if len(set(found)) != 1:
        what = 'matches several topics' if found else 'is no topic'
        raise ValueError(f'{topic} {what} of {source}; it has {", ".join(sorted(set(there)))}')
    return found[0]


def _times(message):
    return {'log_time_ns': message.log_time, 'publish_time_ns': message.publish_time}


def _flat(message):
    """Names and values of all numbers and texts of a message."""
    row = _times(message)
    _take(row, '', message.data)
    return row


def _take(row, name, value):
    """Add a value to a row under its name, or its parts under theirs."""
    if isinstance(value, bool | int | float | str):
        row[name] = value
    elif isinstance(value, bytes | bytearray | memoryview) or (
            hasattr(value, '__len__') and len(value) > MAX_COLUMNS):
        row[f'{name}.length'] = len(value)
    elif hasattr(value, '__len__'):
        for number, part in enumerate(value):
            _take(row, f'{name}[{number}]', part)
    else:
        for part in getattr(value, '__slots__', ()):
            _take(row, f'{name}.{part}' if name else part, getattr(value, part))


def _points(message, wrong):
    """A row for each point of a cloud, with the stamp; `wrong` counts invalid clouds."""
    from msg_tools.bag.mcap_records import short
    from msg_tools.cloud_tables import cloud_points
    cloud = message.data
    try:
        points = cloud_points(cloud)
    except ValueError as error:
        wrong[short(error)] += 1
        return
    about = _times(message)
    _take(about, 'header', cloud.header)
    for point in points:
        row = dict(about)
        for name, value in zip(points.dtype.names, point.tolist()):
            _take(row, name, value)
        yield row


def _columns(rows):
    """Column name to type, over all rows, in the order of appearance."""
    columns = {}
    for row in rows:
        for name, value in row.items():
            kind = type(value)
            known = columns.setdefault(name, kind)
            if known is not kind:
                columns[name] = float if {known, kind} <= {int, float} else str
    return columns


def _write_table(part, form, columns, rows):
    """Write rows, dicts; return their number."""
    from pointing_model.runs.columns.cells import write_rows
    count = 0
    if form == 'csv':
        with open(part, 'w', newline='', encoding='utf-8') as stream:
            write_rows(stream, [columns])
            for row in rows:
                write_rows(stream, [[row.get(name, '') for name in columns]])
                count += 1
        return count
    pyarrow, parquet = _parquet()
    kinds = {int: pyarrow.int64(), float: pyarrow.float64(), bool: pyarrow.bool_()}
    schema = pyarrow.schema([
        (name, kinds.get(kind, pyarrow.string())) for name, kind in columns.items()])
    with parquet.ParquetWriter(part, schema) as writer:
        while batch := list(islice(rows, _BATCH)):
            count += len(batch)
            writer.write_table(pyarrow.table(
                {name: [_as(kind, row.get(name)) for row in batch]
                 for name, kind in columns.items()}, schema=schema))
    return count


def _as(kind, value):
    """`value` with the type of its column; None for numbers that do not fit."""
    if value is None or (kind is int and not -2**63 <= value < 2**63):
        return None
    return kind(value)


def _write_parquet(run, path):
    """Write a run with the columns of its CSV file; ``time`` is a time stamp if it is UTC."""
    import numpy as np

    from pointing_model.runs.formats.csv import written_columns
    pyarrow, parquet = _parquet()
    columns = {name: values for name, values, _ in written_columns(run)}
    if 'time' in columns and run.meta.get('time_is_utc', True):
        known = np.isfinite(columns['time'])
        columns['time'] = pyarrow.array(
            np.rint(np.where(known, columns['time'], 0.0) * 1e6).astype(np.int64),
            pyarrow.timestamp('us', 'UTC'), mask=~known)
    with beside(path) as part:
        parquet.write_table(pyarrow.table(columns), part)


def _parquet():
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise ValueError('Parquet needs the package pyarrow, which is not installed: '
                         'pip install pyarrow, or write CSV') from None
    return pyarrow, parquet
