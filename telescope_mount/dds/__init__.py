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

"""Network settings of DDS in environment variables: by default only this machine."""

import os
import sys
from pathlib import Path

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
IMPLEMENTATION = 'RMW_IMPLEMENTATION'
_FAST = ('rmw_fastrtps_cpp', 'rmw_fastrtps_dynamic_cpp')
#: variables of Fast DDS, new and old name
PROFILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
#: variables by which a user has named other hosts
_OTHERS = ('ROS_STATIC_PEERS', 'ROS_DISCOVERY_SERVER')


def dds_environment(domain=None):
    """Environment variables for fast discovery within a graph, restricted to allowed hosts.

    Parameters
    ----------
    domain : int, optional
        ROS domain; that of the environment if omitted.

    Returns
    -------
    dict of str to str
        Variables that the user has set are unchanged, except the domain.
    """
    out = {} if domain is None else {'ROS_DOMAIN_ID': str(domain)}
    # opening the graph to the network is the user's explicit choice
    wanted = os.environ.get(RANGE) or 'LOCALHOST'
    out[RANGE] = wanted
    if not any(os.environ.get(name) for name in PROFILES):
        here = wanted == 'LOCALHOST' and not any(os.environ.get(name) for name in _OTHERS)
        profile = Path(__file__).parent / ('this_machine.xml' if here else 'network.xml')
        out.update({name: str(profile) for name in PROFILES})
        if here and _fast_dds():
            # the profile is sufficient; LOCALHOST would add a socket on 0.0.0.0. Another DDS would
            # not read the profile, so name the implementation
            out |= {RANGE: 'SYSTEM_DEFAULT', IMPLEMENTATION: _fast_dds()}
    return out


def _fast_dds():
    """Name of the requested Fast DDS, or of an installed one if none is requested; else ''."""
    asked = os.environ.get(IMPLEMENTATION)
    if asked:
        return asked if asked in _FAST else ''
    prefixes = [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]
    index = Path('share', 'ament_index', 'resource_index', 'rmw_typesupport')
    return _FAST[0] if any((Path(prefix) / index / _FAST[0]).is_file()
                           for prefix in prefixes if prefix) else ''
