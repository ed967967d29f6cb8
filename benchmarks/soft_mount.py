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

"""Exposures on a mount that oscillates: how much of the oscillation is in the offsets?

    python benchmarks/soft_mount.py              # three seeds
    python benchmarks/soft_mount.py --full       # ten seeds, and other mounts beside

The observer's sequencer with a mount, an encoder at 20 Hz and a camera in this process, on a
simulated clock. Each axis is a spring on its drive. Exposures follow each other, and an image shows
the mean position of the star; noise 1" per axis, so 1.41" radial. The rows are written as a log and
verified to the bit.
"""

import argparse
import logging
import sys
import tempfile
from pathlib import Path

import numpy as np
from rclpy.serialization import serialize_message

from msg_tools import convert, topics
from msg_tools.bag import BagReader, BagWriter
from msg_tools.units import ARCSEC
from pointing_model.runs.run_messages import run_to_cloud
from telescope_mount.log_check.log_check import _read
from telescope_mount.log_check.log_comparison import LogComparison

sys.path.append(str(Path(__file__).resolve().parents[1] / 'test' / 'pointing_model' / 'observing'))

from test_settled import SoftMount

NOISE = np.sqrt(2.0)  # radial, arcsec


class Logged(SoftMount):
    """As it is, with a log of what the observer hears and says."""

    def __init__(self, plan, bag, seed, **settings):
        self.bag, self.count_logged = bag, 0
        for topic in (topics.INCREMENTAL, topics.MISS_DISTANCE, topics.REQUEST,
                      topics.OBSERVATION):
            bag.add_topic(f'/mount/{topic.name}', topic.type)
        super().__init__(plan, star_seed=seed, absolute=False, **settings)
        self.noise = np.random.default_rng(seed)
        take, frame = self.instruments.take_incremental, self.instruments.take_frame

        def reading(stamp, angles, rates, *rest):
            self.log(topics.INCREMENTAL, convert.joint_state(stamp, angles, rates))
            return take(stamp, angles, rates, *rest)

        def image(stamp, x, y):
            self.log(topics.MISS_DISTANCE, convert.sky_vector(stamp, x, y))
            return frame(stamp, x, y)
        self.instruments.take_incremental, self.instruments.take_frame = reading, image

    def log(self, topic, message):
        self.count_logged += 1
        self.bag.write(f'/mount/{topic.name}', serialize_message(message),
                       self.stamp + self.count_logged, self.stamp)

    def send_command(self, track):
        self.log(topics.REQUEST, convert.trajectory(*track))
        super().send_command(track)

    def send_row(self, run, stamp):
        self.log(topics.OBSERVATION, run_to_cloud(run, stamp))
        super().send_row(run, stamp)


def night(stars, seed, exposure, frequency, damping, length=1.0):
    """Offsets (n, 2) in arcsec, stars lost, seconds a star, numbers verified and not."""
    with tempfile.TemporaryDirectory() as folder:
        with BagWriter(Path(folder) / 'bag') as bag:
            bench = Logged(f'stars {stars}', bag, seed, exposure_s=exposure)
            bench.frequency, bench.damping, bench.length = frequency, damping, length
            bench.until(lambda: not bench.plan.busy, 400000)
        assert bench.plan.progress.state == 'done', bench.plan.text
        check = LogComparison()
        _read(BagReader(Path(folder) / 'bag'), '/mount/', check)
    offsets = np.array([np.array(row.offsets()).ravel() for row in bench.rows]) / ARCSEC
    return (offsets, bench.plan.progress.lost, (bench.stamp - bench.begin) * 1e-9 / stars,
            sum(check.checked.values()), len(check.differences) + len(check.unchecked))


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--full', action='store_true')
    parser.add_argument('--seeds', type=int, default=3)
    parser.add_argument('--stars', type=int, default=20)
    args = parser.parse_args()
    logging.disable(logging.WARNING)  # what it says of a mount that swings
    seeds, stars = 10 if args.full else args.seeds, args.stars
    mounts = [(0.5, 0.15), *([(0.5, 0.05), (0.25, 0.15), (1.0, 0.15), (2.0, 0.1)]
                             if args.full else [])]
    print('mount, Hz, damping   exposure_s   stars   lost   radial rms, "   above its noise   '
          'worst seed   s a star   verified, of')
    for frequency, damping in mounts:
        of_it = seeds if (frequency, damping) == mounts[0] else 3
        for exposure in (0.0, 1.0):
            out = [night(stars, seed, exposure, frequency, damping)
                   for seed in range(1, of_it + 1)]
            each = [np.sqrt(np.mean(np.sum(one[0]**2, axis=1))) for one in out]
            rms = np.sqrt(np.mean(np.sum(np.concatenate([one[0] for one in out])**2, axis=1)))
            numbers, wrong = (sum(one[i] for one in out) for i in (3, 4))
            print(f'{frequency:9.2f} {damping:10.2f} {exposure:12.1f} '
                  f'{sum(len(one[0]) for one in out):7} {sum(one[1] for one in out):6} {rms:15.2f} '
                  f'{100.0 * (rms / NOISE - 1.0):15.1f} % {max(each):12.2f} '
                  f'{np.mean([one[2] for one in out]):10.1f}   {numbers - wrong}, {numbers}',
                  flush=True)


if __name__ == '__main__':
    main()
