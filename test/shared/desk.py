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

"""A calibration node with one who observes for it."""

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from calibration.calibration_node import Calibration
from msg_tools import topics
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_messages import run_to_cloud

START = 1_768_482_000_000_000_000
MOUNT = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)))


def rows(n, run=1, star=None, zero=(0.0, 0.0), seed=0):
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))
    if star is not None:
        az, el = 0.4 * DEG + 1e-4 * np.arange(n), 34.9 * DEG + 1e-5 * np.arange(n)
    az_enc, el_enc = MOUNT.sky_to_encoder(az, el)
    x, y = rng.normal(size=(2, n)) * 0.3 * ARCSEC
    return PointingRun({
        'az': az, 'el': el, 'az_enc': az_enc + zero[0] + x / np.cos(el),
        'el_enc': el_enc + zero[1] + y, 'run': np.full(n, float(run)),
        'star': np.arange(n) + 1.0 if star is None else np.full(n, float(star))})


class Desk:

    def __init__(self, graph, **overrides):
        self.graph = graph
        self.node = graph.add(Calibration, **overrides)
        self.pub = graph.publisher(topics.OBSERVATION)
        graph.connect()
        self.stamp, self.count = START, 0

    def observe(self, run):
        """Send `run` row by row and wait until all are taken."""
        for i in range(len(run)):
            self.stamp += 10**9
            self.pub.publish(run_to_cloud(run.select([i]), self.stamp))
        self.count += len(run)
        self.graph.report('calibration', '', 'observations', self.count)
