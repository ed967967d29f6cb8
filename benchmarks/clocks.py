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

"""Clock offset between camera and encoder: detection, accuracy and false detections.

    python benchmarks/clocks.py                  # three offsets, two seeds each
    python benchmarks/clocks.py --full           # eleven offsets, ten seeds each

Simulated nights with all processes (scenario `default`, exposures of 1 s): home, four stars, 24
exposures of one star while the axes drift past it at up to 30"/s, a fit. The incremental encoder
stamps its readings early, which is equivalent to a camera that stamps late. The absolute encoder is
synchronous with the camera.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
import yaml

from msg_tools import topics
from telescope_mount.graph import night_graph
from telescope_mount.log_check.log_check import verify_log
from telescope_mount.nights import whole_night as night

PLAN = 'home, stars 4, clocks 24, fit'
SMALL = (0.0, 0.05, 0.2)
FULL = (0.0, 0.05, -0.05, 0.1, -0.1, 0.2, -0.2, 0.3, -0.3, 0.5, -0.5)


def measure(folder, late, seed):
    """One night: the offset against both encoders, and whether all of the log is verified."""
    scenario = folder / 'late.yaml'
    axis = {'latency_ms': -1000.0 * late}
    scenario.write_text(yaml.safe_dump({
        'based_on': 'default', 'incremental': {'azimuth': axis, 'elevation': axis}}))
    params = folder / 'params.yaml'
    params.write_text(yaml.safe_dump(
        {'/mount/star_observer': {'ros__parameters': {'exposure_s': 1.0}}}))
    specs = night_graph(bag=str(folder / 'bag'), scenario=str(scenario), seed=seed, plan=PLAN)
    told = night.observe(folder, specs, PLAN, lambda latest: json.loads(
        latest[topics.CHECKS.name].data)['clocks'], params_file=params)
    report = verify_log(folder / 'bag', seed=seed)
    return told['found'], told['absolute'], not report['differences'], sum(
        report['checked'].values())


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--full', action='store_true')
    parser.add_argument('--seeds', type=int, default=2)
    args = parser.parse_args()
    offsets, seeds = (FULL, 10) if args.full else (SMALL, args.seeds)
    print('late, s  nights   found, s   scatter, s   sigma, s   worst, sigma   absolute, s   '
          'verified')
    pulls = []
    for block, late in enumerate(offsets):
        found, second, verified, numbers = [], [], 0, 0
        for seed in range(100 * block + 1, 100 * block + seeds + 1):
            with tempfile.TemporaryDirectory() as folder:
                one, other, same, count = measure(Path(folder), late, seed)
            found.append([one['offset_s'], one['sigma_s']])
            second.append(other['offset_s'])
            verified, numbers = verified + same, numbers + count
        values, sigma = np.array(found).T
        pulls += list((values - late) / sigma)
        print(f'{late:+7.2f} {len(values):7} {values.mean():+10.4f} {values.std():12.4f} '
              f'{sigma.mean():10.4f} {np.abs((values - late) / sigma).max():14.1f} '
              f'{np.mean(second):+13.4f}   {verified} of {seeds}, {numbers} numbers', flush=True)
    print(f'(found - true) / sigma of {len(pulls)}: scatter {np.std(pulls):.2f}, '
          f'mean {np.mean(pulls):+.2f}')


if __name__ == '__main__':
    main()
