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

"""The commands of `telescope-mount`, a file each: its options, what it does, what it prints.

Each has ``add(commands)``, which adds its parser, and ``run(args)``, which gives the exit code or
None. What costs time to import is imported in ``run``.
"""

#: modules in the order of the help
COMMANDS = ('night', 'observe', 'watch', 'check_drivers', 'guard', 'lifecycle', 'experiment',
            'close_the_loop', 'solve', 'fit', 'diagnose', 'bolts', 'track', 'passes', 'satellite',
            'season', 'zeros', 'apply', 'export', 'info', 'recover', 'verify', 'replay',
            'encoder_test', 'completion')
#: where those are that show what the papers did
PAPERS = {name: f'papers.{name}_command' for name in ('experiment', 'encoder_test')}
