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

"""The family-wise error rate of a diagnosis, and how its searches share it."""

#: default family-wise error rate: probability of any effect in a run with nothing wrong
ALPHA = 0.01
#: shares of the family-wise error: the dictionary; its scans over places, periods or lags; waves of
#: unknown period; curves; steps, in time of terms other than zeros, or at one angle. False alarms
#: overlap and the tests are conservative: the total stays below the family-wise error (measured,
#: benchmarks/diagnosis.py).
SHARES = {'dictionary': 0.45, 'scans': 0.45, 'periods': 0.15, 'curves': 0.18, 'steps': 0.05}
#: share of the likelihood-ratio test of groups that are not significant against the estimated
#: correlated noise, for either share of the dictionary: limits the part of nights with such noise
#: that get a false effect by this test
MEMORY_SHARE = 0.75
