"""Fits with many zeros, against those with a column for each."""

import numpy as np
import pytest

from calibration.analysis import fit
from calibration.analysis.fit import fit_harmonics, fit_terms
from calibration.estimation.run_columns import RunColumns
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun

NIGHTS, STARS = 24, 9


def nights(seed=1, sigmas=False):
    rng = np.random.default_rng(seed)
    run = np.repeat(np.arange(1.0, NIGHTS + 1), STARS)
    az, el = rng.uniform(0.0, 360.0, len(run)) * DEG, rng.uniform(20.0, 75.0, len(run)) * DEG
    model = PointingModel({'CA': 80.0 * ARCSEC, 'AN': -30.0 * ARCSEC, 'TF': 20.0 * ARCSEC})
    az_enc, el_enc = model.sky_to_encoder(az, el)
    zeros = rng.normal(0.0, 20.0, (2, NIGHTS)) * ARCSEC
    night, noise = run.astype(int) - 1, rng.normal(0.0, 1.0, (2, len(run))) * ARCSEC
    noise[:, ::50] *= 40.0
    columns = {'az': az, 'el': el, 'run': run,
               'az_enc': az_enc + zeros[0, night] + noise[0] / np.cos(el),
               'el_enc': el_enc + zeros[1, night] + noise[1]}
    if sigmas:
        columns.update(sigma_x=rng.uniform(0.5, 2.0, len(run)) * ARCSEC,
                       sigma_y=rng.uniform(0.5, 2.0, len(run)) * ARCSEC)
    return PointingRun(columns)


@pytest.mark.parametrize('make', [
    lambda: fit_terms(nights(), run_zeros=True),
    lambda: fit_terms(nights(2, sigmas=True), run_zeros=True, robust=False),
    lambda: fit_terms(nights(3), run_zeros=True, geometry='first_order'),
    lambda: fit_harmonics(nights(4), run_zeros=True),  # a direction is not determined
])
def test_fits_are_those_with_all_columns(make, monkeypatch):
    own = make()
    monkeypatch.setattr(fit, 'MANY', 10**9)
    whole = make()
    assert own.names == whole.names and own.rank == whole.rank
    assert own.coefficients == pytest.approx(whole.coefficients, abs=1e-7 * ARCSEC)
    assert own.sigma == pytest.approx(whole.sigma, rel=1e-8)
    assert own.correlations == pytest.approx(whole.correlations, abs=1e-8)
    assert own.residual_x == pytest.approx(whole.residual_x, abs=1e-7 * ARCSEC)
    assert own.weights == pytest.approx(whole.weights, abs=1e-7)
    assert own.singular_values == pytest.approx(whole.singular_values, rel=1e-8)
    assert own.freedom == pytest.approx(whole.freedom, rel=1e-8)
    assert [zero.angles.tolist() for zero in own.run_zeros.values()] == [
        pytest.approx(zero.angles, abs=1e-7 * ARCSEC) for zero in whole.run_zeros.values()]


def test_products_and_inverse_are_those_of_the_columns():
    rng = np.random.default_rng(5)
    run, n = rng.permutation(np.repeat(np.arange(6), 5)), 30
    columns = RunColumns.of(rng.normal(size=(3, 2 * n)), run, rng.uniform(0.3, 1.2, n))
    dense, weights = np.asarray(columns), rng.uniform(0.1, 1.0, 2 * n)
    values, p = rng.normal(size=2 * n), rng.normal(size=len(columns))
    assert columns.shape == dense.shape
    assert columns @ values == pytest.approx(dense @ values)
    assert p @ columns == pytest.approx(p @ dense)
    both = rng.normal(size=(2, len(columns)))
    assert both @ columns == pytest.approx(both @ dense)
    assert np.asarray(columns.part(np.arange(0, n, 3))) == pytest.approx(
        np.concatenate((dense[:, :n:3], dense[:, n::3]), axis=1))
    x_normal, normal = columns.normals(weights)
    assert normal == pytest.approx((dense * weights) @ dense.T)
    assert x_normal == pytest.approx((dense * weights)[:, :n] @ dense[:, :n].T)
    assert columns.inverse(normal) == pytest.approx(np.linalg.inv(normal))
    values, vectors, scale = columns.spectrum(normal)
    scaled = normal / np.outer(scale, scale)
    assert values == pytest.approx(np.linalg.eigvalsh(scaled))
    assert scaled @ vectors == pytest.approx(vectors * values)


def test_a_run_without_any_weight_has_no_inverse():
    columns = RunColumns.of(np.ones((1, 8)), np.array([0, 1, 2, 2]), np.zeros(4))
    weights = np.array([1.0, 0.0, 1.0, 1.0] * 2)
    with pytest.raises(np.linalg.LinAlgError):
        columns.inverse(columns.normals(weights)[1])
