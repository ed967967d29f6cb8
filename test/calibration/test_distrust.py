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

"""Observations that an instrument falsified, and models that they would make."""

import numpy as np
import pytest

from calibration.calibration_state import CalibrationState
from calibration.distrust import contradiction, distrusted, notes_of, reasons
from calibration.rows import for_fitting
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun
from pointing_model.sky.star_catalogue import POLARIS_HIP

MOUNT = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)))


def night(stars=40, polaris=8, frozen=slice(0, 0), seed=3):
    """Rows as an observer takes them; a frozen camera finds every star where it was looked for."""
    rng = np.random.default_rng(seed)
    n = stars + polaris
    az, el = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))
    az[stars:], el[stars:] = 0.4 * DEG + 1e-4 * np.arange(polaris), 34.9 * DEG
    az_enc, el_enc = MOUNT.sky_to_encoder(az, el)
    x, y = rng.normal(size=(2, n)) * ARCSEC
    miss = rng.normal(size=(2, n)) * ARCSEC
    x[frozen], y[frozen], miss[:, frozen] = 25.0 * ARCSEC, -30.0 * ARCSEC, 0.0
    return PointingRun({
        'az': az, 'el': el, 'az_enc': az_enc + x / np.cos(el), 'el_enc': el_enc + y,
        'miss_x': miss[0], 'miss_y': miss[1], 'run': np.ones(n), 'time': 1e9 + 30.0 * np.arange(n),
        'encoder_start': np.full(n, 1e9),
        'star': np.append(np.arange(stars) + 1.0, np.full(polaris, float(POLARIS_HIP)))})


def session(rows):
    out = CalibrationState()
    out.add(rows, 10**9)
    return out


def off(model, zeros):
    """How far model and zero are off over the sky, arcsec."""
    az, el = np.linspace(0.0, 6.0, 30), np.linspace(0.5, 1.2, 30)
    pointed = np.column_stack(model.sky_to_encoder(az, el)) + zeros.newest.angles
    wrong = pointed - np.column_stack(MOUNT.sky_to_encoder(az, el))
    return float(np.hypot(wrong[:, 0] * np.cos(el), wrong[:, 1]).max()) / ARCSEC


def test_a_night_without_lies_is_taken_as_it_is():
    rows = night()
    assert not distrusted(rows).any() and reasons(rows) == []
    assert len(for_fitting(rows)) == len(rows)
    lying = night(frozen=slice(0, 48))
    assert distrusted(lying).all()
    # in a file zeros may stand for what was not measured
    for left_out in ('miss_x', 'encoder_start'):
        columns = {n: v for n, v in lying.columns.items() if n != left_out}
        assert not distrusted(PointingRun(columns)).any()
    assert contradiction(rows) == ''


def test_what_a_frozen_camera_found_is_in_no_zero_and_no_model():
    rows = night(frozen=slice(28, 42))
    made = session(rows)
    made.calibrate_zero()
    assert made.zeros[1].n == 6  # of eight exposures
    model, report = made.fit()
    assert report['stars'] == 28 and report['notes'][0] == reasons(rows)[0]
    assert 'rows 28 to 41' in report['notes'][0]
    assert off(model, made.active_zeros) < 3.0


def test_polaris_through_a_frozen_camera_gives_no_zero_and_the_reason():
    with pytest.raises(ValueError, match='Polaris was not observed.*8 of 48 observations left out'):
        session(night(frozen=slice(40, 48))).calibrate_zero()


def test_a_camera_that_measured_nothing_for_a_third_of_the_night_gives_no_model():
    rows = night(frozen=slice(10, 30))
    why = contradiction(rows)
    assert why.startswith('not published: 20 of 48 observations left out')
    assert '\n' not in why


@pytest.mark.parametrize('alarms, held_out, refused', [
    ([], 900.0, False), (['the encoder moved'], 5.0, False), (['the encoder moved'], 900.0, True)])
def test_a_model_that_its_alarms_contradict_is_not_published(alarms, held_out, refused):
    report = {'steps': [{'held_out': {'radial': held_out}}], 'noise_arcsec': [1.0, 1.0],
              'witnesses': {'alarms': alarms}}
    why = contradiction(night(), report)
    assert bool(why) == refused
    if refused:
        assert '900 arcsec on stars held out' in why and alarms[0] in why


@pytest.mark.parametrize('noise, told', [(0.0, False), (0.02, True), (0.1, True), (1.0, False)])
def test_a_camera_that_says_about_the_same_is_told_and_no_other(noise, told):
    rows = night(stars=60)
    rng = np.random.default_rng(5)
    lying = PointingRun({**rows.columns, 'miss_x': noise * ARCSEC * rng.normal(size=len(rows)),
                         'miss_y': noise * ARCSEC * rng.normal(size=len(rows))})
    said = [note for note in notes_of(lying) if 'check that the camera measures' in note]
    assert bool(said) == told
    if noise == 0.0:  # these rows are left out altogether
        assert notes_of(lying) == reasons(lying) != []
    if noise == 0.1:
        assert notes_of(rows) == []
        assert said[0] in session(lying).fit()[1]['notes']


def test_a_rotated_camera_is_noted_with_its_angle_and_no_other():
    for seed in range(5):
        rows, rng = night(stars=30, seed=seed), np.random.default_rng(seed)
        miss = 25.0 * ARCSEC * rng.normal(size=(2, len(rows)))
        rows.columns['miss_x'], rows.columns['miss_y'] = miss
        assert notes_of(rows) == []
        cosine, sine = np.cos(12.0 * DEG), np.sin(12.0 * DEG)
        wrong = miss - np.array([[cosine, sine], [-sine, cosine]]) @ miss  # of a star at R^-1 m
        rows['az_enc'][:] += wrong[0] / np.cos(rows['el'])
        rows['el_enc'][:] += wrong[1]
        note, = notes_of(rows)
        angle, sigma = (float(note.split(before)[1].split()[0]) for before in ('by ', '± '))
        assert abs(angle - 12.0) < 4.0 * sigma < 4.0


# --- a camera that is turned amid the night ------------------------------------------------------


def carried(camera, since, stars=34, seed=0):
    """Rows of an observer that carries what a star showed to the next; stars not centred fail."""
    rng, rows, aim, camera = np.random.default_rng(seed), [], np.zeros(2), np.array(camera, float)
    for _ in range(4 * stars):
        az, el = rng.uniform(0, 2 * np.pi), np.arcsin(rng.uniform(0.35, 0.98))
        sky = np.array([np.cos(el), 1.0])
        place = np.ravel(MOUNT.sky_to_encoder(az, el))  # pointed by a model that knows it
        off = 2.0 * ARCSEC * rng.normal(size=2) / sky - aim
        turn = camera if len(rows) >= since else np.eye(2)
        miss = turn @ (off * sky) + 0.5 * ARCSEC * rng.normal(size=2)
        if np.hypot(*miss) > 60.0 * ARCSEC:
            aim = np.zeros(2)  # it is centred, and farther off than before
            continue
        rows.append([az, el, *(place + aim + miss / sky), *miss, 1e9 + 30.0 * len(rows)])
        aim = aim + miss / sky
        if len(rows) == stars:
            break
    columns = dict(zip(('az', 'el', 'az_enc', 'el_enc', 'miss_x', 'miss_y', 'time'),
                       np.array(rows).T))
    n = len(rows)
    return PointingRun(columns | {'run': np.ones(n), 'encoder_start': np.full(n, 1e9),
                                  'star': np.arange(n) + 1.0})


@pytest.mark.parametrize('camera, sense', [
    ([[-1, 0], [0, 1]], 'x mirrored'), ([[1, 0], [0, -1]], 'y mirrored'),
    ([[-1, 0], [0, -1]], 'x and y mirrored'), ([[0, 1], [1, 0]], 'x and y exchanged')])
def test_rows_of_a_camera_that_was_turned_are_in_no_fit_and_those_before_are(camera, sense):
    since, kept, taken, named, worst = 24, 0, 0, 0, []
    for seed in range(8):
        rows = carried(camera, since, stars=30, seed=seed)
        bad = distrusted(rows)
        taken += bad[:since].sum()
        kept += bad[since:].sum()
        named += any(sense in text for text in reasons(rows))
        lies = (np.eye(2) - np.linalg.inv(camera)) @ np.stack((rows['miss_x'], rows['miss_y']))
        worst += list(np.hypot(*lies)[since:][~bad[since:]] / ARCSEC)
    assert named >= 7 and taken <= 8 and kept >= 0.75 * 8 * 6
    assert max(worst) < 15.0  # 5 sigma of the stars, which a robust fit weighs down


def test_no_row_of_a_sound_camera_is_distrusted():
    for seed in range(20):
        assert not distrusted(carried(np.eye(2), 0, stars=40, seed=seed)).any()
