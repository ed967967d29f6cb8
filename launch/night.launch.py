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

"""A simulated night under ROS launch: the same graph as `telescope-mount night`."""

from pointing_model.mount_kinds import kinds_text
from telescope_mount.graph import night_graph
from telescope_mount.launch_actions import description, started
from telescope_mount.observing.plan import night_plan, parse_plan
from telescope_mount.simulation import kind_of_mount

ARGUMENTS = (
    ('bag', 'bag', 'folder of the log; it must not exist'),
    ('scenario', 'default', 'what is wrong with the simulated mount: a name or a YAML file'),
    ('mount', '', f'{kinds_text()}; empty: what the scenario has'),
    ('seed', '1', 'of every random number'),
    ('plan', '', 'steps of the observer; empty: a night of the following two'),
    ('stars', '30', 'in each of the two blocks'),
    ('polaris', '16', 'exposures for a zero: of Polaris where it is well up, else of stars'),
    ('start_time', '', 'UTC at which the night begins, ISO 8601'),
    ('time_scale', '0.0', 'simulated seconds a second; 0: as fast as the graph answers'),
)


def nodes(values):
    """All of a night."""
    plan = values['plan'] or night_plan(
        values.number(int, 'stars'), values.number(int, 'polaris'))
    parse_plan(plan)
    return started(values, night_graph(
        bag=values['bag'], scenario=values['scenario'], seed=values.number(int, 'seed'),
        mount=kind_of_mount(values['scenario'], values['mount']),
        start_time=values['start_time'], time_scale=values.number(float, 'time_scale'),
        plan=plan, namespace=values['namespace']))


def generate_launch_description():
    """Arguments as `ros2 launch telescope_mount night.launch.py --show-args` lists them."""
    return description('night.launch.py', ARGUMENTS, nodes)
