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

"""Checks the limit of open files: ROS does not report clearly when it is too small."""

import resource

#: open files that a node or command needs, including loaded libraries; half as many sufficed
NEEDED = 64


def check_open_files():
    """Refuse to start if the process may open too few files.

    Raises
    ------
    ValueError
        The limit is too small.
    """
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    if limit != resource.RLIM_INFINITY and limit < NEEDED:
        raise ValueError(f'only {limit} files may be open in a process; ROS needs {NEEDED}: '
                         'ulimit -n 1024')
