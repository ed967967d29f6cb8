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

"""The commands and the parser of the command line, with hints for unknown words."""

import argparse
import os
import re
import sys
from difflib import get_close_matches
from importlib import import_module

from msg_tools import version_of
from msg_tools.terminal_signs import spell_out

from .commands.options import json_given

#: modules of commands/, in the order of the help text -> words of an example
COMMANDS = {
    'fit': 'run.csv --exclude "el<20" --save model.json',
    'diagnose': 'run.csv --holdout new.csv --save model.json',
    'bolts': 'run.csv --per-turn 31,44 --saddle 400',
    'apply': 'model.json directions.csv --out angles.csv',
    'export': 'model.json out.mod --to tpoint --sky run.csv',
    'season': 'nights --tonight temperature=4.5',
    'track': 'run.csv --first 20 --report page.html',
    'satellite': 'tracks.csv --orbit lageos2.sp3.gz',
    'passes': '--orbit a.cpf --latitude 34.3 --longitude 109',
    'zeros': 'zeros.csv',
    'solve': 'images --scale 1.1 1.3',
    'info': 'night --report page.html',
    'verify': 'night/bag',
    'recover': 'night/bag --out saved',
    'encoder_test': '--turns 5 --out bench',
    'night': '--out night --seed 3',
    'observe': '--params mount.yaml --driver camera.py',
    'check_drivers': '--seconds 20 --params mount.yaml',
    'guard': 'pause',
    'watch': '--domain 7',
    'lifecycle': 'mount_guard deactivate',
    'close_the_loop': '--scenario loop_azimuth_drift',
    'experiment': '--nights 11 --out experiment',
    'replay': 'night/bag --save again.json',
    'completion': 'bash'}
#: modules of the commands that reproduce the papers
PAPERS = {name: f'papers.{name}_command' for name in ('experiment', 'encoder_test')}


class _Parser(argparse.ArgumentParser):

    def error(self, message):
        # one line: what is wrong and where to read more
        print(f'error: {_with_hint(message)} (see {self.prog} --help)', file=sys.stderr)
        raise SystemExit(2)


class _Version(argparse.Action):
    """Print the version and exit; it is looked up only on request."""

    def __call__(self, parser, *_):
        print('telescope-mount', version_of() or 'of a folder that is not installed')
        parser.exit()


def make_parser(only=None):
    """The parser of the command line.

    Parameters
    ----------
    only : str, optional
        Module of the requested command: the others are not loaded.

    Returns
    -------
    argparse.ArgumentParser
    """
    parser = _Parser(prog='telescope-mount',
                     description='Measure a telescope mount: observe, fit, check, log, replay.',
                     epilog='night to replay need ROS. Exit codes: 0 done, 1 a check found '
                     'something, 2 bad input, 130 ended by Ctrl-C. What options mean everywhere: '
                     'docs/command_line.md.')
    parser.add_argument('--version', action=_Version, nargs=0, help='print the version and end')
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name in COMMANDS if only is None else [only]:
        module_of(name).add(commands)
        word = name.replace('_', '-')
        commands.choices[word].epilog = f'Example: telescope-mount {word} {COMMANDS[name]}'
    return parser


def module_of(name):
    """The module of a command."""
    return import_module(f'telescope_mount.{PAPERS.get(name, "commands." + name)}')


def parsed(argv):
    """Parse the arguments of a command line.

    Raises
    ------
    SystemExit
        They are wrong, which is reported; or help was requested.
    """
    name = argv[0].replace('-', '_') if argv else ''
    parser = make_parser(name if name in COMMANDS else None)
    for stream in (sys.stdout, sys.stderr):
        spell_out(stream)
    if '_ARGCOMPLETE' in os.environ:
        import argcomplete
        argcomplete.autocomplete(parser, always_complete_options=False)
    words = json_given(argv)
    args, unknown = parser.parse_known_args(words)
    if not unknown:
        return args
    own = next(a.choices for a in parser._actions if a.dest == 'command')[args.command]
    if len(own._get_positional_actions()) > 1:  # its last word may stand behind an option
        args, unknown = own.parse_known_intermixed_args(
            words[1:], argparse.Namespace(command=args.command))
    if unknown:  # of the command, whose own help lists its options
        _refuse(own, unknown)
    return args


def _refuse(own, unknown):
    """Exit with a message about options unknown to the parser of a command, and a hint."""
    options = [text for action in own._actions for text in action.option_strings]
    first = unknown[0].partition('=')[0]
    hint = ''
    if first.startswith('-'):
        hint = _meant(first, options)
    elif first.lower().endswith(('.json', '.txt')) and '--json' in options:
        hint = '; a file for --json has a name that ends in .json'
    own.error(f'unrecognized arguments: {" ".join(unknown)}{hint}')


def _with_hint(message):
    """Append the closest choice to argparse's message about an invalid choice."""
    found = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)$", message)
    if found is None:
        return message
    return message + _meant(found[1], [word.strip("' ") for word in found[2].split(',')])


def _meant(word, words):
    bare = {other.lstrip('-'): other for other in words}
    near = get_close_matches(word.lstrip('-'), bare, 1, 0.6)
    return f'; did you mean {bare[near[0]]}?' if near else ''
