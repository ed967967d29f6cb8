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

"""The one door from outside to the simulator.

Who calibrates may not know the truth, so nobody else outside of `encoder_sim` names it, but for the
modules of its nodes in `graph.NODES`. What comes through here is a list of names, what kind of
mount one has, an encoder and its CCD for a bench that calibrates nothing, and what a scenario did,
out of the log of the truth when all is over.
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
    """What kind of mount who observes with that of a scenario is told.

    Parameters
    ----------
    scenario : str
        A name or a YAML file.
    mount : str
        What to tell instead, with the same joints; empty: the scenario's.

    Returns
    -------
    str
        As `pointing_model.mounts.parse_mount` takes it.

    Raises
    ------
    ValueError, OSError
        There is no such scenario, or it is wrong; or its mount has other joints.
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
    """What the scenario of a night did that nobody was told; read when all is over.

    Parameters
    ----------
    bag : str or Path
        Folder of the truth.

    Returns
    -------
    dict or None
        As `encoder_sim.scenario_file.undeclared`; None where the log does not report it.
    """
    from msg_tools import topics
    log = BagReader(bag)
    for topic in log.topics:
        if topic.name.endswith('/' + topics.TRUTH_SCENARIO.name):
            for message in log.messages(topic.name, decode=True):
                return _undeclared(json.loads(message.data.data)[0]['text'])
    return None
