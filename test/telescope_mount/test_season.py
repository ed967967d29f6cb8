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

"""The command `season`."""

import json
from datetime import datetime, timedelta

import numpy as np
import pytest

from calibration.analysis.diagnosis.mistaken_columns import ColumnCheck
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run

TERMS = {'IA': 300.0, 'IE': -120.0, 'CA': 40.0, 'NPAE': 5.0, 'AN': 10.0, 'AW': -7.0, 'TF': 30.0}


@pytest.fixture
def folder(tmp_path):
    """Twelve nights; the axis was levelled before the seventh."""
    out = tmp_path / 'runs'
    out.mkdir()
    for i in range(12):
        rng = np.random.default_rng([23, i])
        az, el = rng.uniform(0.0, 2.0 * np.pi, 40), rng.uniform(0.3, 1.4, 40)
        own = {**TERMS, 'AN': TERMS['AN'] + (25.0 if i >= 6 else 0.0)}
        own = {name: (v + rng.normal()) * ARCSEC for name, v in own.items()}
        az_enc, el_enc = PointingModel(own).sky_to_encoder(az, el)
        x, y = rng.normal(size=(2, 40)) * ARCSEC
        date = datetime(2026, 1, 1) + timedelta(days=9 * i)
        write_csv(PointingRun({'az': az, 'el': el, 'az_enc': az_enc + x / np.cos(el),
                               'el_enc': el_enc + y}), out / f'run_{date:%Y-%m-%d}.csv')
    return out


def test_a_folder_of_runs_becomes_a_page_a_result_and_the_model_of_tonight(ended, folder):
    page, result, model = (folder.parent / name for name in ('s.html', 's.json', 'm.json'))
    code, out, err = ended('season', folder, '--report', page, '--json', result, '--save', model,
                           '--tonight', '2026-04-20')
    assert (code, err) == (0, '')
    assert 'AN by +2' in out and 'between 2026-02-15 and 2026-02-24: what was done' in out
    document = json.loads(result.read_text())
    assert [entry['kind'] for entry in document['causes']] == ['step']
    foretold = PointingModel.load(model)
    assert foretold.terms['AN'] / ARCSEC == pytest.approx(35.0, abs=3.0)
    assert np.sqrt(foretold.covariance[4, 4]) / ARCSEC == pytest.approx(1.0, rel=0.8)
    assert 'Predicted terms for 2026-04-20' in page.read_text()
    declared = ended('season', folder, '--since', '2026-02-20=axis levelled')[1]
    assert 'axis levelled: AN by +2' in declared


def test_season_and_track_say_what_columns_may_be_mistaken_for(ended, folder, monkeypatch):
    """Of a season once, if it is so of all nights."""
    out = 'azimuth of catalogue and encoders in hours'

    def checked(run):
        return ColumnCheck([out], ['the clock of one night'])
    monkeypatch.setattr('calibration.analysis.season.season_nights.check_columns', checked)
    said = ' '.join(ended('season', folder, '--verbose')[1].split())
    assert said.count(f'fits equally well. Check: {out}') == 1
    assert said.count('note: the clock of one night') == 12
    monkeypatch.setattr('calibration.analysis.tracking.run_track.check_columns', checked)
    run = read_run(next(folder.iterdir()))
    run.columns['time'] = 1.8e9 + 60.0 * np.arange(len(run))
    write_csv(run, folder / 'timed.csv')
    code, text, _ = ended('track', folder / 'timed.csv')
    said = ' '.join(text.split())
    assert code == 0 and f'Check: {out}' in said and 'note: the clock of one night' in said


def test_a_season_says_what_it_wants(refused, folder):
    assert "'yesterday' is no date" in refused('season', folder, '--tonight', 'yesterday')
    assert "'warm' is no number" in refused('season', folder, '--tonight', 'temperature=warm')
    assert 'no night has a column wind' in refused('season', folder, '--tonight', 'wind=3')
    assert 'a season takes three' in refused('season', next(folder.iterdir()))
    (folder.parent / 'empty').mkdir()
    assert 'empty: name pointing runs' in refused('season', folder.parent / 'empty')
