"""Where the iteration of a fit may end: residuals are those of the rotations themselves."""


import numpy as np
import pytest
from noisy_run import make_run

from calibration.analysis.fit import fit_terms
from calibration.analysis.rotation_offsets import Rotating
from calibration.estimation import gauss_newton, robust_rounds, robust_weights, rounds_of_many
from msg_tools.units import ARCSEC
from pointing_model.geometry import offsets
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.runs.run import PointingRun
from pointing_model.terms import Trig, stacked_design

MOUNTS, NAMES = (ALTAZ, Mount.equatorial(0.6)), ('altaz', 'equatorial')


def rotating(az, el, mount, at):
    names = tuple(mount.names.physical)
    trig = Trig(az, el, mount)
    out = Rotating(trig, names, {}, np.zeros(2 * len(az)),
                   stacked_design(names, az, el, mount, trig), mount)
    out.residual(np.asarray(at), False)
    return out


@pytest.mark.parametrize('mount', MOUNTS, ids=NAMES)
@pytest.mark.parametrize('top', [50.0, 85.0, 89.5])
def test_the_second_order_is_within_its_bound(mount, top):
    rng = np.random.default_rng(int(top))
    names, used = mount.names.physical, []
    for _ in range(40):
        az, el = rng.uniform(-3, 3, 300), np.radians(rng.uniform(top - 5, top, 300))
        at, one, two = rng.normal(size=(3, 7)) * np.array([[50.0], [20.0], [20.0]]) * ARCSEC
        one[rng.random(7) < 0.5] = 0.0  # along few of them it is the largest
        two[rng.random(7) < 0.5] = 0.0
        bound = rotating(az, el, mount, at).curvature()
        if not (np.isfinite(bound) and one.any() and two.any()):
            continue

        both, first, second, none = (
            np.array(offsets(az, el, dict(zip(names, p)), mount))
            for p in (at + one + two, at + one, at + two, at))
        mixed = np.abs(both - first - second + none).max()
        used.append(mixed / (bound * np.abs(one).sum() * np.abs(two).sum()))
    assert len(used) > 20
    assert 0.05 < max(used) < 0.5


def test_where_the_mount_cannot_look_there_is_no_bound():
    az, el = np.array([0.1, 1.0]), np.array([0.5, np.pi / 2 - 300 * ARCSEC])
    at = np.array([0, 0, 100.0, 0, 0, 0, 0]) * ARCSEC
    assert rotating(az, el, ALTAZ, at).curvature() == np.inf
    assert rotating(az[:1], el[:1], ALTAZ, at).curvature() < 10.0
    assert rotating(az[:1], el[:1], ALTAZ, 0.0 * at).curvature() < 10.0


def simulated(rng, az, el, mount, **columns):
    """A run of random terms with 1" of noise."""
    noise = rng.normal(size=(2, len(az))) * ARCSEC
    truth = dict(zip(mount.names.physical, rng.normal(size=7) * 100 * ARCSEC))
    az_enc, el_enc = PointingModel(truth, mount=mount).sky_to_encoder(az, el)
    return PointingRun({'az': az, 'el': el, 'az_enc': az_enc + noise[0] / np.cos(el),
                        'el_enc': el_enc + noise[1], **columns}, {'mount': mount})


@pytest.mark.parametrize('robust', [True, False])
@pytest.mark.parametrize('mount', MOUNTS, ids=NAMES)
@pytest.mark.parametrize('kind', ['few', 'some', 'many', 'sigmas', 'near the zenith'])
def test_residuals_are_those_of_the_rotations(monkeypatch, kind, mount, robust):
    if kind == 'many':
        for module in (robust_weights, rounds_of_many):
            monkeypatch.setattr(module, 'MANY', 0)
    rng = np.random.default_rng(4)
    n = {'few': 12, 'some': 300}.get(kind, 8000)
    az, el = rng.uniform(-3, 3, n), np.arcsin(rng.uniform(0.3, 0.99, n))
    if kind == 'near the zenith':
        el[::7] = np.radians(89.9)
    columns = {}
    if kind == 'sigmas':
        columns = {f'sigma_{axis}': rng.uniform(0.3, 3.0, n) * ARCSEC for axis in 'xy'}
    run = simulated(rng, az, el, mount, **columns)
    fit = fit_terms(run, robust=robust)
    az_enc, el_enc = fit.model.sky_to_encoder(run['az'], run['el'])
    there = np.isfinite(fit.residual_x)
    assert there.sum() > 0.8 * len(there)
    x = ((run['az_enc'] - az_enc) * np.cos(run['el']))[there]
    y = (run['el_enc'] - el_enc)[there]
    assert np.abs(fit.residual_x[there] - x).max() < 1e-7 * ARCSEC
    assert np.abs(fit.residual_y[there] - y).max() < 1e-7 * ARCSEC


def test_a_fit_of_many_rows_ends_without_a_look_that_shows_nothing(monkeypatch):
    monkeypatch.setattr(robust_weights, 'MANY', 0)
    monkeypatch.setattr(rounds_of_many, 'MANY', 0)
    run = make_run(np.random.default_rng(4), 8000)
    short = fit_terms(run)
    monkeypatch.setattr(Rotating, 'beyond', lambda *args: np.inf)
    looked = fit_terms(run)
    assert short.iterations < looked.iterations
    assert np.abs(short.coefficients - looked.coefficients).max() < 1e-8 * ARCSEC
    assert np.abs(short.residual_x - looked.residual_x).max() < gauss_newton.EXACT


@pytest.mark.parametrize('robust', [True, False])
@pytest.mark.parametrize('mount', MOUNTS, ids=NAMES)
@pytest.mark.parametrize('where', ['a field of 3 degrees', 'some by the zenith'])
@pytest.mark.parametrize('by_parts', [True, False])
def test_a_fit_that_begins_at_a_part_has_the_columns_of_its_end(monkeypatch, by_parts, where,
                                                                mount, robust):
    """Where the stars hardly tell terms apart, theirs change with the place of the columns."""
    rng = np.random.default_rng(9)
    n = 7000
    az, el = rng.uniform(-3, 3, n), np.arcsin(rng.uniform(0.2, 0.99, n))
    if where == 'some by the zenith':
        el[::5] = np.radians(rng.uniform(89.0, 89.95, len(el[::5])))
    else:
        az, el = 1.0 + rng.uniform(-0.03, 0.03, n), 0.8 + rng.uniform(-0.03, 0.03, n)
    run = simulated(rng, az, el, mount)
    if by_parts:
        for module in (robust_weights, rounds_of_many):
            monkeypatch.setattr(module, 'MANY', 0)
    begun = fit_terms(run, robust=robust)
    for module in (robust_weights, rounds_of_many):
        monkeypatch.setattr(module, 'MANY', 10**9)
    monkeypatch.setattr(gauss_newton, '_MANY', 10**9)
    monkeypatch.setattr(robust_rounds, '_SETTLED', 1e-6)
    whole = fit_terms(run, robust=robust)
    assert np.abs((begun.coefficients - whole.coefficients) / whole.sigma).max() < 1e-3
    np.testing.assert_allclose(begun.sigma, whole.sigma, rtol=3e-4)


@pytest.mark.parametrize('robust', [True, False])
def test_by_the_zenith_azimuths_go_the_shorter_way_round(robust):
    rng = np.random.default_rng(11)
    n = 3000
    az, el = rng.uniform(-3, 3, n), np.arcsin(rng.uniform(0.3, 0.99, n))
    el[::3] = np.pi / 2 - rng.uniform(30, 90, n // 3) * ARCSEC  # a tilt takes it round the pole
    model = PointingModel({'AN': 300 * ARCSEC, 'AW': -100 * ARCSEC, 'CA': 5 * ARCSEC})
    az_enc, el_enc = model.sky_to_encoder(az, el)
    noise = rng.normal(size=(2, n)) * ARCSEC
    assert (np.abs(az_enc - az + noise[0] / np.cos(el)) > np.pi).sum() > 3
    run = PointingRun({'az': az, 'el': el, 'az_enc': az_enc + noise[0] / np.cos(el),
                       'el_enc': el_enc + noise[1]})
    fit = fit_terms(run, robust=robust)
    there = np.isfinite(fit.residual_x)
    assert np.abs(fit.residual_x[there]).max() < 5 * ARCSEC
    assert fit.scatter[0] == pytest.approx(ARCSEC, rel=0.05)
    assert fit.coefficients[fit.names.index('AN')] == pytest.approx(300 * ARCSEC,
                                                                    abs=0.5 * ARCSEC)


@pytest.mark.parametrize('robust', [True, False])
@pytest.mark.parametrize('every', [2, 4, 5, 8])
def test_rows_off_in_turns_are_in_the_part_as_in_all(monkeypatch, every, robust):
    """One in so many off, in step with the part of the rows that a fit begins at."""
    rng = np.random.default_rng(12)
    az, el = rng.uniform(-3, 3, 7000), np.arcsin(rng.uniform(0.3, 0.99, 7000))
    run = simulated(rng, az, el, ALTAZ)
    run.columns['el_enc'][::every] += (30 if every > 2 else 3) * ARCSEC
    begun = fit_terms(run, robust=robust)
    monkeypatch.setattr(gauss_newton, '_MANY', 10**9)
    whole = fit_terms(run, robust=robust)
    assert np.abs((begun.coefficients - whole.coefficients) / whole.sigma).max() < 0.05
    np.testing.assert_allclose(begun.sigma, whole.sigma, rtol=5e-3)


def test_of_columns_of_zeros_a_fit_says_so():
    rng = np.random.default_rng(13)
    with pytest.raises(ValueError, match='tell nothing of what is to be fitted'):
        fit_terms(simulated(rng, rng.uniform(-3, 3, 300), np.zeros(300), ALTAZ), ('NPAE',))


def test_rows_where_the_mount_cannot_look_are_left_out_of_many(monkeypatch):
    rng = np.random.default_rng(10)
    az, el = rng.uniform(-3, 3, 8000), np.arcsin(rng.uniform(0.3, 0.99, 8000))
    run = simulated(rng, az, el, ALTAZ)
    model = PointingModel({'CA': 300 * ARCSEC, 'AN': 50 * ARCSEC})
    noise = rng.normal(size=(2, 8000)) * ARCSEC
    az_enc, el_enc = model.sky_to_encoder(az, el)
    run.columns['az_enc'] = az_enc + noise[0] / np.cos(el)
    run.columns['el_enc'] = el_enc + noise[1]
    run.columns['el'][::500] = np.pi / 2 - 100 * ARCSEC
    whole = fit_terms(run)
    for module in (robust_weights, rounds_of_many):
        monkeypatch.setattr(module, 'MANY', 0)
    by_parts = fit_terms(run)
    assert [of['row'] for of in by_parts.excluded] == list(range(0, 8000, 500))
    assert [of['row'] for of in whole.excluded] == list(range(0, 8000, 500))
    assert np.abs(by_parts.coefficients - whole.coefficients).max() < 1e-4 * whole.sigma.min()
    assert np.isnan(by_parts.residual_x[::500]).all()


def test_rows_without_an_offset_fit_nothing(monkeypatch):
    """Coefficients of exactly zero, where a residual is what was observed."""
    monkeypatch.setattr(robust_weights, 'MANY', 0)
    monkeypatch.setattr(rounds_of_many, 'MANY', 0)
    rng = np.random.default_rng(8)
    az, el = rng.uniform(0, 6, 7000), rng.uniform(0.4, 1.4, 7000)
    fit = fit_terms(PointingRun({'az': az, 'el': el, 'az_enc': az, 'el_enc': el}))
    assert np.abs(fit.coefficients).max() < 1e-9 * ARCSEC
    assert np.abs(fit.residual_x).max() < 1e-9 * ARCSEC
