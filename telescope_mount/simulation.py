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

"""The only access to the simulator from outside.

A calibration must not know the truth, so nothing else outside `encoder_sim` imports it, except for
the modules of its nodes in `graph.NODES`. Available here are a list of names, the kind of mount of
a scenario, an encoder and its CCD for a bench that does not calibrate, and what a scenario did,
from the log of the truth after the night.
"""

import json

from encoder_sim.absolute import Absolute
from encoder_sim.ccd import LinearCCD
from encoder_sim.scenario_file import described_scenarios, load_scenario, scenario_names
from encoder_sim.scenario_file import undeclared as _undeclared
from msg_tools.bag import BagReader
from pointing_model.mounts import parse_mount

__all__ = ['Absolute', 'LinearCCD', 'described_scenarios', 'kind_of_mount', 'scenario_names',
           'undeclared']


def kind_of_mount(scenario, mount=''):
    """Kind of mount that the observer of a scenario is given.

    Parameters
    ----------
    scenario : str
        A name or a YAML file.
    mount : str
        A kind to use instead, with the same joints; empty: the scenario's.

    Returns
    -------
    str
        Text for `pointing_model.mounts.parse_mount`.

    Raises
    ------
    ValueError, OSError
        No such scenario, or an invalid one; or its mount has other joints.
    """
    own = load_scenario(scenario).mount
    told = parse_mount(mount, 0.0) if mount else own
    if told.names.keys == own.names.keys:
        return mount or own.kind
    others = [name for name in scenario_names() if load_scenario(name).mount.kind == told.kind]
    raise ValueError(
        f'scenario {scenario} has {own.names.words} and not {told.names.words}: give the mount '
        f'{own.kind}, or a scenario ' + (
            f'such as {min(others, key=len)}' if others else 'of your own with such a mount'))


def undeclared(bag):
    """The hidden errors of a night's scenario; to be read after all decisions.

    Parameters
    ----------
    bag : str or Path
        Folder of the truth.

    Returns
    -------
    dict or None
        See `encoder_sim.scenario_file.undeclared`; None if the log does not have it.
    """
    from msg_tools import topics
    log = BagReader(bag)
    for topic in log.topics:
        if topic.name.endswith('/' + topics.TRUTH_SCENARIO.name):
            for message in log.messages(topic.name, decode=True):
                return _undeclared(json.loads(message.data.data)[0]['text'])
    return None
