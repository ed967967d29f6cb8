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

"""How many false alarms a diagnosis may make, and how its searches share them."""

#: chance that a run with nothing wrong gets any effect (family-wise error), by default
ALPHA = 0.01
#: parts of the family-wise error that the dictionary may use, what of it is tried at many places,
#: periods or lags, waves of unknown period, and the curves. Their alarms overlap and the tests are
#: conservative: together they stay below it (measured, benchmarks/diagnosis.py).
SHARES = {'dictionary': 0.45, 'scans': 0.45, 'periods': 0.15, 'curves': 0.18}
#: the same of what is not beyond noise with memory by its estimate, for either share of the
#: dictionary: of nights whose noise has memory this many are to have a false effect so
MEMORY_SHARE = 0.75
