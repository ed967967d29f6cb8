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

import numpy as np
import pytest
from noisy_run import TRUTH, make_run

from calibration.analysis.run_fit import fit_run
from calibration.analysis.term_fit import fit_terms
from calibration.estimation.few_rows import kept_rows
from calibration.report.documents import fit_document
from calibration.report.wording import wording
from msg_tools.units import ARCSEC
from pointing_model.pointing_terms import PHYSICAL, stacked_design


def runs(n, count, wrong=0, noise=(1.0, 1.0)):
    for seed in range(count):
        run = make_run(np.random.default_rng([n, seed]), n, noise)
        run['el_enc'][:wrong] += 40 * ARCSEC
        run['az_enc'][:wrong] -= 45 * ARCSEC / np.cos(run['el'][:wrong])
        yield fit_terms(run)


@pytest.mark.parametrize('n, noise, wrong', [
    (4, (1.0, 1.0), 0), (6, (0.5, 1.5), 0), (6, (1.0, 1.0), 1), (9, (1.0, 1.0), 1)])
def test_a_term_is_as_far_off_as_told_in_one_case_of_twenty(n, noise, wrong):
    beyond = [np.abs(fit.coefficients - TRUTH) > fit.within95
              for fit in runs(n, 200, wrong, noise)]
    assert 0.02 < np.mean(beyond) < 0.10


def test_good_rows_stay_and_wrong_ones_go():
    assert not any(len(fit.rejected) for n in (4, 6, 7) for fit in runs(n, 20, 1))
    for n, wrong in ((9, 1), (14, 2)):
        found = [fit.rejected.tolist() for fit in runs(n, 50, wrong)]
        assert sum(rows == list(range(wrong)) for rows in found) >= 43
        assert sum(len(fit.rejected) > 0 for fit in runs(n, 50)) <= 1


def test_a_row_is_judged_by_what_a_fit_without_it_says():
    """Against the prediction errors of real fits without each row."""
    rng = np.random.default_rng(3)
    run = make_run(rng, 10)
    design = stacked_design(PHYSICAL, run['az'], run['el'])
    b = np.concatenate(run.offsets()) + 0.0
    others = np.arange(10) != 4
    keep = np.concatenate((others, others))
    p, *_ = np.linalg.lstsq(design[:, keep].T, b[keep], rcond=None)
    b[[4, 14]] = p @ design[:, [4, 14]]  # as the others predict it
    for off, stays in ((0.0, True), (400.0, False)):
        b[14] = p @ design[:, 14] + off * ARCSEC
        assert kept_rows(design, b)[4] == stays
    b[14] = np.nan
    weights = keep.astype(float)  # what is not there is not judged, and stays out
    assert not kept_rows(design, np.nan_to_num(b), weights)[4]
    assert kept_rows(design[:, :10], b[:10]) is None  # 5 rows


def test_exact_rows_and_rows_within_given_sigmas_are_not_wrong():
    rng = np.random.default_rng(4)
    assert len(fit_terms(make_run(rng, 10, (0, 0))).rejected) == 0
    run = make_run(rng, 10, (0, 0), sigma_x=np.full(10, 5 * ARCSEC),
                   sigma_y=np.full(10, 5 * ARCSEC))
    run['el_enc'][2] += 8 * ARCSEC
    fit = fit_terms(run)
    assert len(fit.rejected) == 0 and np.isinf(fit.freedom).all()
    assert fit.within95 == pytest.approx(1.96 * fit.sigma, rel=1e-3)
    run['el_enc'][2] += 200 * ARCSEC
    assert fit_terms(run).rejected.tolist() == [2]


def test_what_was_rejected_and_how_few_rows_are_is_told():
    run = make_run(np.random.default_rng(5), 9, star=np.arange(100.0, 109.0),
                   time=np.full(9, 1768482000.0))
    run['el_enc'][3] += 60 * ARCSEC
    fit = fit_terms(run)
    assert fit.rejected.tolist() == [3]
    document = fit_document(fit_run(run))
    assert document['degrees_of_freedom'] == 2 * 8 - 7
    assert [(one['row'], one['star']) for one in document['outliers']] == [(3, 103)]
    assert all(0 < term['degrees_of_freedom'] < 9 for term in document['terms'])
    assert document['terms'][6]['within95_arcsec'] > 2.2 * document['terms'][6]['sigma_arcsec']
    rejected, = fit.rejected_stars(run)
    assert rejected['y_arcsec'] == pytest.approx(60, abs=8)
    assert wording(rejected).startswith('star 103 at 13:00:00 UTC is rejected: ')
    few, = fit.freedom_findings
    assert '9 degrees' in wording(few)
    assert 'no row could be tested' in wording(
        fit_terms(run.select(slice(0, 5))).freedom_findings[-1])
    many = fit_terms(make_run(np.random.default_rng(6), 40))
    assert many.freedom_findings == many.rejected_stars(run) == []
