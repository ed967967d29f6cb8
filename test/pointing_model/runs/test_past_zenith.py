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

"""An alt-azimuth mount beyond its zenith: the geometry, files, fit, model and export."""


import numpy as np
import pytest
from exact_rotations import LARGE, forward_by_matrices, offsets_and_jacobian
from places import CASES

from calibration.analysis.diagnosis.mistaken_columns import (
    MistakenColumns,
    check_columns,
)
from calibration.analysis.solve_check import check_solves
from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model import geometry
from pointing_model import model_application as apply
from pointing_model.context import Context
from pointing_model.model import PointingModel
from pointing_model.mount_kinds import CANONICAL
from pointing_model.mounts import ALTAZ, Mount, is_beyond, through_pole
from pointing_model.pointing_terms import design
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run
from pointing_model.sky.places import observed_to_icrs
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site
from telescope_mount.input_files.run_loader import load_run

TRUE = dict(zip(ALTAZ.names.physical, (120.0, -40.0, 15.0, -8.0, 20.0, 12.0, 25.0)))
HEAD = 'az_deg,el_deg,az_enc_deg,el_enc_deg\n'


def beyond_zenith(n=60, seed=1, noise=0.5, part=0.3, terms=TRUE):
    """A run of exact rotations by matrices of which some rows are beyond the zenith."""
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0.0, 2.0 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.98, n))
    first, second = through_pole(az, el, rng.random(n) < part)
    az_enc, el_enc = geometry.sky_to_encoder(first, second,
                                             {k: v * ARCSEC for k, v in terms.items()})
    az_enc = az_enc + rng.normal(0.0, noise, n) * ARCSEC / np.abs(np.cos(el))
    return PointingRun({'az': first, 'el': second, 'az_enc': az_enc,
                        'el_enc': el_enc + rng.normal(0.0, noise, n) * ARCSEC})


def written(path, run, fold=False):
    """As a file: places on the sky, readings as the axes have them, or folded back."""
    az, el = through_pole(run['az'], run['el'], is_beyond(run['el']))
    el_enc = np.where(is_beyond(run['el_enc']) & fold, np.pi - run['el_enc'], run['el_enc'])
    path.write_text(HEAD + '\n'.join(','.join(f'{v:.9f}' for v in row) for row in zip(
        *(np.array(c) / DEG for c in (np.mod(az, 2 * np.pi), el, run['az_enc'], el_enc)))))
    return path


def right(result):
    off = [result.model.terms[name] / ARCSEC - TRUE[name] for name in TRUE]
    return bool(np.all(np.abs(off) < 4.0 * result.sigma / ARCSEC)) and result.rms_arcsec(
        ).radial < 1.0


def test_readings_beyond_the_zenith_are_those_of_rotation_matrices():
    rng = np.random.default_rng(2)
    az, el = rng.uniform(-3.0, 3.0, 200), rng.uniform(0.2, np.pi - 0.2, 200)
    az_enc, el_enc = geometry.sky_to_encoder(az, el, LARGE)
    # gravity pulls the tube down on the sky, on either side of the zenith
    star = ALTAZ.direction(az, el + LARGE['TF'] * np.cos(el)).T
    assert np.ptp(np.sign(np.cos(el_enc))) == 2.0 and np.abs(el_enc - el).max() < 0.01
    for i in range(200):
        sight = forward_by_matrices(az_enc[i] - LARGE['IA'], el_enc[i] - LARGE['IE'], LARGE)
        assert np.linalg.norm(sight - star[i]) < 1e-9 * ARCSEC + 5e-15


@pytest.mark.parametrize('added', [None, lambda az, el: (1e-4 * np.sin(az), 2e-4 * np.sin(el))])
def test_a_reading_beyond_the_zenith_is_of_the_place_on_the_sky(added):
    rng = np.random.default_rng(3)
    az, el = rng.uniform(-3.0, 3.0, 100), rng.uniform(0.2, np.pi - 0.2, 100)
    reading = np.array(geometry.sky_to_encoder(az, el, LARGE))
    if added is not None:
        reading += added(az, el)
    back = geometry.encoder_to_sky(*reading, LARGE, added)
    assert np.linalg.norm(ALTAZ.direction(*back) - ALTAZ.direction(az, el),
                          axis=0).max() < 1e-6 * ARCSEC
    assert not is_beyond(back[1]).any()


def test_columns_and_derivatives_beyond_the_zenith_are_the_differences():
    rng = np.random.default_rng(4)
    az, el = rng.uniform(-3.0, 3.0, 50), rng.uniform(0.55 * np.pi, 0.8 * np.pi, 50)
    x, y, jacobian = offsets_and_jacobian(az, el, LARGE, CANONICAL)
    first = design(CANONICAL, az, el)
    for i, name in enumerate(CANONICAL):
        h = 1e-5
        more, less = (geometry.offsets(az, el, {**LARGE, name: LARGE[name] + s * h})
                      for s in (1, -1))
        plain = geometry.offsets(az, el, {name: h})
        for k in range(2):
            np.testing.assert_allclose(np.broadcast_to(jacobian[name][k], 50),
                                       (more[k] - less[k]) / (2 * h),
                                       atol=4e-3 if name == 'TF' else 1e-5)  # of first order
            np.testing.assert_allclose(first[k][:, i], plain[k] / h, atol=1e-4)


@pytest.mark.parametrize('fold', [False, True])
def test_files_with_rows_beyond_the_zenith_give_the_true_terms(tmp_path, fold):
    run = read_run(written(tmp_path / 'run.csv', beyond_zenith(), fold))
    assert np.array_equal(is_beyond(run['el']), is_beyond(beyond_zenith()['el']))
    assert any('rows are beyond the zenith' in note for note in run.meta['notes'])
    assert right(fit_terms(run))
    check_columns(run)
    check_columns(PointingRun(run.columns))  # as from elsewhere than a file
    write_csv(run, tmp_path / 'again.csv')
    again = read_run(tmp_path / 'again.csv')
    np.testing.assert_allclose(again.offsets(), run.offsets(), atol=1e-12)


def test_all_rows_beyond_the_zenith_are_read_too(tmp_path):
    run = read_run(written(tmp_path / 'run.csv', beyond_zenith(part=1.0)))
    assert is_beyond(run['el']).all() and right(fit_terms(run))
    check_columns(run)


def test_an_ordinary_reading_beyond_90_degrees_stays_on_this_side(tmp_path):
    path = tmp_path / 'run.csv'
    path.write_text(HEAD + '10,89.9,10.01,90.2\n40,50,40.01,50.3\n100,30,100.01,30.3\n')
    assert read_run(path)['el_enc'][0] == pytest.approx(90.2 * DEG)
    assert not is_beyond(read_run(path)['el']).any()


@pytest.mark.parametrize('mistake', [
    lambda a, e: (e, a), lambda a, e: (a, np.pi / 2 - e), lambda a, e: (-a, e)])
def test_columns_that_are_no_such_angles_are_refused_as_before(tmp_path, mistake):
    run = beyond_zenith(part=0.0)
    for pair in (('az_enc', 'el_enc'), ('az', 'el')):
        wrong = PointingRun({**run.columns, **dict(zip(pair, mistake(*(run[n] for n in pair))))})
        path = tmp_path / 'run.csv'
        path.write_text(HEAD + '\n'.join(','.join(f'{v / DEG:.9f}' for v in row) for row in zip(
            *(wrong[n] for n in ('az', 'el', 'az_enc', 'el_enc')))))
        with pytest.raises((MistakenColumns, ValueError)):
            check_columns(read_run(path))


def test_the_frame_of_stars_is_judged_with_rows_beyond_the_zenith_as_such(tmp_path):
    run, path = beyond_zenith(part=0.4), tmp_path / 'run.csv'
    time = 1.77e9 + 100.0 * np.arange(len(run))
    sky = through_pole(run['az'], run['el'], is_beyond(run['el']))
    ra, dec = observed_to_icrs(*sky, time, Site(0.6, 1.0, 500.0), Weather(955.0, 8.0))
    path.write_text('# latitude_deg: 34.37746771\n# longitude_deg: 57.29577951\n# height_m: 500\n'
                    '# pressure_hpa: 955\n# temperature_c: 8\n'
                    'time,ra_deg,dec_deg,az_enc_deg,el_enc_deg\n' + '\n'.join(
                        ','.join(f'{v:.8f}' for v in row) for row in zip(time, *(
                            v / DEG for v in (ra, dec, run['az_enc'], run['el_enc'])))))
    judged = check_solves(read_run(path))
    assert any(note.kind == 'frame taken' and note.causes[0] == 'ICRS' and note.before < 1.0
               for note in judged.meta['notes'] if not isinstance(note, str))
    assert right(fit_terms(judged))


@pytest.mark.parametrize('said, mistake, pairs', [
    ('azimuth and elevation of catalogue and encoders in gradians',
     lambda a, e: (a / 0.9, e / 0.9), (0, 2)),
    ('azimuth of catalogue and encoders in hours', lambda a, e: (a / 15.0, e), (0, 2)),
    ('zenith distance in place of the elevation of catalogue and encoders',
     lambda a, e: (a, 90.0 - e), (0, 2)),
    ('zenith distance in place of the elevation of the encoders', lambda a, e: (a, 90.0 - e), (2,)),
    ('elevation of the encoders with the other sign', lambda a, e: (a, -e), (2,)),
    ('mount and catalogue exchanged', None, ())])
@pytest.mark.parametrize('part', [0.3, 0.6])
def test_columns_of_a_mount_beyond_the_zenith_are_named_for_what_they_are(
        tmp_path, said, mistake, pairs, part):
    """Judged as the run as written is, with its rows beyond the zenith as such."""
    path = written(tmp_path / 'run.csv', beyond_zenith(40, 4, part=part, noise=5.0))
    columns = np.loadtxt(path, delimiter=',', skiprows=1).T
    for pair in pairs:
        columns[pair:pair + 2] = mistake(np.remainder(columns[pair], 360.0), columns[pair + 1])
    columns = columns if mistake else columns[[2, 3, 0, 1]]
    np.savetxt(path, columns.T, '%.9f', ',', header=HEAD.strip(), comments='')
    with pytest.raises(MistakenColumns, match=said):
        check_columns(load_run(path))


def test_a_model_is_applied_beyond_the_zenith():
    model = PointingModel({name: v * ARCSEC for name, v in TRUE.items()})
    run = beyond_zenith(noise=0.0)
    az, el = apply.apply(model, run['az'] / DEG, run['el'] / DEG)
    np.testing.assert_allclose((az, el), (run['az_enc'] / DEG, run['el_enc'] / DEG), atol=1e-9)
    az, el = apply.apply(model, az, el, reverse=True)
    place = through_pole(run['az'], run['el'], is_beyond(run['el']))
    assert np.abs(wrap(az * DEG - place[0])).max() < 1e-11 and np.abs(el * DEG - place[1]).max(
        ) < 1e-11


def test_what_follows_the_sky_knows_no_side():
    run = beyond_zenith()
    context = Context.from_run(run)
    place = through_pole(run['az'], run['el'], is_beyond(run['el']))
    az, el = context.on_horizon()
    np.testing.assert_allclose(el, place[1], atol=1e-12)
    assert np.abs(wrap(az - place[0])).max() < 1e-12
    assert set(context.get('pier_side')) == {-1.0, 1.0}
    assert Context.from_run(beyond_zenith(part=0.0)).get('pier_side') is None


def test_it_is_the_same_mount_as_one_in_a_free_frame():
    run = beyond_zenith()
    free = PointingRun(run.columns, {'mount': Mount.free(0.0, 0.5 * np.pi, np.pi)})
    one, other = fit_terms(run), fit_terms(free)
    signs = dict(zip(ALTAZ.names.physical, free.mount.names.physical))
    for name, theirs in signs.items():
        assert abs(one.model.terms[name] - other.model.terms[theirs]) < (
            0.01 if name[0] != 'I' else 0.1) * ARCSEC


@pytest.mark.parametrize('name, mount', [('through_zenith2.csv', None), ('tz_free.csv',
                                                                         'free:0,90,180')])
def test_a_night_through_the_zenith(name, mount):
    path = CASES / name
    if not path.is_file():
        pytest.skip(f'no {name} beside the project')
    run = read_run(path, mount=mount)
    check_columns(run)
    result = fit_terms(run)
    terms = dict(zip(TRUE, result.model.terms.values()))
    off = [(terms[n] / ARCSEC - TRUE[n]) for n in TRUE]
    assert len(run) == 60 and result.rms_arcsec().radial == pytest.approx(0.71, abs=0.02)
    assert np.all(np.abs(off) < 3.0 * result.sigma / ARCSEC)


@pytest.mark.parametrize('off', [170.0, 187.0])
def test_one_azimuth_half_a_turn_off_is_an_outlier(tmp_path, off):
    run = beyond_zenith(part=0.0)
    low = int(np.argmin(run['el']))
    run['az_enc'][low] += off * DEG
    read = read_run(written(tmp_path / 'run.csv', run))
    result = fit_terms(read)
    assert not is_beyond(read['el']).any()
    off = [result.model.terms[name] / ARCSEC - TRUE[name] for name in TRUE]
    assert np.all(np.abs(off) < 4.0 * result.sigma / ARCSEC)
    assert np.flatnonzero(result.weights == 0.0).tolist() == [low]
