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

"""What a Python program imports gives what the commands print, in the units that its names say."""

import json
import subprocess
import sys

import numpy as np
import pytest
from places import ROOT

from telescope_mount import apply, diagnose, fit, read_run

MMT = ROOT / 'calibration' / 'data' / 'mmt_2021-08-21.csv'
LOG = ROOT / 'test' / 'data' / 'sample_log'
ROS = ('rclpy', 'builtin_interfaces', 'rcl_interfaces', 'std_msgs', 'sensor_msgs', 'geometry_msgs',
       'diagnostic_msgs', 'trajectory_msgs', 'std_srvs', 'rosgraph_msgs')
NOTEBOOK = ROOT / 'examples' / 'pointing_run.ipynb'


@pytest.fixture(scope='module')
def notebook():
    """The names that the notebook's code has in the end, run as it stands, and what it draws."""
    import matplotlib
    matplotlib.use('Agg')
    from matplotlib import pyplot
    cells = json.loads(NOTEBOOK.read_text(encoding='utf-8'))['cells']
    names = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(NOTEBOOK.parent)  # as Jupyter runs it
        for cell in cells:
            if cell['cell_type'] == 'code':
                exec(compile(''.join(cell['source']), f'cell {cell["id"]}', 'exec'), names)
    yield names
    pyplot.close('all')


def test_every_folder_of_modules_is_installed():
    """`pip install .` takes packages alone."""
    from setuptools import find_packages
    parts = ('encoder_sim', 'encoder_reading', 'pointing_model', 'calibration', 'msg_tools',
             'telescope_mount')
    folders = {str(path.parent.relative_to(ROOT)).replace('/', '.')
               for part in parts for path in (ROOT / part).rglob('*.py')}
    assert folders == set(find_packages(str(ROOT), include=[f'{part}*' for part in parts]))


def test_to_import_the_package_is_light():
    """Nodes import it, and need neither the fits nor the catalogue."""
    code = ('import sys, telescope_mount\n'
            'print([m for m in ("numpy", "calibration", "pointing_model", "rclpy") '
            'if m in sys.modules], "fit" in dir(telescope_mount))')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout.strip() == '[] True', done.stderr


def test_what_needs_no_ros_asks_for_none(tmp_path):
    """Neither rclpy nor a message is imported on the way from a file or a log to what is found."""
    code = f"""
import sys
class NoRos:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {ROS!r}:
            raise ModuleNotFoundError("no ROS here: " + name)
sys.meta_path.insert(0, NoRos())
from telescope_mount import api, cli, read_run
print(len(read_run({str(MMT)!r})))
from calibration.analysis.diagnosis import alternatives, diagnosis, offered_effects
diagnosis.diagnose.__kwdefaults__["cross_validation"] = False  # most of its time
alternatives.MOST_TRIED, offered_effects.smooths = 0, lambda context: []
codes = []
for command in (["fit", {str(LOG)!r}], ["info", {str(LOG)!r}],
                ["export", {str(LOG)!r}, {str(tmp_path / 'rows.csv')!r}],
                ["diagnose", {str(tmp_path / 'rows.csv')!r}],
                ["track", {str(MMT)!r}]):
    codes.append(cli.main(command))
print(codes)
"""
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout.startswith('80\n'), done.stderr
    assert done.stdout.splitlines()[-1] == '[0, 0, 0, 0, 0]', done.stderr


def test_a_name_that_is_not_there():
    import telescope_mount
    with pytest.raises(AttributeError, match='no attribute'):
        telescope_mount.fitt  # noqa: B018
    with pytest.raises(KeyError, match='no column az; the run has .*az_deg'):
        read_run(MMT)['az']


def test_columns_have_the_units_of_the_file():
    run = read_run(MMT)
    header, first = (line.split(',') for line in MMT.read_text().splitlines()[:2])
    for name in ('az_deg', 'el_deg', 'el_enc_deg', 'magnitude'):
        assert run[name][0] == pytest.approx(float(first[header.index(name)]), abs=1e-9)
    assert set(header) <= set(run.names)
    assert run['el_deg'] / np.degrees(run.rows['el']) == pytest.approx(1.0)
    assert len(run.select(run['el_deg'] > 60.0)) == np.count_nonzero(run['el_deg'] > 60.0)


@pytest.mark.parametrize('options', [(), ('--terms', 'IA,IE,AN,AW', '--no-robust')])
def test_a_fit_is_that_of_the_command(ended, tmp_path, options):
    code, _, _ = ended('fit', str(MMT), '--json', str(tmp_path / 'fit.json'), '--save',
                       str(tmp_path / 'model.json'), *options)
    fitted = fit(MMT, ['IA', 'IE', 'AN', 'AW'], robust=False) if options else fit(read_run(MMT))
    assert code == 0
    assert json.loads(json.dumps(fitted.document)) == json.loads(
        (tmp_path / 'fit.json').read_text())
    fitted.save(tmp_path / 'again.json')
    ours, theirs = (json.loads((tmp_path / f'{name}.json').read_text())
                    for name in ('again', 'model'))
    assert ours['terms'] == theirs['terms']
    assert fitted.rms_arcsec == pytest.approx(
        np.sqrt(np.mean(np.square(fitted.residuals_arcsec[:, fitted.used]).sum(axis=0))))


def test_the_notebook_says_what_it_should(notebook):
    """Twelve lines that read, fit, diagnose, plot and apply."""
    cells = json.loads(NOTEBOOK.read_text(encoding='utf-8'))
    lines = [line for cell in cells['cells'] if cell['cell_type'] == 'code'
             for line in ''.join(cell['source']).splitlines()]
    assert cells['nbformat'] == 4 and len({cell['id'] for cell in cells['cells']}) == 8
    assert not any(cell.get('outputs') for cell in cells['cells'])
    assert len([line for line in lines if line not in ('', 'fitted', 'found')]) <= 12
    fitted, found = notebook['fitted'], notebook['found']
    assert fitted.terms_arcsec['IA'] == pytest.approx(1209.15, abs=0.01)
    assert 'IA   +1209.15' in repr(fitted) and '80 of 80 rows' in repr(fitted)
    assert found.effects[0]['name'] == 'refraction_cube'
    assert 'One effect beyond the seven terms' in repr(found)
    for panel, left in zip(notebook['panels'], (fitted.residuals_arcsec,
                                                found.residuals_after_arcsec)):
        assert pytest.approx(left) == panel.lines[0].get_xydata().T
    assert found.rms_after_arcsec < found.rms_before_arcsec < 1.5
    assert notebook['az_enc_deg'] == pytest.approx(120.0 + 1209.15 / 3600.0, abs=0.01)


def test_a_model_is_applied_back_and_forth(notebook, tmp_path):
    found = notebook['found']
    found.save(tmp_path / 'model.json')
    there = apply(tmp_path / 'model.json', [10.0, 200.0], 40.0)
    assert there == pytest.approx(np.array(apply(found, [10.0, 200.0], 40.0)), abs=1e-12)
    back = apply(found, *there, reverse=True)
    assert back == pytest.approx(np.array([[10.0, 200.0], [40.0, 40.0]]), abs=1e-9)


@pytest.mark.usefixtures('short_diagnosis')
def test_a_diagnosis_is_that_of_the_command(ended, tmp_path):
    found = diagnose(MMT)
    code, _, _ = ended('diagnose', str(MMT), '--json', str(tmp_path / 'found.json'))
    assert code == 0
    assert json.loads(json.dumps(found.document)) == json.loads(
        (tmp_path / 'found.json').read_text())
    found.write_page(tmp_path / 'page.html')
    assert '</html>' in (tmp_path / 'page.html').read_text(encoding='utf-8')
    kept = found.residuals_after_arcsec[:, found.used]
    assert found.rms_after_arcsec == pytest.approx(np.sqrt(np.mean(np.sum(kept**2, axis=0))))


@pytest.mark.usefixtures('short_diagnosis')
def test_several_runs_and_a_holdout():
    """Of one mount, as paths or as runs; what is held out is judged."""
    rows = read_run(MMT)
    odd = np.arange(len(rows)) % 2 == 1
    found = diagnose([rows.select(~odd)], 'index', holdout=rows.select(odd))
    assert found.document['after']['holdout_rms_arcsec'] < 12.0
    assert len(found.az_deg) == 40 and found.el_deg.max() < 90.0


def test_what_is_wrong_is_one_line(tmp_path):
    path = tmp_path / 'short.csv'
    path.write_text('az_deg,el_deg,az_enc_deg,el_enc_deg\n1,2,3,4\n')
    with pytest.raises(ValueError) as error:
        fit(path)
    assert '\n' not in str(error.value)
    with pytest.raises(ValueError, match='latitude'):
        read_run(MMT, latitude_deg=91.0, longitude_deg=0.0, height_m=0.0)
    assert read_run(MMT, latitude_deg='31.7').rows.meta['site']['latitude'] == np.radians(31.7)
    with pytest.raises(ValueError, match='ndarray is no run: give what read_run returns'):
        fit(np.zeros((4, 5)))
    with pytest.raises(ValueError, match='no run is given'):
        diagnose([])
