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

"""The graph of a real mount under ROS launch: drivers, and the nodes that are no hardware."""

from pathlib import Path

from pointing_model.mount_kinds import kinds_text
from telescope_mount.graph import real_graph
from telescope_mount.launch_actions import description, started
from telescope_mount.observing.plan import parse_plan, real_plan

EXAMPLES = Path(__file__).resolve().parents[1] / 'examples'
SAMPLES = ','.join(str(EXAMPLES / f'{name}.py') for name in (
    'toy_telescope', 'mount_driver', 'encoder_driver', 'camera_driver'))
ARGUMENTS = (
    ('bag', 'bag', 'folder of the log; it must not exist'),
    ('mount', 'altaz', kinds_text()),
    ('drivers', SAMPLES, 'Python files to start, separated by commas; none: they run already'),
    ('absolute_encoder', 'false', 'whether a driver publishes absolute/joint_states'),
    ('inclinometer', 'false', 'whether a driver publishes inclinometer'),
    ('exposure', '0.0', "length of the camera's exposures, s, in which the mount must rest on its "
     'track; 0: it is judged in their middle'),
    ('state_file', '', 'file in which the night is kept: started again with it (and another bag), '
     'a plan that was interrupted goes on; none: not kept'),
    ('autostart', 'true', 'false: nothing moves before the guard is configured and activated '
     '(ros2 lifecycle set)'),
    ('plan', real_plan(30), 'steps of the observer'),
)


def nodes(values):
    """Drivers, and what stands beside them."""
    parse_plan(values['plan'])
    drivers = [] if values['drivers'] == 'none' else values['drivers'].split(',')
    for path in drivers:
        if not Path(path).is_file():
            raise ValueError(f'drivers:= names {path}, which is no file')
    return started(values, real_graph(
        bag=values['bag'], plan=values['plan'], mount=values['mount'],
        absolute_encoder=values.truth('absolute_encoder'),
        inclinometer=values.truth('inclinometer'),
        exposure=values.number(float, 'exposure'), state_file=values['state_file'],
        namespace=values['namespace'], autostart=values.truth('autostart')), drivers)


def generate_launch_description():
    """Arguments as `ros2 launch telescope_mount real_mount.launch.py --show-args` lists them."""
    return description('real_mount.launch.py', ARGUMENTS, nodes)
