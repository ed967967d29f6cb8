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

"""What the zeros of power-ons follow."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from calibration.analysis.zero import zero_causes as analysis
from calibration.analysis.zero.zero_causes import ZERO_ALPHA, Season, usable_covariates
from calibration.estimation.covariate_choice import choose_covariates, fewest_epochs
from calibration.report.wording import worded
from msg_tools.units import ARCSEC

DAY = 86400.0


def season(seed, n=11, *, slope=0.0, volts=0.0, noise=3.0, walk=0.0, temperature=None,
           supply=None, **more):
    """Nights of random temperatures; the azimuth follows them, the elevation the supply."""
    rng = np.random.default_rng(seed)
    warmth = rng.uniform(-4.0, 16.0, n) if temperature is None else temperature
    supply = 5.0 + rng.normal(0.0, 0.1, (n, 2)) if supply is None else supply
    zeros = noise * rng.normal(size=(n, 2)) + np.cumsum(walk * rng.normal(size=(n, 2)), axis=0)
    zeros[:, 0] += slope * np.nan_to_num(warmth)
    zeros[:, 1] += volts * np.nan_to_num(supply[:, 1] - 5.0)
    return Season(np.arange(n), DAY * np.arange(n), zeros * ARCSEC, np.full((n, 2), 0.3 * ARCSEC),
                  {'temperature': np.tile(np.asarray(warmth)[:, None], 2), 'supply': supply,
                   'hours': np.full((n, 2), 24.0), 'side': np.ones((n, 2)), **more})


def zero_causes(*args, **kwargs):
    """With sentences in the place of findings."""
    return worded(analysis.zero_causes(*args, **kwargs))


def names(found, axis):
    return [cause['driver'] for cause in found['axes'][axis]['causes']]


def test_temperature_and_supply_are_found_with_their_slopes():
    found = zero_causes(season(1, slope=3.0, volts=200.0, n=13))
    assert found['verdict'] == 'cause' and found['p'] <= ZERO_ALPHA
    assert names(found, 'azimuth') == ['temperature'] and names(found, 'elevation') == ['supply']
    for axis, true in (('azimuth', 3.0), ('elevation', 200.0)):
        cause = found['axes'][axis]['causes'][0]
        assert abs(cause['slope_arcsec'] - true) < 3.0 * cause['sigma_arcsec'] < 0.5 * true
        assert cause['driver'] in found['axes'][axis]['text'].replace('supply voltage', 'supply')
        left = found['axes'][axis]
        assert left['left_out_after_arcsec'] < 0.5 * left['left_out_before_arcsec']
        assert 1.5 < left['unexplained_arcsec'] < 5.0
    assert any('constant' in line and 'last power-on' in line for line in found['not_tried'])


def unequal(seed, times=1.0, slope=3.0, n=12):
    """Every other zero with an error of 20 arcsec, the others of 1; `times`: as it is given."""
    given = season(seed, n, slope=slope, noise=0.0)
    sigmas = np.where(np.arange(n) % 2, 20.0, 1.0)[:, None] * np.ones(2) * ARCSEC
    noise = np.random.default_rng(seed + 1000).normal(size=(n, 2))
    return replace(given, zeros=given.zeros + sigmas * noise, sigmas=times * sigmas)


@pytest.mark.parametrize('times, known', [(0.05, 0.7), (1.0, 0.2), (3.0, 0.2)])
def test_zeros_weigh_by_their_errors(times, known):
    found = zero_causes(unequal(1, times), {'temperature': [5.0, 5.0]}, leave_out=False)
    (cause,), tonight = found['axes']['azimuth']['causes'], found['tonight']['azimuth']
    assert cause['slope_arcsec'] == pytest.approx(3.0, abs=3.0 * cause['sigma_arcsec'])
    assert cause['sigma_arcsec'] < known
    assert tonight['zero_arcsec'] == pytest.approx(15.0, abs=3.0 * tonight['sigma_arcsec'])


def test_errors_that_the_zeros_do_not_bear_out_change_nothing():
    plain, rng = season(2, slope=3.0), np.random.default_rng(5)
    by = [zero_causes(replace(plain, sigmas=sigmas * ARCSEC), leave_out=False)['axes']['azimuth'][
        'causes'] for sigmas in (np.ones((11, 2)), np.exp(rng.normal(size=(11, 2))))]
    assert by[0] == by[1]


def test_an_unknown_error_is_as_the_others_and_equal_ones_change_nothing():
    plain = season(2, slope=3.0)
    by = [zero_causes(replace(plain, sigmas=sigmas * ARCSEC), leave_out=False)['axes']['azimuth'][
        'causes'] for sigmas in (np.full((11, 2), 0.3), np.full((11, 2), np.nan), np.where(
            np.arange(11)[:, None] == 4, np.nan, 7.0) * np.ones(2))]
    assert by[0] == by[1] == by[2]


def test_both_covariates_at_once_are_found_on_one_axis():
    rng = np.random.default_rng(3)
    supply = 5.0 + rng.normal(0.0, 0.1, (13, 2))
    given = season(4, n=13, slope=2.0, noise=1.0, supply=supply)
    given.zeros[:, 0] += 120.0 * ARCSEC * (supply[:, 0] - 5.0)
    assert names(zero_causes(given), 'azimuth') == ['temperature', 'supply']


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('given', [{'noise': 9.0}, {'noise': 0.0, 'walk': 9.0}])
def test_zeros_that_scatter_or_walk_have_no_cause(seed, given):
    found = zero_causes(season(seed, **given), leave_out=False)
    assert found['verdict'] != 'cause' and not names(found, 'azimuth')


def test_a_walk_beside_a_seasonal_trend_is_undecided():
    n = 11
    trend = np.linspace(16.0, -4.0, n) + np.random.default_rng(5).normal(0.0, 1.0, n)
    given = season(5, noise=1.0, temperature=trend)
    given.zeros[:, 0] += ARCSEC * np.linspace(0.0, -60.0, n)
    found = zero_causes(given)
    assert found['verdict'] == 'undecided' and found['axes']['azimuth']['alike'] == ['temperature']
    assert 'random walk or drift' in found['text'] and not names(found, 'azimuth')


def test_covariates_that_changed_together_are_not_distinguished():
    warmth = np.random.default_rng(6).uniform(-4.0, 16.0, 11)
    supply = np.tile((5.0 - 0.01 * warmth)[:, None], 2)
    found = zero_causes(season(6, slope=3.0, temperature=warmth, supply=supply))
    assert found['axes']['azimuth']['verdict'] == 'undecided'
    assert set(found['axes']['azimuth']['alike']) == {'temperature', 'supply'}


def test_p_is_exact_over_all_orders_of_six_nights():
    rng = np.random.default_rng(7)
    zeros, covariates = rng.normal(size=(6, 2)), rng.normal(size=(1, 6, 1)) * np.ones(2)
    p = choose_covariates(zeros, covariates, np.arange(6.0), ZERO_ALPHA).p_levels

    def best(z):
        return max(abs(np.corrcoef(z[:, k], covariates[0, :, 0])[0, 1]) for k in range(2))
    every = np.array([best(zeros[list(order)]) for order in permutations(range(6))])
    assert p.min() == np.mean(every >= best(zeros) - 1e-9)


def test_a_scale_and_an_origin_change_nothing():
    given = season(8, slope=1.0)
    other = Season(given.run, given.time, 7.0 * given.zeros + 1.0, given.sigmas, {
        name: 3.0 * values - 20.0 for name, values in given.covariates.items()})
    a, b = zero_causes(given), zero_causes(other)
    assert a['p'] == b['p'] and names(a, 'azimuth') == names(b, 'azimuth')


def test_tonight_is_predicted_as_well_as_its_sigma_says():
    pulls, widths = [], []
    for seed in range(60):
        given = season(seed, n=12, slope=3.0)
        tonight = {name: values[-1] for name, values in given.covariates.items()}
        expected = zero_causes(given.select(slice(0, 11)), tonight, leave_out=False)['tonight']
        for axis, name in enumerate(('azimuth', 'elevation')):
            told = expected[name]
            pulls.append((given.zeros[-1, axis] / ARCSEC - told['zero_arcsec'])
                         / told['sigma_arcsec'])
        widths.append(expected['azimuth']['sigma_arcsec'])
        assert expected['azimuth']['by'] == ['temperature']
    assert 0.55 < np.mean(np.abs(pulls) < 1.0) < 0.81  # 68 %, of 120
    assert 2.0 < np.median(widths) < 4.5


def test_without_tonights_temperature_the_mean_is_expected():
    given = season(1, slope=3.0)
    told = zero_causes(given, {'temperature': np.nan}, leave_out=False)['tonight']['azimuth']
    assert told['missing'] == ['temperature'] and told['by'] == []
    assert told['zero_arcsec'] == pytest.approx(given.zeros[:, 0].mean() / ARCSEC)
    assert told['sigma_arcsec'] > 10.0


@pytest.mark.parametrize('changed, said', [
    ({'temperature': np.full(11, np.nan)}, 'temperature: not known'),
    ({'temperature': np.full(11, 10.0)}, 'temperature: constant'),
    ({'temperature': np.r_[np.full(4, np.nan), np.linspace(0.0, 9.0, 7)]},
     'temperature: not known of 4 of 11 nights'),
])
def test_a_covariate_that_cannot_be_tried_is_named(changed, said):
    found = zero_causes(season(1, **changed))
    assert any(line.startswith(said) for line in found['not_tried'])
    assert found['verdict'] == 'nothing' and 'temperature' not in found['drivers']


def test_a_covariate_that_one_axis_has_alone_is_tried_there():
    rng = np.random.default_rng(11)
    side = np.ones((13, 2))
    side[:, 0] = rng.permutation(np.r_[np.ones(7), -np.ones(6)])
    given = season(11, n=13, noise=1.0, volts=100.0, side=side)
    given.zeros[:, 0] += 6.0 * ARCSEC * side[:, 0]
    found = zero_causes(given)
    assert names(found, 'azimuth') == ['side'] and names(found, 'elevation') == ['supply']
    assert found['axes']['azimuth']['causes'][0]['slope_arcsec'] == pytest.approx(6.0, abs=1.5)


def test_without_times_the_order_of_the_nights_counts():
    given = season(1, slope=3.0)
    found = zero_causes(replace(given, time=np.full(11, np.nan)), leave_out=False)
    assert found == zero_causes(given, leave_out=False)


def test_nothing_to_look_for_is_said():
    given = season(1, temperature=np.full(11, 10.0), supply=np.full((11, 2), np.nan))
    found = zero_causes(given)
    assert found['verdict'] == 'nothing' and 'no cause can be looked for' in found['text']


def test_a_night_without_temperature_is_left_out():
    warmth = np.random.default_rng(9).uniform(-4.0, 16.0, 12)
    warmth[3] = np.nan
    found = zero_causes(season(9, n=12, slope=3.0, temperature=warmth))
    assert found['left_out'] == [3] and found['nights'] == 11
    assert names(found, 'azimuth') == ['temperature']


def _off(given, arcsec, axis=0):
    """The season with zeros that are off: place -> arcsec."""
    zeros = given.zeros.copy()
    for night, value in arcsec.items():
        zeros[night, axis] += value * ARCSEC
    return replace(given, zeros=zeros)


@pytest.mark.parametrize('arcsec', [
    {4: 400.0}, {0: -150.0}, {3: 400.0, 9: -90.0}, {5: 400.0, 6: 400.0}])
def test_an_odd_power_on_is_left_out_and_named(arcsec):
    given = season(1, n=14, slope=3.0)
    tonight = {'temperature': [20.0, 20.0]}
    found = zero_causes(_off(given, arcsec), tonight)
    assert names(found, 'azimuth') == ['temperature'] and found['left_out'] == []
    assert found['nights'] == 14 - len(arcsec)
    cause, = found['axes']['azimuth']['causes']
    assert cause['slope_arcsec'] == pytest.approx(3.0, abs=0.5)
    assert found['tonight']['azimuth']['sigma_arcsec'] < 8.0
    said = zip(found['odd'], arcsec.items(), strict=True)
    for text, (night, size) in said:
        assert text.startswith(f'power-on {night} is excluded: its zero of azimuth is ')
        assert float(text.split('azimuth is ')[1].split('"')[0]) == pytest.approx(size, abs=10.0)


@pytest.mark.parametrize('arcsec', [
    {}, {13: 400.0}, {12: 400.0, 13: 400.0}, dict.fromkeys(range(8, 14), 400.0),  # that may stay
    {i: 400.0 * (-1.0) ** i for i in range(1, 13, 2)}])
def test_what_may_stay_is_no_odd_power_on(arcsec):
    found = zero_causes(_off(season(1, n=14, slope=3.0), arcsec), leave_out=False)
    assert found['odd'] == [] and found['nights'] == 14


def test_what_a_covariate_explains_is_not_odd():
    side = np.ones((14, 2))
    side[[3, 7, 10]] = -1.0
    given = _off(season(1, n=14, noise=1.0, side=side), {3: 400.0, 7: 400.0, 10: 400.0})
    assert zero_causes(given, leave_out=False)['odd'] == []
    assert sum(bool(analysis.zero_causes(season(s, n=8, walk=5.0), leave_out=False)['odd'])
               for s in range(30)) == 0


@pytest.mark.parametrize('n', [0, 1, 2, 5])
def test_too_few_nights_are_said(n):
    found = zero_causes(season(1, n=n, slope=3.0, noise=0.1), {'temperature': [3.0, 3.0]})
    assert found['verdict'] == 'nothing' and f'{n} power-ons' in found['text']
    assert f'least {fewest_epochs(ZERO_ALPHA)} are' in found['text']
    assert (found['tonight'] is None) == (n < 2)


def test_covariates_that_a_fold_makes_constant_do_no_harm():
    side = np.ones((11, 2))
    side[4] = -1.0
    given = season(1, slope=3.0, side=side)
    assert 'side' in usable_covariates(given)[0]
    assert names(zero_causes(given), 'azimuth') == ['temperature']
