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

"""A kind of mount is an entry of one table, and its joints one in messages: no other change."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.term_fit import fit_terms
from calibration.report.figure_wording import model_words
from encoder_reading.frame_reader_node import PARAMS, axes_of
from encoder_sim.scenario import Scenario
from msg_tools.convert import JOINTS, joint_state, read_joints
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.model import PointingModel
from pointing_model.mount_kinds import KINDS
from pointing_model.mount_shape import urdf
from pointing_model.mounts import mount_text, parse_mount
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run
from pointing_model.sky.places import observed_place
from pointing_model.sky.star_catalogue import load_catalogue
from telescope_mount.graph import night_graph
from telescope_mount.guard.limits import travel_of
from telescope_mount.observing.star_choice import choose_stars

#: its first axis lies to the north
ALT_ALT = replace(KINDS['free'], words='an alt-alt mount', axes=('roll', 'pitch'),
                  shafts=('roll axis', 'pitch axis'), pole=(0.0, 0.0),
                  travel_deg=((-85.0, 85.0), (-80.0, 80.0)))


@pytest.fixture
def mount(monkeypatch):
    monkeypatch.setitem(KINDS, 'rollpitch', ALT_ALT)
    monkeypatch.setitem(JOINTS, 'rollpitch', ALT_ALT.keys)
    return parse_mount('rollpitch')


def night(mount, n=60, **terms):
    rng = np.random.default_rng(7)
    az, el = rng.uniform(-np.pi, np.pi, 4 * n), np.arcsin(rng.uniform(0.4, 1.0, 4 * n))
    first, second = (v[:n] for v in np.array(mount.axes_of(az, el))[
        :, np.abs(mount.axes_of(az, el)[1]) < 70.0 * DEG])
    truth = PointingModel({name: value * ARCSEC for name, value in terms.items()}, mount=mount)
    x, y = rng.normal(size=(2, n)) * ARCSEC
    a, e = truth.sky_to_encoder(first, second)
    return PointingRun({'az': first, 'el': second, 'az_enc': a + x / np.cos(second),
                        'el_enc': e + y, 'time': 1.7e9 + 60.0 * np.arange(n)}, {'mount': mount})


def test_it_points_to_where_its_axes_say(mount):
    assert mount_text(mount) == 'rollpitch' and parse_mount('rollpitch').agrees(mount)
    zenith = mount.horizon_of(0.0, 0.0)
    assert zenith[1] == pytest.approx(0.5 * np.pi)
    az, el = mount.horizon_of(0.0, 30.0 * DEG)  # toward the pole of its first axis
    assert wrap(az) == pytest.approx(0.0, abs=1e-12) and el == pytest.approx(60.0 * DEG)


def test_a_run_is_fitted_diagnosed_written_and_read(mount, tmp_path):
    truth = {'I1': 100.0, 'I2': -50.0, 'C1': 30.0, 'N12': -20.0, 'T1': 40.0, 'T2': 25.0, 'TF': 15.0}
    run = night(mount, **truth)
    fit = fit_terms(run)
    for name, value, sigma in zip(fit.names, fit.coefficients, fit.sigma):
        assert abs(value - truth[name] * ARCSEC) < 4.0 * sigma
    again = PointingModel.from_json(fit.model.to_json())
    assert again.mount.agrees(mount) and again.mount.kind == 'rollpitch'
    document = diagnose(run, cross_validation=False, flips=199).to_dict()
    assert document['mount'] == 'rollpitch' and document['mount_axes'] == ['roll', 'pitch']
    assert model_words(document) == 'the seven terms of an alt-alt mount'
    write_csv(run, tmp_path / 'run.csv')
    back = read_run(tmp_path / 'run.csv')
    assert back.mount.agrees(mount)
    np.testing.assert_allclose(back['az_enc'], run['az_enc'], atol=1e-9)


def test_guard_stars_and_picture_know_it(mount):
    assert travel_of(mount) == ALT_ALT.travel_deg
    assert '<robot' in urdf(mount)
    stars = load_catalogue(mag_limit=4.0)
    rows = choose_stars(stars, 1.768e9, n=8, mount=mount)
    az, el = observed_place(stars.select(rows), 1.768e9)
    assert (np.abs(mount.axes_of(az, el)[1]) < 85.0 * DEG).all()
    night = {spec.name: spec.parameters for spec in night_graph(bag='bag', mount='rollpitch')}
    assert night['star_observer']['mount'] == night['mount_guard']['mount'] == 'rollpitch'


def test_simulator_readers_and_messages_know_it(mount):
    axes = Scenario().on_mount('rollpitch').axes
    travel = [(axis.travel_min, axis.travel_max) for axis in (axes.azimuth, axes.elevation)]
    np.testing.assert_allclose(travel, np.radians(ALT_ALT.travel_deg))
    message = joint_state(0, (0.1, 0.2), names=ALT_ALT.keys)
    message.name, message.position = message.name[::-1], message.position[::-1]
    assert read_joints(message)[1] == pytest.approx((0.1, 0.2))
    readers = axes_of({**{param.name: param.default for param in PARAMS}, 'mount': 'rollpitch'})
    assert [reader.axis for reader in readers] == ['roll', 'pitch']
