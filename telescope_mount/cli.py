"""The command `telescope-mount`."""

import argparse
import os
import signal
import sys
from importlib import import_module

from .commands import COMMANDS
from .threads import ONE_THREAD

os.environ.update(ONE_THREAD | os.environ)  # before numpy comes


class _Parser(argparse.ArgumentParser):
    def error(self, message):
        # one line: what is wrong and where to read on
        print(f'error: {message} (see {self.prog} --help)', file=sys.stderr)
        raise SystemExit(2)


def _parser():
    parser = _Parser(prog='telescope-mount',
                     description='Measure a telescope mount: observe, fit, check, log, replay.')
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name in COMMANDS:
        _module(name).add(commands)
    return parser


def _module(name):
    return import_module(f'telescope_mount.commands.{name}')


def main(argv=None):
    """Entry point; returns the exit code.

    0 done, 1 a check found a difference, 2 bad input, 130 ended by Ctrl-C, 143 by SIGTERM.
    """
    parser = _parser()
    args, unknown = parser.parse_known_args(argv)
    if unknown:  # of the command: its own help says what it takes
        _Parser(prog=f'{parser.prog} {args.command}').error(
            f'unrecognized arguments: {" ".join(unknown)}')
    try:
        return _module(args.command.replace('-', '_')).run(args) or 0
    except KeyboardInterrupt as end:
        number = end.args[0] if end.args else signal.SIGINT
        by = 'Ctrl-C' if number == signal.SIGINT else signal.Signals(number).name
        print(f'ended by {by}; what was logged is closed and readable', file=sys.stderr)
        return 128 + number
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
