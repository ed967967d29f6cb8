"""The command ``replay``."""

from pathlib import Path

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'replay', help='replay a log into a fresh calibration',
        description='Publish a log again, calibrate on it, and print the same tables.')
    parser.add_argument('log', type=Path, metavar='BAG')
    options.add(parser, 'reference', help='the reference model, if the night had one')
    options.add(parser, 'seed',
                help='of the choice of held-out stars; that of the night (default: 1)')
    parser.add_argument('--out', type=Path, metavar='FILE', help='write the model')
    options.add(parser, 'domain')


def run(args):
    """Replay, print, write."""
    from ..replay import replay_log
    from .console import new_console, print_calibration, print_files
    options.check_target(args.out)
    if args.reference is not None:
        from pointing_model.model import PointingModel
        PointingModel.load(args.reference)
    console = new_console()
    report = replay_log(args.log, reference=args.reference, seed=args.seed, out=args.out,
                        domain_number=args.domain)
    print_calibration(console, report)
    if report['diagnosis']:
        found = report['diagnosis']
        print_files(console, {
            'diagnosis': f'{found["verdict"]}: {", ".join(found["applied"]) or "–"}'})
