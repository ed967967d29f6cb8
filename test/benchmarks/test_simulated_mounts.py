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

"""The simulated mounts without ROS: through geometry and camera to terms and causes."""


import numpy as np
import pytest
from simulated_mounts import PLAIN, UNDECLARED, deviations, named, night, on_its_worm

from calibration.analysis.diagnosis.diagnosis import diagnose
from encoder_sim.scenario_file import load_scenario, scenario_files, undeclared
from pointing_model.mounts import is_beyond


@pytest.mark.parametrize('name', PLAIN)
def test_the_terms_come_back(name):
    scenario = load_scenario(name)
    run = night(scenario, seed=1)
    assert len(run) > 55
    assert run.mount.kind == scenario.mount.kind.partition(':')[0]
    # of a German mount both sides are observed, of others none is through the pole
    through = is_beyond(run['el']).mean()
    assert 0.3 < through < 0.7 if name == 'german' else through == 0.0
    z, left = deviations(run, scenario)
    assert len(z) == 7 and np.abs(z).max() < 3.0
    assert left == pytest.approx(np.sqrt(2.0), abs=0.2)  # the camera's noise


@pytest.mark.parametrize('name', UNDECLARED)
@pytest.mark.usefixtures('short_diagnosis')
def test_what_nobody_declared_is_named(name):
    wanted = undeclared(scenario_files(name)[0]['text'])['shows_as']
    result = diagnose(night(load_scenario(name), seed=2), cross_validation=False, seed=2)
    assert named(result, wanted) == (True, True)
    assert len(result.effects) == 1


def test_a_worm_is_named_by_its_teeth():
    scenario = load_scenario('german_worm')
    run = on_its_worm(night(scenario, seed=2), scenario)
    result = diagnose(run, cross_validation=False, seed=2)
    effect = result.effects[0].fitted.effect
    # 180 lines are no grating
    assert effect.name.startswith('hour_angle_periodic_error_180') and 'worm' in effect.look_at
    assert 'signals' in effect.look_at
    del run.meta['graduation']
    # so many flips, for periods have a small share of the false alarms
    found = diagnose(run, cross_validation=False, seed=2, flips=999).effects[0].fitted.effect
    assert found.name == 'hour_angle_periodic_error_180_orders_2'
    assert 'signals' not in found.look_at
