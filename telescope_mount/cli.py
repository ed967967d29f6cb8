# PYTHON_ARGCOMPLETE_OK
"""The command `telescope-mount`."""

import argparse
import os
import signal
import sys
from contextlib import suppress
from importlib import import_module

from .commands import COMMANDS
from .threads import ONE_THREAD

os.environ.update(ONE_THREAD | os.environ)  # before numpy comes

#: options that are called otherwise than once, by command
RENAMED = {
    ('diagnose', '--driver'): '--cause', ('season', '--driver'): '--cause',
    ('solve', '--mount'): '--keywords', ('replay', '--out'): '--save',
}


class _Parser(argparse.ArgumentParser):
    def error(self, message):
        # one line: what is wrong and where to read on
        print(f'error: {_with_hint(message)} (see {self.prog} --help)', file=sys.stderr)
        raise SystemExit(2)


class _Version(argparse.Action):
    def __call__(self, parser, namespace, values, option_string=None):
        print(f'telescope-mount {_version()}')
        raise SystemExit(0)


def _version():
    from importlib.metadata import PackageNotFoundError, version
    try:
        return version('telescope_mount')
    except PackageNotFoundError:
        return 'of a folder that is not installed'


def make_parser():
    """The parser of the command line.

    Returns
    -------
    argparse.ArgumentParser
    """
    parser = _Parser(prog='telescope-mount',
                     description='Measure a telescope mount: observe, fit, check, log, replay.',
                     epilog='Exit codes: 0 done, 1 a check found something, 2 bad input, 130 ended '
                     'by Ctrl-C. What options mean everywhere: docs/command_line.md.')
    parser.add_argument('--version', action=_Version, nargs=0, help='print the version and end')
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name in COMMANDS:
        _module(name).add(commands)
    return parser


def _module(name):
    return import_module(f'telescope_mount.commands.{name}')


def main(argv=None):
    """Entry point; returns the exit code.

    0 done, 1 a check found something (a number that differs, a damaged log, a driver that is
    wrong, an image that was not solved, a refusal), 2 bad input, 130 ended by Ctrl-C, 143 by
    SIGTERM.
    """
    command = ''
    try:
        parser, argv = make_parser(), sys.argv[1:] if argv is None else list(argv)
        args = _parsed(parser, argv)
        command = args.command
        return _run(args)
    except KeyboardInterrupt as end:
        number = end.args[0] if end.args else signal.SIGINT
        by = 'Ctrl-C' if number == signal.SIGINT else signal.Signals(number).name
        logged = '; what was logged is closed and readable' if command and hasattr(
            _module(command.replace('-', '_')), 'NEEDS_ROS') else ''
        print(f'ended by {by}{logged}', file=sys.stderr)
        return 128 + number
    except BrokenPipeError:
        # nobody reads on; the interpreter would say so once more at its end
        with open(os.devnull, 'w') as nobody, suppress(OSError, ValueError):
            os.dup2(nobody.fileno(), sys.stdout.fileno())
        return 0
    except ImportError as err:
        from .ros import missing
        line = missing(err, command)
        if line is None:
            raise
        print(f'error: {line}', file=sys.stderr)
        return 2
    except (ValueError, OSError, RuntimeError, MemoryError) as err:
        print(f'error: {_one_line(err)}', file=sys.stderr)
        return 2


def _parsed(parser, argv):
    """The arguments; an exit where they are wrong."""
    from msg_tools.spelling import spell_out

    from .commands.options import json_given
    for stream in (sys.stdout, sys.stderr):
        spell_out(stream)
    if '_ARGCOMPLETE' in os.environ:
        import argcomplete
        argcomplete.autocomplete(parser, always_complete_options=False)
    args, unknown = parser.parse_known_args(json_given(argv))
    if unknown:  # of the command: its own help says what it takes
        _refuse(parser, args.command, unknown)
    return args


def _run(args):
    """Check what can be checked before the work, do it, and give the exit code."""
    from .commands import options
    from .commands.console import Progress
    module = _module(args.command.replace('-', '_'))
    if getattr(module, 'NEEDS_ROS', False) and not options.is_list(args):
        from .ros import check
        check(args.command)
    options.check_written(args)
    with options.json_alone(args), Progress(first=args.command):
        return module.run(args) or 0


def _refuse(parser, command, unknown):
    """End with what is unknown to a command, and what may be meant."""
    own = next(a.choices for a in parser._actions if a.dest == 'command')[command]
    options = [text for action in own._actions for text in action.option_strings]
    first = unknown[0].partition('=')[0]
    hint = ''
    if (command, first) in RENAMED:
        hint = f'; it is called {RENAMED[command, first]}'
    elif first.startswith('-'):
        hint = _meant(first, options)
    elif first.lower().endswith(('.json', '.txt')) and '--json' in options:
        hint = '; a file for --json has a name that ends in .json'
    own.error(f'unrecognized arguments: {" ".join(unknown)}{hint}')


def _with_hint(message):
    """A choice that argparse refuses, with the nearest of those that it names."""
    import re
    found = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)$", message)
    if found is None:
        return message
    return message + _meant(found[1], [word.strip("' ") for word in found[2].split(',')])


def _meant(word, words):
    from difflib import get_close_matches
    bare = {other.lstrip('-'): other for other in words}
    near = get_close_matches(word.lstrip('-'), bare, 1, 0.6)
    return f'; did you mean {bare[near[0]]}?' if near else ''


def _near(name):
    """A file beside the one that is not there, with nearly its name."""
    folder, word = os.path.split(name)
    with suppress(OSError):
        from difflib import get_close_matches
        near = get_close_matches(word, os.listdir(folder or '.'), 1, 0.8)
        if near:
            return f'; did you mean {os.path.join(folder, near[0])}?'
        return '; look at the name, or give the whole path'
    return f'; there is no folder {folder}'


def diagnose():
    """Entry point of ``ros2 run telescope_mount diagnose``."""
    return main(['diagnose', *sys.argv[1:]])


def _one_line(err):
    if isinstance(err, MemoryError):
        return f'not enough memory: {" ".join(str(err).split()) or "take fewer rows"}'
    if isinstance(err, FileNotFoundError) and err.filename:
        return f'{err.filename}: No such file or directory{_near(str(err.filename))}'
    if isinstance(err, OSError) and err.strerror:
        what = {28: 'No space left on device; free some, or write elsewhere',
                13: 'Permission denied; write elsewhere, or have the rights changed',
                30: 'Read-only file system; write elsewhere'}.get(err.errno, err.strerror)
        return f'{err.filename}: {what}' if err.filename else what
    return ' '.join(str(err).split())


if __name__ == '__main__':
    sys.exit(main())
