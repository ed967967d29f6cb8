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

"""A night as plate-solved rows: the same terms as by miss distances, and what is wrong is named."""


import numpy as np
import pytest
from plate_solved import HEAD, SITE, SOLID, START, columns_of, given_in, simulated, write

from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.mounts import parse_mount
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.formats.csv import iso_utc, write_csv
from pointing_model.runs.plate_solves.frames import parse_frame
from pointing_model.runs.run import PointingRun
from pointing_model.sky.places import icrs_to_observed, observed_to_icrs
from telescope_mount.input_files.run_loader import load_run

KNOWN = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)))


@pytest.fixture(scope='module')
def night():
    """40 stars in four hours, by rotations: readings, miss distances, what is in the centre."""
    return simulated(40, 4.0)


def reasons(run):
    return {row['row']: row['reason'] for row in run.meta['excluded']}


def noted(run, *words):
    return any(all(word in note for word in words) for note in run.meta['notes'])


# ------------------------------------------------------------------------------- the same night

def fitted_both_ways(night, folder):
    az, el = night.centred
    write_csv(PointingRun({'time': night.time, 'az': night.az, 'el': night.el, 'az_enc': az,
                           'el_enc': el}), folder / 'miss.csv')
    write(folder / 'solved.csv', columns_of(night))
    return [fit_terms(load_run(folder / name)) for name in ('miss.csv', 'solved.csv')]


def test_terms_are_those_of_the_miss_distances(tmp_path):
    # stars two minutes of arc beside the centre, and no noise
    missed, solved = fitted_both_ways(simulated(40, 4.0, beside=120.0, noise=1e-6), tmp_path)
    truth = np.array(list(KNOWN.terms.values()))
    assert np.abs(missed.coefficients - truth).max() < 0.5 * ARCSEC
    assert np.abs(solved.coefficients - missed.coefficients).max() < 0.001 * ARCSEC


def test_noise_acts_on_both_alike(night, tmp_path):
    missed, solved = fitted_both_ways(night, tmp_path)
    sigma = np.sqrt(np.diag(missed.covariance))
    assert np.abs((solved.coefficients - missed.coefficients) / sigma).max() < 0.02


@pytest.mark.usefixtures('short_diagnosis')
def test_fit_and_diagnose_take_the_file(night, tmp_path, ended):
    path = write(tmp_path / 'solved.csv', columns_of(night))
    code, out, err = ended('fit', path)
    assert code == 0 and 'IA' in out and f'{len(night.az)} of {len(night.az)} rows used' in out
    bare = write(tmp_path / 'bare.csv', columns_of(night), '# frame: ICRS\n')
    options = ('--latitude', 34.3, '--longitude', 109, '--height', 500)
    assert ended('fit', bare, *options)[1].splitlines()[:12] == out.splitlines()[:12]
    code, out, err = ended('diagnose', path)
    assert code == 0 and 'rows used' in out and err == ''


# -------------------------------------------------------------------------------- rows that are not

def test_a_false_solve_is_named(night, tmp_path):
    columns = columns_of(night)
    columns['ra_deg'] = columns['ra_deg'].copy()
    columns['ra_deg'][[3, 11]] += (40.0, 0.5)
    run = load_run(write(tmp_path / 'run.csv', columns))
    told = reasons(run)
    assert list(told) == [9, 17] and 'wrong plate' in told[9] and 'arcsec from where' in told[17]
    assert len(run) == len(night.az) - 2
    fit = fit_terms(run).model.terms
    assert abs(fit['IA'] - SOLID.ia) < 5 * ARCSEC


@pytest.mark.parametrize('seed, clock', [(1, 0.0), (1, 3600.0), (8, 3600.0)])
def test_a_third_of_false_solves_is_told_apart(night, tmp_path, seed, clock):
    # with a clock in local time the mount is turned about the pole: no zeros are near it
    rng = np.random.default_rng(seed)
    columns = columns_of(night, time=iso_utc(night.time + clock))
    bad = rng.choice(len(night.az), len(night.az) // 4, replace=False)
    columns['ra_deg'], columns['dec_deg'] = columns['ra_deg'].copy(), columns['dec_deg'].copy()
    columns['ra_deg'][bad] = rng.uniform(columns['ra_deg'].min(), columns['ra_deg'].max(),
                                         len(bad))
    columns['dec_deg'][bad] = rng.uniform(20, 60, len(bad))
    run = load_run(write(tmp_path / 'run.csv', columns))
    assert set(reasons(run)) == {int(i) + 6 for i in bad}


def test_a_copied_solution_is_named(night, tmp_path):
    columns = columns_of(night)
    for name in ('ra_deg', 'dec_deg'):
        columns[name] = columns[name].copy()
        columns[name][7] = columns[name][6]
    told = reasons(load_run(write(tmp_path / 'run.csv', columns)))
    assert list(told) == [13] and told[13].startswith('solution copied from row 12')


def test_a_star_centred_again_is_no_copy(night, tmp_path):
    # a catalogue star twice: the same place, and the encoders follow
    columns = {name: np.concatenate((np.asarray(v), np.asarray(v)[:1]))
               for name, v in columns_of(night).items()}
    again = simulated(40, 4.0)
    later = night.time[0] + 600.0
    columns['time'][-1] = iso_utc(np.array([later]))[0]
    az, el = icrs_to_observed(night.ra[:1], night.dec[:1], later, SITE)
    fitted = fit_terms(load_run(write(tmp_path / 'one.csv', columns_of(again)))).model
    az, el = fitted.sky_to_encoder(az, el)
    columns['az_enc_deg'][-1], columns['el_enc_deg'][-1] = az[0] / DEG, el[0] / DEG
    assert not reasons(load_run(write(tmp_path / 'run.csv', columns)))
    # of images that were solved, two never give the same to the last digit
    columns['sigma_arcsec'] = np.full(len(columns['time']), 0.3)
    told = reasons(load_run(write(tmp_path / 'run.csv', columns)))
    assert len(told) == 1 and 'copied' in next(iter(told.values()))


def test_a_second_solution_of_an_image_is_named(night, tmp_path):
    columns = {name: np.concatenate((np.asarray(v), np.asarray(v)[4:5]))
               for name, v in columns_of(night).items()}
    columns['ra_deg'][-1] += 0.4 / 3600
    columns['sigma_arcsec'] = np.full(len(columns['time']), 0.3)
    columns['sigma_arcsec'][4] = 0.5
    told = reasons(load_run(write(tmp_path / 'run.csv', columns)))
    assert told == {10: f'a second solution of the image of row {len(night.az) + 6}'}


def test_a_flipped_scale_is_named(night, tmp_path):
    n = len(night.az)
    columns = columns_of(night, scale_arcsec_px=np.full(n, 1.16), parity=np.full(n, -1))
    columns['scale_arcsec_px'][2], columns['scale_arcsec_px'][5] = 2.31, -1.16
    columns['parity'][9] = 1
    told = reasons(load_run(write(tmp_path / 'run.csv', columns)))
    assert sorted(told) == [8, 11, 15] and '2.31 arcsec/pixel' in told[8]
    assert 'opposite sign' in told[11] and 'mirrored' in told[15]
    binned = np.where(np.arange(n) % 6 == 0, 2.32, 1.16)
    run = load_run(write(tmp_path / 'run.csv', {**columns, 'parity': np.full(n, 1),
                                                'scale_arcsec_px': binned}))
    assert not reasons(run) and noted(run, 'another camera or binning')


# ---------------------------------------------------------------------------------------- frame

@pytest.mark.parametrize('true', ['of date', 'mean of date', 'B1950'])
def test_a_frame_that_is_not_so_is_refused(night, tmp_path, true):
    columns = columns_of(night, **given_in(night, parse_frame(true)))
    right = load_run(write(tmp_path / 'right.csv', columns, HEAD + f'# frame: {true}\n'))
    assert fit_terms(right).model.terms['AN'] == pytest.approx(SOLID.an, abs=1 * ARCSEC)
    with pytest.raises(ValueError, match=f'declare "# frame: {true}"') as error:
        load_run(write(tmp_path / 'run.csv', columns, HEAD + '# equinox: J2000\n'))
    assert 'the file says ICRS' in str(error.value) and '\n' not in str(error.value)
    with pytest.raises(ValueError, match=f'no frame is declared.*"# frame: {true}"'):
        load_run(write(tmp_path / 'run.csv', columns, HEAD))


def test_without_a_frame_the_rows_tell_it_or_nothing_is_fitted(night, tmp_path):
    run = load_run(write(tmp_path / 'run.csv', columns_of(night), HEAD))
    assert noted(run, 'no frame is declared', 'ICRS is used')
    few = {name: v[:6] for name, v in columns_of(night).items()}
    with pytest.raises(ValueError, match='no frame of ra_deg, dec_deg is declared, and 6 rows'):
        load_run(write(tmp_path / 'few.csv', few, HEAD))
    assert len(load_run(write(tmp_path / 'few.csv', few))) == 6
    short = simulated(14, 0.005)
    with pytest.raises(ValueError, match='the data cannot determine it'):
        load_run(write(tmp_path / 'short.csv', columns_of(short), HEAD))


def test_hours_of_right_ascension_are_refused(night, tmp_path):
    columns = columns_of(night, ra_deg=night.ra / DEG / 15.0)
    with pytest.raises(ValueError, match='give degrees') as refused:
        load_run(write(tmp_path / 'run.csv', columns))
    assert '206264.8' not in str(refused.value)  # a radian: what stands for no fit at all


def test_a_clock_in_local_time_is_noted(night, tmp_path):
    columns = columns_of(night, time=iso_utc(night.time + 3600.0))
    run = load_run(write(tmp_path / 'run.csv', columns))
    assert noted(run, 'azimuth axis would be tilted', 'a clock that is not UTC')


# ---------------------------------------------------------------------------------------- sigma

def test_the_sigma_of_a_solution_weighs(night, tmp_path):
    rng = np.random.default_rng(3)
    n = len(night.az)
    sigma = np.where(np.arange(n) % 2, 0.3, 15.0)
    ra = night.ra + rng.normal(0, sigma) * ARCSEC / np.cos(night.dec)
    dec = night.dec + rng.normal(0, sigma) * ARCSEC
    plain = columns_of(night, ra_deg=ra / DEG, dec_deg=dec / DEG)
    weighed = load_run(write(tmp_path / 'run.csv', {**plain, 'sigma_arcsec': sigma}))
    assert noted(weighed, '0.3 to 15 arcsec', 'the extra scatter')
    # the mount's own noise of 1 arcsec comes beside, so that sharp images do not take the fit
    assert np.median(weighed['sigma_x'][sigma < 1]) / ARCSEC == pytest.approx(1.0, abs=0.4)
    assert np.median(weighed['sigma_x'][sigma > 1]) / ARCSEC == pytest.approx(15.0, abs=0.2)
    fits = [fit_terms(run) for run in (
        weighed, load_run(write(tmp_path / 'plain.csv', plain)))]
    truth = np.array(list(KNOWN.terms.values()))
    errors = [np.linalg.norm(fit.coefficients - truth) for fit in fits]
    assert errors[0] < 0.5 * errors[1]
    z = (fits[0].coefficients - truth) / np.sqrt(np.diag(fits[0].covariance))
    assert np.abs(z).max() < 4.0
    sigma = sigma.astype(object)
    sigma[3] = ''
    run = load_run(write(tmp_path / 'run.csv', {**plain, 'sigma_arcsec': sigma}))
    assert len(run) == n and noted(run, 'sigma_arcsec is empty in 1 of')


# ---------------------------------------------------------------------------------------- bad input

@pytest.mark.parametrize('change, head, words', [
    ({}, HEAD + '# frame: galactic\n', ['row 4', "'galactic' is unknown", 'ICRS']),
    ({}, HEAD + '# equinox: 1875\n', ['row 4', 'outside 1900 to 2100']),
    ({}, HEAD + '# equinox: B1900\n', ['only B1950']),
    ({}, HEAD + '# frame: ICRS\n# equinox: 2000\n', ['frame is declared twice']),
    ({}, '# frame: ICRS\n', ['need the site']),
    ({}, '# frame: ICRS\n# latitude_deg: 34\n', ['need the site']),
    ({}, '# frame: ICRS\n# latitude_deg: north\n', ["latitude_deg 'north' is not a number"]),
    ({}, '# frame: ICRS\n# latitude_deg: 134\n', ['latitude_deg 134 is outside']),
    ({'mount': ['A'] * 20 + ['B'] * 20}, HEAD + '# frame: ICRS\n',
     ["row 26 is of mount 'B'", "of 'A'", 'split']),
])
def test_bad_files_are_refused_in_one_line(night, tmp_path, refused, change, head, words):
    line = refused('fit', write(tmp_path / 'run.csv', {**columns_of(night), **change}, head))
    assert all(word in line for word in words), line


def test_rows_that_are_no_numbers_are_left_out(night, tmp_path):
    columns = columns_of(night)
    columns['ra_deg'] = columns['ra_deg'].astype(object)
    columns['ra_deg'][[1, 2]] = ('nan', '')
    run = load_run(write(tmp_path / 'run.csv', columns, HEAD + '# frame: ICRS\n# frme: FK5\n'))
    assert set(reasons(run).values()) == {'ra_deg is not a number'}
    assert noted(run, "'frme' not read; did you mean frame?")


# ----------------------------------------------------------------------------- any other mount

@pytest.fixture(scope='module')
def german():
    """Columns of 50 images of a German mount on both sides of the pier, and its model."""
    rng = np.random.default_rng(8)
    mount = parse_mount('german', SITE.latitude)
    time = START + np.sort(rng.uniform(0, 4 * 3600.0, 50))
    az, el = rng.uniform(0, 2 * np.pi, 50), rng.uniform(25, 75, 50) * DEG
    ra, dec = observed_to_icrs(az, el, time, SITE)
    beyond = rng.random(50) < 0.5
    terms = dict(zip(mount.names.physical, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC))
    model = PointingModel(terms, mount=mount)
    first, second = model.sky_to_encoder(*mount.axes_of(az, el, beyond))
    noise = rng.normal(0, 1, (2, 50)) * ARCSEC
    return {'time': iso_utc(time), 'ra_deg': ra / DEG, 'dec_deg': dec / DEG,
            'ha_enc_deg': (first + noise[0] / np.cos(second)) / DEG,
            'dec_enc_deg': (second + noise[1]) / DEG, 'pressure_hpa': np.full(50, 955.0),
            'temperature_c': np.full(50, 10.0)}, model


GERMAN = HEAD + '# mount: german\n# frame: ICRS\n'


def test_a_german_mount_is_fitted_on_both_sides(german, tmp_path):
    columns, model = german
    run = load_run(write(tmp_path / 'run.csv', columns, GERMAN))
    assert noted(run, 'through the pole') and len(run) == 50
    fitted = fit_terms(run)
    z = (fitted.coefficients - list(model.terms.values())) / np.sqrt(np.diag(fitted.covariance))
    assert fitted.names == tuple(model.terms) and np.abs(z).max() < 4.0


def test_false_solves_and_frames_of_a_german_mount_are_named(german, tmp_path):
    columns = {name: np.array(v) for name, v in german[0].items()}
    columns['dec_deg'][4] += 3.0
    for name in ('ra_deg', 'dec_deg'):
        columns[name][30] = columns[name][29]
    told = reasons(load_run(write(tmp_path / 'run.csv', columns, GERMAN)))
    assert sorted(told) == [11, 37] and 'wrong plate solution' in told[11] and 'copied' in told[37]
    with pytest.raises(ValueError, match='the file says of date.*as ICRS the places leave'):
        load_run(write(tmp_path / 'run.csv', german[0], GERMAN.replace('ICRS', 'of date')))


def test_what_is_played_to_the_graph_is_the_judged_run(night, tmp_path):
    from telescope_mount.closed_loop.closed_loop import _player, _sound_run
    columns = columns_of(night)
    columns['ra_deg'] = columns['ra_deg'].copy()
    columns['ra_deg'][3] += 40.0
    path = write(tmp_path / 'run.csv.in', columns)
    played = load_run(_player(_sound_run(path, {}), path, None, tmp_path)['file'])
    assert len(played) == len(night.az) - 1 and not reasons(played)
