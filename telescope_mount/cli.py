"""The command `telescope-mount`."""

import argparse
import os
import sys
from pathlib import Path

from .diagnose import add_arguments as add_diagnose_arguments
from .threads import ONE_THREAD

os.environ.update(ONE_THREAD | os.environ)  # before numpy comes


class _Parser(argparse.ArgumentParser):
    def error(self, message):
        # one line: what is wrong and where to read on
        print(f'error: {message} (see {self.prog} --help)', file=sys.stderr)
        raise SystemExit(2)


def _whole(low, high):
    def parse(text):
        try:
            value = int(text)
        except ValueError:
            value = None
        if value is None or not low <= value <= high:
            raise argparse.ArgumentTypeError(f'{text!r}: must be a whole number, {low} to {high}')
        return value
    return parse


def _real(low, high, unit):
    def parse(text):
        try:
            value = float(text)
        except ValueError:
            value = float('nan')
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f'{text!r}: must be {low:g} to {high:g} {unit}')
        return value
    return parse


def _parser():
    parser = _Parser(prog='telescope-mount',
                     description='Measure a telescope mount: observe, fit, check, log, replay.')
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')

    night = commands.add_parser(
        'night', help='observe a simulated night through the whole node graph',
        description='Start every node as a process, observe stars and Polaris, set the zero, fit '
        'the pointing model, log everything, and print the error before and after.')
    night.add_argument('--out', type=Path, default=Path('night'), metavar='DIR',
                       help='folder for log, model, observations and plot (default: night)')
    night.add_argument('--seed', type=_whole(0, 2**31 - 1), default=1,
                       help='of every random number (default: 1)')
    night.add_argument('--stars', type=_whole(4, 5000), default=30,
                       help='in each of the two blocks (default: 30)')
    night.add_argument('--polaris', type=_whole(2, 5000), default=16,
                       help='exposures of Polaris for a zero (default: 16)')
    night.add_argument('--scenario', default='default',
                       help='what is wrong with the simulated mount: a name or a YAML file')
    night.add_argument('--reference', type=Path, metavar='MODEL',
                       help='model.json of an earlier night: the zero is the change since then, '
                       'and tonight is one power-on: stars, Polaris, stars')
    night.add_argument('--date', default='', metavar='UTC',
                       help='begin of the night, ISO 8601 (default: 2026-01-15T13:00:00)')
    night.add_argument('--latitude', type=_real(-90.0, 90.0, 'degrees'), metavar='DEG')
    night.add_argument('--longitude', type=_real(-180.0, 360.0, 'degrees'), metavar='DEG')
    night.add_argument('--height', type=_real(-500.0, 9000.0, 'm'), metavar='M')
    night.add_argument('--params', type=Path, metavar='FILE',
                       help='ROS parameter file, read by every node after the values above')
    night.add_argument('--absolute', choices=('angles', 'frames'), default='angles',
                       help='what the simulated absolute encoder publishes: angles, or images '
                       'that the node frame_reader reads (default: angles)')
    night.add_argument('--time-scale', type=_real(0.0, 1000.0, ''), default=0.0, metavar='X',
                       help='simulated seconds a second; 0 (default): as fast as the graph answers')
    night.add_argument('--domain', type=_whole(0, 101), metavar='N',
                       help='ROS domain (default: a free one)')
    night.set_defaults(run=_night)

    experiment = commands.add_parser(
        'experiment', help='the eleven nights and the GPS satellite of paper 000',
        description='Observe thirteen nights through the node graph: a power-on each, 30 stars, '
        'Polaris, 30 stars; the model of two nights before corrects tonight, before and after the '
        'zero calibration. On one night a GPS satellite is tracked. Prints the paper\'s table 1 '
        'with ours beside it.')
    experiment.add_argument('--out', type=Path, default=Path('experiment'), metavar='DIR',
                            help='folder for tables, log and plots (default: experiment)')
    experiment.add_argument('--seed', type=_whole(0, 2**31 - 1), default=1,
                            help='of every random number (default: 1)')
    experiment.add_argument('--drifts', choices=('paper', 'random'), default='paper',
                            help='of the zero at each power-on: those that give the paper\'s '
                            'errors before calibration (default), or random ones of that scatter')
    experiment.add_argument('--stars', type=_whole(8, 500), default=30,
                            help='in each of the two blocks of a night (default: 30)')
    experiment.add_argument('--polaris', type=_whole(2, 500), default=16,
                            help='exposures of Polaris for a zero (default: 16)')
    experiment.add_argument('--satellite', type=_whole(2, 200), default=20,
                            help='exposures of the satellite before and after (default: 20)')
    experiment.add_argument('--domain', type=_whole(0, 101), metavar='N',
                            help='ROS domain (default: a free one)')
    experiment.set_defaults(run=_experiment)

    _add_close_the_loop(commands)

    fit = commands.add_parser(
        'fit', help='fit pointing terms to a measured run',
        description='Read a pointing run (CSV, TPOINT, or a log of ours) and print the terms and '
        'the error before and after.')
    fit.add_argument('file', type=Path, metavar='RUN')
    fit.add_argument('--terms', default='IA,IE,CA,NPAE,AN,AW,TF',
                     help='comma-separated (default: the seven physical terms)')
    fit.add_argument('--encoder', choices=('enc', 'abs'), default='enc',
                     help='which pair of encoder columns (default: enc)')
    fit.add_argument('--azimuth-origin', choices=('N', 'S'),
                     help='where azimuth 0 is in a TPOINT file')
    fit.add_argument('--run', dest='run_number', type=_whole(-10**6, 10**6), metavar='N',
                     help='of several runs in the file (column run) the one of this number')
    fit.add_argument('--no-robust', action='store_true', help='plain least squares')
    fit.add_argument('--save', type=Path, metavar='FILE', help='write the model (.json, .yaml)')
    fit.set_defaults(run=_fit)

    diagnose = commands.add_parser(
        'diagnose', help='find what a pointing model lacks, on logs and measured runs',
        description='Fit the declared model to pointing runs, look at what it leaves, name the '
        'physical effect that explains it, and prove the gain on data that neither the fit nor '
        'the choice has seen.')
    add_diagnose_arguments(diagnose)
    diagnose.set_defaults(run=_diagnose)

    export = commands.add_parser(
        'export', help='write the observations of a log, or any topic, as CSV or Parquet',
        description='Write a pointing run (a log of ours, or any file that fit reads) as a CSV '
        'that fit reads again; or with --topics the messages of a log, a table a topic.')
    export.add_argument('file', type=Path, metavar='RUN')
    export.add_argument('out', type=Path, metavar='OUT',
                        help='file, .csv or .parquet; with --topics a folder')
    export.add_argument('--topics', metavar='NAMES',
                        help='comma-separated topics of a log, by full name or its end')
    export.add_argument('--format', choices=('csv', 'parquet'), default='csv',
                        help='of the tables of --topics (default: csv)')
    export.add_argument('--start', metavar='TIME',
                        help='seconds since the first row or message, or UTC in ISO 8601')
    export.add_argument('--end', metavar='TIME', help='likewise; the end is left out')
    export.add_argument('--azimuth-origin', choices=('N', 'S'),
                        help='where azimuth 0 is in a TPOINT file')
    export.set_defaults(run=_export)

    _log_commands(commands)

    replay = commands.add_parser(
        'replay', help='replay a log into a fresh calibration',
        description='Publish a log again, calibrate on it, and print the same tables.')
    replay.add_argument('log', type=Path, metavar='BAG')
    replay.add_argument('--reference', type=Path, metavar='MODEL',
                        help='the reference model, if the night had one')
    replay.add_argument('--seed', type=_whole(0, 2**31 - 1), default=1,
                        help='of the choice of held-out stars; that of the night (default: 1)')
    replay.add_argument('--out', type=Path, metavar='FILE', help='write the model')
    replay.add_argument('--domain', type=_whole(0, 101), metavar='N',
                        help='ROS domain (default: a free one)')
    replay.set_defaults(run=_replay)

    test = commands.add_parser(
        'encoder-test', help='the 23-face test of the absolute encoder, beside the paper\'s',
        description='Turn the simulated disc of the absolute encoder to 23 standard angles, read '
        'it by the paper\'s method, its two rivals and ours, and compare with what was printed.')
    test.add_argument('--out', type=Path, default=Path('encoder_test'), metavar='DIR',
                      help='folder for the picture (default: encoder_test)')
    test.add_argument('--json', type=Path, metavar='FILE', help='write all figures')
    test.add_argument('--seed', type=_whole(0, 2**31 - 1), default=1,
                      help='of disc, table and noise (default: 1)')
    test.add_argument('--turns', type=_whole(2, 1000), default=20,
                      help='of 23 angles each (default: 20)')
    test.add_argument('--pitch', type=int, choices=(48, 60), default=48,
                      help='pixels a bar (default: 48)')
    test.set_defaults(run=_encoder_test)
    return parser


def _add_close_the_loop(commands):
    loop = commands.add_parser(
        'close-the-loop', help='find what the model lacks, add it, and prove the gain',
        description='Observe a simulated night with an effect that only the simulator knows (or '
        'take a measured run), fit, diagnose the residual, add what is found to the model, and '
        'point at fresh stars with it: the miss distance before and after.')
    what = loop.add_mutually_exclusive_group(required=True)
    what.add_argument('--scenario', help='what is wrong with the simulated mount: a name (loop_*), '
                      'a YAML file, or "all" for every loop_* of the package')
    what.add_argument('--run', dest='measured', type=Path, metavar='FILE',
                      help='a measured run instead: CSV, TPOINT, MMT, IRAM, or a log; judged on '
                      'rows that were kept out')
    loop.add_argument('--out', type=Path, default=Path('loop'), metavar='DIR',
                      help='folder for log, model, reports and page (default: loop)')
    loop.add_argument('--seed', type=_whole(0, 2**31 - 1), default=1,
                      help='of every random number (default: 1)')
    loop.add_argument('--stars', type=_whole(12, 5000), default=90,
                      help='that fit and diagnosis see (default: 90)')
    loop.add_argument('--polaris', type=_whole(2, 5000), default=16,
                      help='exposures of Polaris for the zero (default: 16)')
    loop.add_argument('--check', type=_whole(2, 5000), default=30,
                      help='fresh stars pointed at blind, before and after (default: 30)')
    loop.add_argument('--check-every', type=_whole(2, 1000), default=4, metavar='N',
                      help='of a measured run one row in N is kept out (default: 4)')
    loop.add_argument('--alpha', type=_real(1e-6, 0.5, ''), default=0.01,
                      help='chance that a clean night gets any effect (default: 0.01)')
    loop.add_argument('--date', default='', metavar='UTC',
                      help='begin of the night, ISO 8601 (default: 2026-01-15T13:00:00)')
    loop.add_argument('--latitude', type=_real(-90.0, 90.0, 'degrees'), metavar='DEG',
                      help='of the site; a measured run whose file does not tell it gets what '
                      'follows the stars only with both')
    loop.add_argument('--longitude', type=_real(-180.0, 360.0, 'degrees'), metavar='DEG')
    loop.add_argument('--azimuth-origin', choices=('N', 'S'),
                      help='where azimuth 0 is in a TPOINT file')
    loop.add_argument('--domain', type=_whole(0, 101), metavar='N',
                      help='ROS domain (default: a free one)')
    loop.set_defaults(run=_close_the_loop)


def _log_commands(commands):
    info = commands.add_parser(
        'info', help='what is in a log, and whether it is whole',
        description='Print topics, counts, rates, losses, time span, size and integrity of a log '
        'of ours or of rosbag2.')
    info.add_argument('log', type=Path, metavar='BAG')
    info.add_argument('--quick', action='store_true',
                      help='tell what the index says, without reading the messages')
    info.add_argument('--json', action='store_true', help='print it as JSON')
    info.set_defaults(run=_info)

    recover = commands.add_parser(
        'recover', help='make a whole log of what can be read of a damaged one',
        description='Write what can be read of a log into a new one, with index, statistics and '
        'metadata, and say what was lost. The damaged log is only read.')
    recover.add_argument('log', type=Path, metavar='BAG')
    recover.add_argument('--out', type=Path, metavar='DIR',
                         help='folder of the new log (default: BAG_recovered)')
    recover.set_defaults(run=_recover)

    verify = commands.add_parser(
        'verify', help='compute what a log derived once more, and compare',
        description='Compute observations, zeros, models, reports and diagnoses of a log again '
        'from what they were derived from, without a ROS graph. Exit code 1 if a number is not '
        'the same to the bit.')
    verify.add_argument('log', type=Path, metavar='BAG')
    verify.add_argument('--reference', type=Path, metavar='MODEL',
                        help='the reference model of the night (default: as the log says)')
    verify.add_argument('--seed', type=_whole(0, 2**31 - 1),
                        help='of the choice of held-out stars (default: as the log says, or 1)')
    verify.set_defaults(run=_verify)


def _console():
    from rich.console import Console
    # a pipe has no width of its own; tables must not be cut there
    return Console(width=None if sys.stdout.isatty() else 120, highlight=False)


class _Progress:
    """A line that tells how far the night is; on a pipe one line a step."""

    def __init__(self, console):
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
        self._bar = Progress(
            TextColumn('{task.description:<18}'), BarColumn(), MofNCompleteColumn(),
            TextColumn('exposures'), console=console, transient=True)
        self._console = console
        self._task = None
        self._text = None

    def __enter__(self):
        if self._console.is_terminal:
            self._bar.start()
            self._task = self._bar.add_task('starting the nodes', total=None)
        return self

    def __exit__(self, *exc):
        if self._task is not None:
            self._bar.stop()

    def __call__(self, text, done, total):
        if self._task is not None:
            self._bar.update(self._task, description=text, completed=done, total=total)
        elif text != self._text:
            self._console.print(f'{text}: {done} of {total} exposures done')
        self._text = text


def _night(args):
    from .night import NightOptions, run_night
    sky = {key: value for key, value in (
        ('latitude_deg', args.latitude), ('longitude_deg', args.longitude),
        ('height_m', args.height)) if value is not None}
    if args.params is not None and not args.params.is_file():
        raise ValueError(f'{args.params} is no file; give a ROS parameter file with --params')
    console = _console()
    options = NightOptions(
        out=args.out, seed=args.seed, stars=args.stars, polaris=args.polaris,
        scenario=args.scenario, start_time=args.date, reference=args.reference,
        domain=args.domain, time_scale=args.time_scale, params_file=args.params, sky=sky,
        absolute=args.absolute)
    with _Progress(console) as progress:
        report = run_night(options, progress)
    _print_report(console, report)
    console.print('\n'.join(f'{name:<13} {path}' for name, path in report['files'].items()))


def _experiment(args):
    from calibration.experiment_report import experiment_tables

    from .experiment import ExperimentOptions, run_experiment
    console = _console()
    options = ExperimentOptions(
        out=args.out, seed=args.seed, drifts=args.drifts, stars=args.stars, polaris=args.polaris,
        satellite=args.satellite, domain=args.domain)
    with _Progress(console) as progress:
        report = run_experiment(options, progress)
    for table in experiment_tables(report):
        console.print(table)
    for alarm in report['alarms']:
        console.print(f'alarm: {alarm}')
    console.print('\n'.join(f'{name:<17} {path}' for name, path in report['files'].items()))


def _close_the_loop(args):
    from .close_the_loop import LoopOptions, close_all, close_the_loop
    from .loop_report import all_table, loop_sentences, loop_tables
    options = LoopOptions(
        out=args.out, scenario=args.scenario or '', run=args.measured, seed=args.seed,
        stars=args.stars, polaris=args.polaris, check=args.check, check_every=args.check_every,
        alpha=args.alpha, start_time=args.date, azimuth_origin=args.azimuth_origin,
        sky={key: value for key, value in (
            ('latitude_deg', args.latitude), ('longitude_deg', args.longitude))
            if value is not None}, domain=args.domain)
    console = _console()
    with _Progress(console) as progress:
        report = (close_all if args.scenario == 'all' else close_the_loop)(options, progress)
    if 'scenarios' in report:
        console.print(all_table(report))
        console.print(f'report        {args.out / "report.json"}')
        return
    for table in loop_tables(report):
        console.print(table)
    for sentence in loop_sentences(report):
        console.print(f'note: {sentence}')
    console.print('\n'.join(f'{name:<13} {path}' for name, path in report['files'].items()))


def _print_report(console, report):
    from calibration.report import night_tables
    for table in night_tables(report):
        console.print(table)
    zeros = report['changes'] or report['zeros']
    for note in [*(zero['statement'] for zero in zeros[-1:]), *report['notes']]:
        console.print(f'note: {note}')
    for alarm in report['witnesses']['alarms']:
        console.print(f'alarm: {alarm}')


def _fit(args):
    from calibration.check import external_check
    from calibration.fit import fit_terms
    from calibration.report import fit_tables

    from .runs import load_run
    names = tuple(name.strip() for name in args.terms.split(',') if name.strip())
    run = load_run(args.file, azimuth_origin=args.azimuth_origin)
    run = _one_run(run, args)
    if f'az_{args.encoder}' not in run:
        raise ValueError(f'{args.file} has no second encoder; leave out --encoder {args.encoder}')
    result = fit_terms(run, names, robust=not args.no_robust, encoder=args.encoder,
                       provenance={'source': str(args.file)})
    console = _console()
    held_out = None
    if len(run) >= 4 * len(names):
        held_out = external_check(run, both_ways=True, names=names, encoder=args.encoder,
                                  robust=not args.no_robust).held_out
    for table in fit_tables(run, result, args.encoder, held_out):
        console.print(table)
    if args.save:
        result.model.save(args.save)
        console.print(f'model         {args.save}')


def _one_run(run, args):
    """The run asked for; of several that are fitted as one a note says so."""
    numbers = sorted(set(run['run'].tolist())) if 'run' in run else []
    if args.run_number is not None:
        rows = run.get('run') == args.run_number
        if not rows.any():
            there = ', '.join(f'{n:g}' for n in numbers) or 'no column run'
            raise ValueError(f'{args.file}: no run {args.run_number} (there: {there})')
        return run.select(rows)
    # in logs of ours the zeros of the power-ons are known, and taken off
    if len(numbers) > 1 and not (args.file.is_dir() or args.file.suffix == '.mcap'):
        run.meta['notes'] = [*run.meta.get('notes', ()), f'{len(numbers)} runs (column run) '
                             'fitted as one, with one zero: take one with --run N, or diagnose, '
                             'which fits zeros to each']
    return run


def _diagnose(args):
    from .diagnose import run
    run(args, _console())


def _export(args):
    from .export import export_run, export_topics
    console = _console()
    if args.topics:
        files, problems = export_topics(
            args.file, args.out, [t.strip() for t in args.topics.split(',') if t.strip()],
            form=args.format, start=args.start, end=args.end)
        for problem in problems:
            console.print(f'note: {problem}')
        for path, rows in files.items():
            console.print(f'{rows} messages: {path}')
        return
    run = export_run(args.file, args.out, azimuth_origin=args.azimuth_origin, start=args.start,
                     end=args.end)
    for row in run.meta['excluded']:
        console.print(f'row {row["row"]} left out: {row["reason"]}')
    for note in run.meta['notes']:
        console.print(f'note: {note}')
    console.print(f'{len(run)} observations: {args.out}')


def _info(args):
    from .info import info_tables, log_info
    info = log_info(args.log, quick=args.quick)
    if args.json:
        import json
        print(json.dumps(info, indent=1))
        return
    console = _console()
    for part in info_tables(info):
        console.print(part)


def _recover(args):
    from .recover import recover_log
    report = recover_log(args.log, args.out)
    console = _console()
    for line in report['lost']:
        console.print(f'lost: {line}')
    console.print(f'{report["messages"]} messages of {report["topics"]} topics saved, '
                  f'{report["lost_bytes"]} bytes lost: {report["out"]}')


def _verify(args):
    from .verify import verify_log
    report = verify_log(args.log, reference=args.reference, seed=args.seed)
    console = _console()
    for line in report['unchecked']:
        console.print(f'note: {line}')
    for line in report['differences']:
        console.print(f'difference: {line}')
    total = sum(report['checked'].values())
    console.print(', '.join(f'{count} {kind}' for kind, count in report['checked'].items()))
    console.print(f'{total - len(report["differences"])} of {total} are the same to the bit')
    return 1 if report['differences'] else 0


def _replay(args):
    from .replay import replay_log
    console = _console()
    report = replay_log(args.log, reference=args.reference, seed=args.seed, out=args.out,
                        domain_number=args.domain)
    _print_report(console, report)
    if report['diagnosis']:
        found = report['diagnosis']
        console.print(f'diagnosis     {found["verdict"]}: {", ".join(found["applied"]) or "–"}')


def _encoder_test(args):
    import json

    from .encoder_test import notes, plot, run, tables
    console = _console()
    args.out.mkdir(parents=True, exist_ok=True)
    with console.status('') as status:
        tell = status.update if console.is_terminal else console.print
        report = run(args.seed, args.turns, args.pitch, lambda text: tell(f'{text} ...'))
    for table in tables(report):
        console.print(table)
    for note in notes(report):
        console.print(f'note: {note}')
    picture = args.out / 'encoder_test.png'
    plot(report, picture)
    console.print(f'picture       {picture}')
    if args.json:
        args.json.write_text(json.dumps(report, indent=1) + '\n', encoding='utf-8')
        console.print(f'figures       {args.json}')


def main(argv=None):
    """Entry point; returns the exit code.

    0 done, 1 a check found a difference, 2 bad input, 130 ended by Ctrl-C.
    """
    args = _parser().parse_args(argv)
    try:
        return args.run(args) or 0
    except KeyboardInterrupt:
        print('ended by Ctrl-C; what was logged is closed and readable', file=sys.stderr)
        return 130
    except BrokenPipeError:
        return 0
    except (ValueError, OSError, RuntimeError) as err:
        print(f'error: {_one_line(err)}', file=sys.stderr)
        return 2


def diagnose():
    """Entry point of ``ros2 run telescope_mount diagnose``."""
    return main(['diagnose', *sys.argv[1:]])


def _one_line(err):
    if isinstance(err, OSError) and err.strerror:
        return f'{err.filename}: {err.strerror}' if err.filename else err.strerror
    return ' '.join(str(err).split())


if __name__ == '__main__':
    sys.exit(main())
