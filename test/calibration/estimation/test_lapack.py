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

import subprocess
import sys

ALONE = """
import sys
import numpy as np
from calibration.estimation.lapack import lapack
factor, bad = lapack().dpotrf(np.array([[4.0, 2.0], [2.0, 5.0]]))
assert not bad and np.allclose(factor, [[2.0, 1.0], [0.0, 2.0]])
assert 'scipy.linalg' not in sys.modules
import scipy.linalg
assert scipy.linalg.lapack.dpotrf is lapack().dpotrf and np.allclose(
    scipy.linalg.cholesky(np.diag([4.0, 9.0])), np.diag([2.0, 3.0]))
"""


def test_the_routines_come_without_all_of_scipy_linalg_and_go_with_it():
    subprocess.run([sys.executable, '-c', ALONE], check=True)
