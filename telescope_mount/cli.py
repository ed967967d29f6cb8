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

# PYTHON_ARGCOMPLETE_OK
"""The command `telescope-mount`. It imports only what Ctrl-C cannot harm."""

import os
import sys

try:
    from . import ONE_THREAD
    from .processes.interrupt import interrupted_in_order
except KeyboardInterrupt:
    print('ended by Ctrl-C', file=sys.stderr)
    sys.exit(130)

os.environ.update(ONE_THREAD | os.environ)  # before numpy comes


def main(argv=None):
    """Entry point; returns the exit code.

    0: done. 1: a check found something (a number that differs, a damaged log, a faulty driver, an
    unsolved image, a refusal). 2: bad input. 130: ended by Ctrl-C, 143 by SIGTERM, 129 by SIGHUP.
    """
    command = ''
    try:
        with interrupted_in_order(program=argv is None):
            from .command_parser import parsed
            args = parsed(sys.argv[1:] if argv is None else list(argv))
            command = args.command
            return _run(args)
    except KeyboardInterrupt as end:
        import signal

        from .command_parser import module_of
        number = end.args[0] if end.args else signal.SIGINT
        by = 'Ctrl-C' if number == signal.SIGINT else signal.Signals(number).name
        logged = '; what was logged is closed and readable' if command and hasattr(
            module_of(command.replace('-', '_')), 'NEEDS_ROS') else ''
        print(f'ended by {by}{logged}', file=sys.stderr)
        return 128 + number
    except BrokenPipeError:
        silence_output()  # the reader has gone
        return 0
    except ImportError as err:
        from .missing_ros import missing
        line = missing(err, command)
        if line is None:
            raise
        print(f'error: {line}', file=sys.stderr)
        return 2
    except (ValueError, OSError, RuntimeError, MemoryError) as err:
        try:
            sys.stdout.flush()
        except (OSError, ValueError):  # the output itself cannot be written
            silence_output()
        print(f'error: {_one_line(err)}', file=sys.stderr)
        return 2


def silence_output():
    """Discard unwritten output, or the interpreter would try to write it again at its end."""
    from contextlib import suppress
    with open(os.devnull, 'w') as nobody, suppress(OSError, ValueError):
        os.dup2(nobody.fileno(), sys.stdout.fileno())


def _run(args):
    """Check what can be checked in advance, do the work, and return the exit code."""
    from .command_parser import module_of
    from .commands import options
    from .commands.console import ProgressLine
    module = module_of(args.command.replace('-', '_'))
    if getattr(module, 'NEEDS_ROS', False) and not options.is_list(args):
        from .missing_ros import check
        check(args.command)
    options.check_files(args)
    with options.json_alone(args), ProgressLine(first=args.command):
        code = module.run(args) or 0
    sys.stdout.flush()  # a full disk may fail only here
    return code


def _near(name):
    """Hint at a file with a similar name, if a file is missing."""
    from contextlib import suppress
    from difflib import get_close_matches
    folder, word = os.path.split(name)
    with suppress(OSError):
        near = get_close_matches(word, os.listdir(folder or '.'), 1, 0.8)
        if near:
            return f'; did you mean {os.path.join(folder, near[0])}?'
        return '; look at the name, or give the whole path'
    return f'; there is no folder {folder}'


def diagnose():
    """Entry point of ``ros2 run telescope_mount diagnose``."""
    return main(['diagnose', *sys.argv[1:]])


def _one_line(err):
    from msg_tools.whole_files import reason
    if isinstance(err, MemoryError):
        return f'not enough memory: {" ".join(str(err).split()) or "take fewer rows"}'
    if isinstance(err, FileNotFoundError) and err.filename:
        return f'{err.filename}: No such file or directory{_near(str(err.filename))}'
    if isinstance(err, OSError) and err.strerror:
        return f'{err.filename}: {reason(err)}' if err.filename else reason(err)
    return ' '.join(str(err).split())


if __name__ == '__main__':
    sys.exit(main())
