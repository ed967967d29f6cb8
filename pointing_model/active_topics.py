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

"""Subscriptions and the parameter that keep a node's active calibration up to date."""

from msg_tools import convert, topics
from msg_tools.homing import cloud_to_homing
from msg_tools.node import Param

from .active_calibration import ActiveCalibration
from .calibration_messages import ZeroPairs
from .model import PointingModel

MODEL_FILE = Param('model_file', '', 'active pointing model at the start (JSON or YAML)',
                   fixed=True)


def active_calibration_of(node, changed=lambda topic: None, mount=None):
    """The active calibration of `node`, kept up to date by its topics.

    Parameters
    ----------
    node : MountNode
        With the parameter `MODEL_FILE`.
    changed : callable
        Called with ``topics.MODEL``, ``topics.ZERO`` or ``topics.HOMING`` after each message.
    mount : Mount, optional
        The mount that the models must have.

    Returns
    -------
    ActiveCalibration
    """
    file = node.value(MODEL_FILE.name)
    model = PointingModel.load(file, mount) if file else None
    now = ActiveCalibration(model, mount)

    def on_temperature(message):
        now.thermometer.update(*convert.read_temperature(message))

    def on_model(message):
        now.update_model(message.data)
        changed(topics.MODEL)

    def on_homing(message):
        azimuth = cloud_to_homing(message).get('azimuth')
        now.update_power_on(azimuth and azimuth.identity)
        changed(topics.HOMING)

    zeros = ZeroPairs()

    def on_zero(message):
        found = zeros.take(message)
        if found is not None:
            now.update_zero(*found)
            changed(topics.ZERO)

    # of waiting messages the temperature is taken first, and the model before its zero
    for topic, callback in ((topics.AMBIENT, on_temperature), (topics.HOMING, on_homing),
                            (topics.MODEL, on_model), (topics.ZERO_IDENTITY, on_zero),
                            (topics.ZERO, on_zero)):
        node.subscribe(topic, callback)
    return now
