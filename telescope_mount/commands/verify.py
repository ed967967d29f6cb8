"""The command ``verify``."""

from pathlib import Path

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'verify', help='compute what a log derived once more, and compare',
        description='Compute observations, zeros, models, reports and diagnoses of a log again '
        'from what they were derived from, without a ROS graph. Exit code 1 if a number is not '
        'the same to the bit.')
    parser.add_argument('log', type=Path, metavar='BAG')
    options.add(parser, 'reference',
                help='the reference model of the night (default: as the log says)')
    options.add(parser, 'seed', default=None,
                help='of the choice of held-out stars (default: as the log says, or 1)')


def run(args):
    """Compute, compare, print; 1 if something differs."""
    from ..verify import verify_log
    from .console import new_console, print_lines
    report = verify_log(args.log, reference=args.reference, seed=args.seed)
    console = new_console()
    print_lines(console, 'note', report['unchecked'])
    print_lines(console, 'difference', report['differences'])
    total = sum(report['checked'].values())
    console.print(', '.join(f'{count} {kind}' for kind, count in report['checked'].items()))
    console.print(f'{total - len(report["differences"])} of {total} are the same to the bit')
    return 1 if report['differences'] else 0
