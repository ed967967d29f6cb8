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

"""The command line, the description of the node graph, and the interface for Python programs.

``from telescope_mount import read_run, fit, diagnose, apply``: see `telescope_mount.api`, which is
imported on first use. None of them needs ROS.
"""

#: environment: our matrices are small and eight processes share the cores, so threads of BLAS only
#: slow each other down; set it before numpy is imported, so nothing here may import numpy
ONE_THREAD = {'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1'}

__all__ = ['apply', 'diagnose', 'fit', 'read_run']


def __getattr__(name):
    """Import `api` on first use: nodes import this package and do not need it."""
    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from . import api
    found = globals()[name] = getattr(api, name)
    return found


def __dir__():
    return sorted({*globals(), *__all__})
