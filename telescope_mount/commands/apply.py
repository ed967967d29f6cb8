"""The command ``apply``: directions to encoder angles by a model, and back."""

import csv
import sys
from pathlib import Path

from msg_tools.output import beside

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'apply', help='turn directions into encoder angles by a model, or back',
        description='Read a table with the columns az_deg, el_deg (with --reverse az_enc_deg, '
        'el_enc_deg) and write it with the angles of the other side in two further columns. '
        'Further columns by the names of a run (time, temperature_c, approach_az, ...) drive the '
        'effects that need them.')
    parser.add_argument('model', type=options.model_path, metavar='MODEL',
                        help='a model file of ours (.json, '
                        '.yaml), or of a program that `export --to` writes')
    parser.add_argument('file', nargs='?', default='-', metavar='FILE',
                        help='CSV with a header row; - (default): from the standard input')
    parser.add_argument('--reverse', action='store_true', help='encoder angles to directions')
    parser.add_argument('--out', type=Path, metavar='FILE', help='write here; else to the '
                        'standard output')
    options.add_overwrite(parser)
    parser.set_defaults(written=('out',))
    parser.add_argument('--time', metavar='UTC', help='of all rows, ISO 8601; goes before a '
                        'column time')
    parser.add_argument('--set', action='append', default=[], metavar='COLUMN=VALUE', dest='given',
                        help='a driver of all rows, as temperature_c=4.5')
    parser.add_argument('--zero', default='newest', metavar='WHICH', help='of the zeros that the '
                        'model carries from its night: newest (default; rows with a column run '
                        'take that of their run), none, or the number of a run')
    options.add(parser, 'latitude', 'longitude')
    options.add(parser, 'mount', help='that a model of another program is of: equatorial, german '
                '(with --latitude), free:AZ,EL[,ROLL]; its columns are then ha_deg, dec_deg ...')


def run(args):
    """Read, turn, write, say what was not known."""
    from pointing_model.apply import NEWEST, NO_ZEROS
    from pointing_model.model_files import read_model
    from pointing_model.mounts import ALTAZ

    from .console import new_console, print_lines, step_aside
    options.check_target(args.out)
    if args.zero not in (NEWEST, NO_ZEROS):
        try:
            args.zero = float(args.zero)
        except ValueError:
            raise ValueError(f'--zero {args.zero}: write newest, none or the number of a '
                             'run') from None
    loaded = read_model(args.model, options.mount_of(args) or ALTAZ)
    header, rows, delimiter, notes = _apply(loaded.model, args)
    if args.out:
        with beside(args.out) as part, open(
                part, 'w', newline='', encoding='utf-8') as stream:
            _write(stream, header, rows, delimiter)
    else:
        step_aside(for_good=True)
        _write(sys.stdout, header, rows, delimiter)
    # the table may be on the standard output
    print_lines(new_console(stderr=True), 'note', [*loaded.notes, *notes])


def _apply(model, args):
    """Header, rows and delimiter of the table to write, and remarks."""
    import numpy as np

    from msg_tools.units import DEG
    from pointing_model.apply import turned, zeros_of_rows
    from pointing_model.context import Context
    from pointing_model.run import column_name
    name, header, rows, lines, delimiter = _table(args.file)
    cells = dict(zip(header, zip(*rows) if rows else [()] * len(header)))
    places, readings = ([column_name(f'{axis}{part}', model.mount.names) for axis in ('az', 'el')]
                        for part in ('', '_enc'))
    pair = readings if args.reverse else places
    columns, notes = _drivers(name, lines, cells, pair, places, args)
    az, el = (_angles(name, lines, column, cells) for column in pair)
    _check(name, lines, pair, az, el, args.reverse or not model.mount.altaz)
    if model.mount.altaz and not args.reverse and (el > 90.0).any():
        notes.append('past the zenith, tube over the back, in row'
                     f'{"s" * int((el > 90.0).sum() > 1)} {_listed(np.asarray(lines)[el > 90.0])}: '
                     'at azimuth - 180, 180 - elevation')
    place = [None if v is None else v * DEG for v in (args.latitude, args.longitude)]
    context = Context(az * DEG, el * DEG, columns, *place, mount=model.mount)
    zero, applied = zeros_of_rows(model, args.zero, columns.get('run'))
    out = np.stack(turned(model, context, zero, args.reverse)) / DEG
    notes += [*_said_of_zeros(model, applied, columns.get('run'), args.zero), *_unknown(
        model, context, out, args.reverse)]
    bad = ~np.isfinite(out).all(axis=0)
    if bad.any():
        notes.append(f'the mount cannot look there, nearer to its zenith than its axes allow: '
                     f'cells left empty in row{"s" * int(bad.sum() > 1)} '
                     + _listed(np.asarray(lines)[bad]))
    # the first axis, of what is catalogue place and of the reading alike
    up = np.mod(az, 360.0) > 180.0 if model.mount.kind == 'german' else np.zeros(len(az), bool)
    if up.any():
        notes.append(f'the counterweight is up in row{"s" * int(up.sum() > 1)} '
                     f'{_listed(np.asarray(lines)[up])}: with it down the mount looks there '
                     'through the pole, at hour angle + 180, 180 - declination')
    names = places if args.reverse else readings
    if set(names) & set(header):
        names = tuple(f'{n.removesuffix("_deg")}_model_deg' for n in names)
        notes.append(f'the file has angles of that side already: those of the model are in '
                     f'{", ".join(names)}')
    texts = [['' if v != v else repr(v) for v in column] for column in out.tolist()]
    return [*header, *names], [[*row, *pair] for row, pair in zip(rows, zip(*texts))], \
        delimiter, notes


def _table(file):
    """Name for messages, header, rows, line of each, delimiter."""
    name = 'standard input' if file == '-' else file
    if file == '-':
        if sys.stdin.isatty():
            print('directions are read from the terminal; end with Ctrl-D', file=sys.stderr)
        text = sys.stdin.read()
    else:
        text = Path(file).read_text(encoding='utf-8-sig', errors='replace')
    body = [(number, line) for number, line in enumerate(text.splitlines(), 1)
            if line.strip() and not line.lstrip().startswith('#')]
    if not body:
        raise ValueError(f'{name} is empty; it needs a header row, as az_deg,el_deg')
    top = body[0][1]
    delimiter = next((d for d in ',;\t' if d in top), ',')
    header, *rows = ([cell.strip() for cell in row] for row in csv.reader(
        (line for _, line in body), delimiter=delimiter))
    twice = [h for h in header if h and header.count(h) > 1]
    if twice:
        raise ValueError(f'{name}: column {twice[0]!r} is there twice')
    lines = [number for number, _ in body[1:]]
    for number, row in zip(lines, rows):
        if len(row) != len(header):
            raise ValueError(f'{name}, row {number}: {len(row)} cells, but the header has '
                             f'{len(header)}')
    return name, header, rows, lines, delimiter


def _angles(name, lines, column, cells):
    """A column of angles; ValueError where it is missing or a cell is no number."""
    import numpy as np

    from pointing_model.run_files.table import floats
    if column not in cells:
        there = ', '.join(c[:40] for c in list(cells)[:40])
        raise ValueError(f'{name}: no column {column}; the file has {there}')
    values = floats(name, lines, column, cells[column])
    bad = ~np.isfinite(values)
    if bad.any():
        i = int(np.argmax(bad))
        raise ValueError(f'{name}, row {lines[i]}, column {column}: '
                         f'{cells[column][i] or "empty"!r} is no angle')
    return values


def _check(name, lines, pair, az, el, beyond):
    """Refuse what is no direction in degrees."""
    import numpy as np
    # a tube past the zenith or through the pole
    bad = (el < (-180.0 if beyond else -90.0)) | (el > 180.0)
    if bad.any():
        i = int(np.argmax(bad))
        raise ValueError(f'{name}, row {lines[i]}, column {pair[1]}: {el[i]:g} is no such '
                         'angle in degrees')
    if len(el) >= 3 and np.abs(el).max() <= 1.6 and np.abs(az).max() <= 6.3 and np.ptp(el) > 0.05:
        raise ValueError(f'{name}: {pair[0]}, {pair[1]} never exceed '
                         f'{max(np.abs(az).max(), np.abs(el).max()):.3g}: they look like radians; '
                         'give degrees')


def _drivers(name, lines, cells, pair, places, args):
    """What the effects may follow, in SI by the names in memory; remarks."""
    import numpy as np

    from pointing_model.run import COLUMNS
    from pointing_model.run_files.csv import CSV_NAMES
    from pointing_model.run_files.table import bad_cell, floats, is_number, own_name, parse_iso
    given = {}
    for text in args.given:
        key, equals, value = text.partition('=')
        if not equals or not key.strip():
            raise ValueError(f'--set {text}: write COLUMN=VALUE, as temperature_c=4.5')
        given[key.strip()] = value.strip()
    if args.time is not None:
        given['time'] = args.time
    cells = {**cells, **{key: [value] * len(lines) for key, value in given.items()}}
    out, notes = {}, []
    for column, values in cells.items():
        if column in pair or column in places or not column:
            continue
        known = CSV_NAMES.get(column)
        where = 'the options' if column in given else name
        if column == 'time' and values and not any(map(is_number, filter(None, values))):
            out['time'] = parse_iso(where, lines, column, values)
        elif known == 'star' and not all(map(is_number, values)):
            continue
        elif known in COLUMNS:
            numbers = floats(where, lines, column, values)
            if np.isinf(numbers).any():
                raise bad_cell(where, lines, column, values, int(np.argmax(np.isinf(numbers))),
                               'is not finite')
            out[known] = numbers * COLUMNS[known][1]
        elif values and all(not v or is_number(v) for v in values):
            out[own_name(column, cells, notes)] = floats(where, lines, column, values)
        elif column in given:
            raise ValueError(f'--set {column}={given[column]}: is not a number')
    if 'star' in out:
        out['star'] = np.nan_to_num(out['star']).astype(np.int64)
    return out, notes


def _said_of_zeros(model, applied, run, wanted):
    """What was done with the zeros that the model carries."""
    from msg_tools.units import ARCSEC
    from pointing_model.following import KEY
    from pointing_model.zero import zeros_in_force
    if not zeros_in_force(model):
        return []
    if not applied:
        return [f'the {len(zeros_in_force(model))} zeros that the model carries are not applied '
                '(--zero none)']
    said = ', '.join(f'run {z.run:g}: azimuth {z.az / ARCSEC:+.2f}, elevation '
                     f'{z.el / ARCSEC:+.2f} arcsec' for z in applied[:6])
    more = f', ... ({len(applied)} runs)' if len(applied) > 6 else ''
    notes = [f'zero applied, {said}{more}']
    if KEY in model.provenance:
        notes.append('the zero of this model follows the absolute encoder; here it stands where it '
                     'was set')
    return notes


def _unknown(model, context, out, reverse):
    """Which effects count as zero, and why."""
    import numpy as np

    from msg_tools.units import DEG
    from pointing_model.context import UNKNOWN
    from pointing_model.effects.base import readable
    if not model.effects:
        return []
    if reverse:
        context = context.at(*np.nan_to_num(out * DEG), az_raw=context.az, el_raw=context.el)
    notes = []
    needs = {e.effect.name: e.effect.requires for e in model.effects}
    for effect, rows in model.unknown(context.az, context.el, context).items():
        count = int(np.count_nonzero(rows))
        where = 'all rows' if count == len(rows) else f'{count} of {len(rows)} rows'
        reasons = dict.fromkeys(UNKNOWN.get(name, f'{name} is not known') for name in needs[effect])
        notes.append(f'{readable(effect)} counts as zero in {where}: {"; ".join(reasons)}')
    return notes


def _listed(lines, limit=20):
    texts = [str(n) for n in lines[:limit]]
    return ', '.join(texts) + (f', ... ({len(lines)} rows)' if len(lines) > limit else '')


def _write(stream, header, rows, delimiter):
    writer = csv.writer(stream, delimiter=delimiter, lineterminator='\n')
    writer.writerow(header)
    writer.writerows(rows)
