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

"""Rows by power-ons, and what is computed of many of them."""

import dataclasses
import json

import numpy as np
import pytest

from calibration.analysis.harmonic_fit import HarmonicChoice, fit_chosen
from calibration.calibration_state import CalibrationState
from calibration.report.night_document import CORRELATED
from calibration.row_table import RowTable
from pointing_model.runs.run import PointingRun
from test.calibration.test_calibration_state import night


def rows(n=3, **more):
    return PointingRun({name: np.arange(float(n)) for name in ('az', 'el', 'az_enc', 'el_enc')}
                       | {'run': np.ones(n), 'star': np.arange(n)} | more)


def test_rows_come_back_as_they_were_joined():
    rng, store, parts = np.random.default_rng(1), RowTable(), []
    for stamp in range(1, 150):
        parts.append(rows(1, star=np.array([stamp]), time=rng.normal(size=1)))
        store.add(parts[-1], stamp)
    joined = PointingRun.concatenate(parts)
    assert len(store) == 149 and {*joined.columns} < {*store.all().columns}
    for name, values in joined.columns.items():
        assert np.array_equal(store.all()[name], values)
    assert store.all()['star'].dtype == joined['star'].dtype
    assert len(store.all(until=70)) == 70 and len(store.all(until=-5)) == 149
    before = store.all()
    store.add(rows(2, star=np.array([1.5, 2.5])), 200)  # without `time`, stars with a fraction
    assert 'time' not in store.all() and store.all()['star'][-1] == 2.5
    assert len(before) == 149 and 'time' in before


def test_only_graduations_of_all_rows_hold():
    store = RowTable()
    for stamp, lines in ((1, 47200), (2, 47200), (3, 36000)):
        assert store.all().meta.get('graduation') == (47200 if stamp > 1 else None) \
            if len(store) else stamp == 1
        part = rows(1)
        part.meta['graduation'] = lines
        store.add(part, stamp)
    assert 'graduation' not in store.all().meta


def by_nights(count):
    """Rows of nights with both encoders, each to the one before alike but for noise and zero."""
    rng, parts = np.random.default_rng(3), []
    blocks = night(16, noise=0.3)
    for number in range(1, count + 1):
        part = PointingRun.concatenate(blocks[:2] if number % 2 else blocks[2:])
        columns = {**part.columns, 'run': np.full(len(part), float(number)),
                   'time': 60.0 * np.arange(len(part)) + 86400.0 * number}
        for axis, zero in zip(('az', 'el'), rng.normal(0.0, 1e-4, 2)):
            columns[f'{axis}_abs'] = columns[f'{axis}_enc'] + rng.normal(0.0, 1e-6, len(part))
            columns[f'{axis}_enc'] = columns[f'{axis}_enc'] + zero
        parts.append(PointingRun(columns, part.meta))
    return parts


@pytest.mark.usefixtures('nothing_expected')
def test_fits_of_night_after_night_are_that_of_all_at_once():
    parts, slowly, at_once = by_nights(18), CalibrationState(), CalibrationState()
    for number, part in enumerate(parts, 1):
        slowly.add(part, number)
        slowly.calibrate_zero()
        if number % 6 == 0:
            model, report = slowly.fit()
    at_once.add(PointingRun.concatenate(parts), len(parts))
    at_once.calibrate_zero()
    again, whole = at_once.fit()
    assert json.dumps(report) == json.dumps(whole)
    assert model.to_json() == again.to_json()
    assert len(report['external_check']) == 2 * 17 and len(report['changes']) == 17
    assert np.shape(report['correlations']) == (CORRELATED, CORRELATED)


@pytest.mark.usefixtures('nothing_expected')
def test_checks_are_of_the_harmonics_that_are_published(monkeypatch):
    def fit(own, degree):
        """As if that one predicted best."""
        monkeypatch.setattr(
            'calibration.night_fit.fit_chosen', lambda rows, choice, *rest: fit_chosen(
                rows, dataclasses.replace(choice, degree=degree), *rest))
        return own.fit()[1]['external_check']
    parts = PointingRun.concatenate(by_nights(2))
    whole, changed = (CalibrationState(harmonics=HarmonicChoice('zenith')) for _ in range(2))
    for own in (whole, changed):
        own.add(parts, 1)
        own.calibrate_zero()
    first = fit(changed, 1)
    assert fit(changed, 2) == fit(whole, 2) != first
