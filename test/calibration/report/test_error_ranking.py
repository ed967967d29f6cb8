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

from calibration.report.error_ranking import MOST_ERRORS, ErrorLine, errors_section, term_lines
from calibration.report.page_html import drawn
from pointing_model.mount_kinds import KINDS
from pointing_model.mounts import Mount, parse_mount
from pointing_model.pointing_terms import term_cause, terms_of
from pointing_model.runs.run import PointingRun


def row(name, value, sigma=0.5):
    return {'name': name, 'value_arcsec': value, 'sigma_arcsec': sigma}


@pytest.fixture
def run():
    rng = np.random.default_rng(4)
    az, el = rng.uniform(0.0, 2.0 * np.pi, 500), rng.uniform(0.3, 1.4, 500)
    return PointingRun({'az': az, 'el': el, 'az_enc': az, 'el_enc': el}, {'mount': Mount()})


def test_terms_are_ranked_by_their_rms_on_the_sky(run):
    # IA acts by cos E alone; AN moves each star by sqrt(sin²A sin²E + cos²A)
    lines = term_lines([row('IA', 20.0), row('IE', -15.0), row('AN', 12.0), row('CA', 1.0)], run)
    assert [line.name.split(', ')[1].split()[0] for line in lines] == ['IE', 'IA', 'AN']
    sizes = [line.removes_arcsec for line in lines]
    a, e = run['az'], run['el']
    np.testing.assert_allclose(sizes, [
        15.0, 20.0 * np.sqrt(np.mean(np.cos(e)**2)),
        12.0 * np.sqrt(np.mean((np.sin(a) * np.sin(e))**2 + np.cos(a)**2))])


def test_an_undetermined_or_unknown_term_is_no_error(run):
    assert term_lines([row('IA', 900.0, None), row('IA[2]', 50.0), row('IE', 1.4)], run) == []
    assert term_lines(None, run) == []


def test_the_smaller_ones_are_folded():
    lines = [ErrorLine(f'error {i}', None, 9.0 - i, ['a cause'], 'a part') for i in range(5)]
    page = drawn(errors_section(lines))
    head, tail = page.split('<details>')
    assert head.count('error ') == MOST_ERRORS and 'And 2 smaller' in tail
    assert 'peak to peak' not in page and 'RMS removed' in page
    assert drawn(errors_section([])) == ''


@pytest.mark.parametrize('kind', KINDS)
def test_every_geometric_term_has_a_cause_and_a_place_to_look(kind):
    mount = parse_mount('free:30,40' if kind == 'free' else kind, 0.8)
    told = {name: term_cause(name, mount) for name in KINDS[kind].terms}
    assert all(cause and check and '{' not in cause + check for cause, check in told.values())
    assert ('bolts' in told[mount.names.named('AN')][1]) == mount.celestial
    assert all(term_cause(name, mount)[0] for name in terms_of(mount))
