"""The command ``encoder-test``."""

from pathlib import Path

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'encoder-test', help='the 23-face test of the absolute encoder, beside the paper\'s',
        description='Turn the simulated disc of the absolute encoder to 23 standard angles, read '
        'it by the paper\'s method, its two rivals and ours, and compare with what was printed.')
    options.add_out(parser, 'encoder_test', 'the picture and the page')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write all figures')
    options.add(parser, 'seed', help='of disc, table and noise (default: 1)')
    parser.add_argument('--turns', type=options.whole(2, 1000), default=20,
                        help='of 23 angles each (default: 20)')
    parser.add_argument('--pitch', type=int, choices=(48, 60), default=48,
                        help='pixels a bar (default: 48)')


def run(args):
    """Turn, read, print, plot."""
    import json

    from .. import encoder_test
    from ..encoder_page import write_encoder_page
    from .console import new_console, print_files, print_lines
    console = new_console()
    args.out.mkdir(parents=True, exist_ok=True)
    with console.status('') as status:
        tell = status.update if console.is_terminal else console.print
        report = encoder_test.run(args.seed, args.turns, args.pitch,
                                  lambda text: tell(f'{text} ...'))
    for table in encoder_test.tables(report):
        console.print(table)
    print_lines(console, 'note', encoder_test.notes(report))
    picture = args.out / 'encoder_test.png'
    encoder_test.plot(report, picture)
    if args.json:
        args.json.write_text(json.dumps(report, indent=1) + '\n', encoding='utf-8')
    page = args.out / 'page.html'
    write_encoder_page(page, report, [picture, *([args.json] if args.json else [])])
    print_files(console, {'picture': picture, **({'figures': args.json} if args.json else {}),
                          'page': page})
