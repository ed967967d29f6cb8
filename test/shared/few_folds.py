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

"""Cross-validation over few partitions into few folds, few flips and periods: a third of the time.

What is chosen hardly depends on them, and how sure the figure is `benchmarks/` show. Three folds
are the fewest that leave most rows in, and 2 partitions the fewest that have a scatter; the rule
for more of them has a test of its own. 299 flips are the fewest that tell a p of 0.0035, a curve's
share of an alpha of 0.01. Periods are searched up to 200 a turn, a fifth of what a user has;
`benchmarks/periods.py` looks for all of them.

As a program it is ``telescope-mount`` with them: its nodes, forked from it, diagnose as the tests
do, to the bit.
"""

import sys


def patched(setattr, setitem):
    """Put them in the place of those that a user has."""
    from calibration.analysis import harmonic_fit, sky_model
    from calibration.analysis.diagnosis import diagnosis, period_scans, validation
    choices = harmonic_fit.cross_validated
    setattr(validation, 'PARTITIONS', 2)
    setattr(validation, 'MOST_PARTITIONS', 3)
    setitem(diagnosis.diagnose.__kwdefaults__, 'folds', 3)
    setitem(diagnosis.diagnose.__kwdefaults__, 'flips', 299)
    setattr(sky_model, 'FOLDS', 4)
    setattr(period_scans, 'MOST', 200.0)
    setattr(choices, '__defaults__', (*choices.__defaults__[:-1], 3))


if __name__ == '__main__':
    del sys.path[0]  # the tests' folders have the packages' names
    from telescope_mount.cli import main
    patched(setattr, dict.__setitem__)
    sys.exit(main())
