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

"""The command ``completion``."""

SHELLS = ('bash', 'zsh', 'fish')


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'completion', help='have a shell complete commands, options and names',
        description='Print what makes a shell complete commands, options, names of scenarios and '
        'files. Bash: eval "$(telescope-mount completion bash)" in ~/.bashrc. Zsh: the same in '
        '~/.zshrc after compinit. Fish: redirect it to '
        '~/.config/fish/completions/telescope-mount.fish.')
    parser.add_argument('shell', choices=SHELLS)


def run(args):
    """Print."""
    import argcomplete
    print(argcomplete.shellcode(['telescope-mount'], shell=args.shell))
