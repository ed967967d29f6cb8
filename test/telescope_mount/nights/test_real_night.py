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

"""A real mount's night: what is refused before anything is started, and which domain it is in."""

import pytest

from msg_tools.status_rows import Progress
from telescope_mount.nights.real_night import _folder, _free, run_real_night
from telescope_mount.nights.whole_night import STATE
from telescope_mount.observing.night_file import NightFile
from telescope_mount.processes import domain


def test_a_driver_that_is_no_file_is_refused(refused, tmp_path):
    assert refused('observe', '--driver', 'absent.py', '--out', tmp_path / 'o') == (
        'error: absent.py is no file; give a driver in Python with --driver')


def test_a_plan_without_a_fit_is_refused(refused, tmp_path):
    assert 'add the step fit' in refused('observe', '--plan', 'stars 3', '--out', tmp_path / 'o')


def test_the_domain_is_the_one_that_drivers_are_in(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    assert domain.join().number == 7 and domain.join(3).number == 3
    monkeypatch.delenv('ROS_DOMAIN_ID')
    assert domain.join().number == 0


@pytest.mark.parametrize('text', ['102', 'seven', '-1'])
def test_a_domain_that_is_none_is_refused(monkeypatch, text):
    monkeypatch.setenv('ROS_DOMAIN_ID', text)
    with pytest.raises(ValueError, match=f'domain {text}: must be 0 to 101'):
        domain.join()


# --- a night that was interrupted -----------------------------------------------------------------

PLAN = 'home, stars 4, fit'


@pytest.fixture
def interrupted(tmp_path):
    """The folder of a night that was killed after its second star."""
    (tmp_path / 'bag').mkdir()
    file = NightFile(tmp_path / STATE, 'altaz')
    for stamp in (1, 2):
        file.row({'stamp': stamp, 'block': 1.0})
    file.plan_state(Progress(state='observing', plan=PLAN, step='stars 4', block=1, done=2), 1, 0)
    file.close()
    return tmp_path


def test_it_goes_on_in_its_folder_and_says_where(interrupted):
    said = []
    assert _folder(interrupted, PLAN, 'altaz', False, said.append) == (interrupted, True)
    assert said == [f'the night in {interrupted} was interrupted after 2 observations: resuming '
                    'at step 2, stars 4']
    assert _free(interrupted / 'bag') == interrupted / 'bag_2'


def test_anew_keeps_what_was_there_beside(interrupted):
    said = []
    assert _folder(interrupted, 'stars 9, fit', 'altaz', True, said.append) == (interrupted, True)
    assert said == [] and not (interrupted / STATE).exists()
    assert (interrupted / f'{STATE}.before').exists()


def test_another_plan_is_no_interrupted_one(interrupted):
    with pytest.raises(ValueError, match="with the plan 'home, stars 4, fit': give that plan to"):
        _folder(interrupted, 'stars 9, fit', 'altaz', False, print)


def test_a_refused_parameter_file_leaves_it_as_it_was(interrupted, tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('mount_guard: {ros__parameters: {least_elevation_deg: 50.0}}')
    for anew in (True, False):
        with pytest.raises(ValueError, match='section mount_guard matches no node'):
            run_real_night(interrupted, plan=PLAN, params_file=path, anew=anew)
        assert (interrupted / STATE).exists()


def test_a_night_that_is_over_is_not_touched(interrupted):
    file = NightFile(interrupted / STATE, 'altaz')
    file.plan_state(Progress(state='done', plan=PLAN), 1, 0)
    file.close()
    with pytest.raises(ValueError, match='is not empty; choose another folder'):
        _folder(interrupted, PLAN, 'altaz', False, print)
