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

"""The causes of the satellite check's errors: their shapes on the sky, and the search for them."""

import copy
import json
from functools import cache

import numpy as np
import pytest
from satellite_candidates import (
    CANDIDATES,
    Assumptions,
    polaris_effects,
    satellite_rates,
    track_effects,
)
from satellite_search import _Search, _tracks, candidate_report, report_rows

from calibration.analysis.external_check import PAPER
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.geometry import sky_to_encoder
from pointing_model.sky.elements import GPS_26690, parse_elements
from pointing_model.sky.places import icrs_to_observed
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.satellite_passes import passes
from pointing_model.sky.satellite_place import satellite_place
from pointing_model.sky.site import DEFAULT_SITE, Site

GPS = parse_elements(GPS_26690)
BY_NAME = {c.name: c for c in CANDIDATES}


@pytest.fixture(scope='module')
def time():
    one = passes(GPS, GPS.epoch, 24.0)[0]
    return np.arange(one.start, one.end, 120.0)


@pytest.fixture(scope='module')
def effects(time):
    return track_effects(GPS, time)


@pytest.fixture(scope='module')
def results():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('satellite_search.DATES', 6)  # a night in two months shows the season too
        return {r.name: r for r in candidate_report(GPS)}


# shapes of the causes


def _offset(az_el, reference):
    az, el = az_el
    return wrap(az - reference[0]) / ARCSEC, (el - reference[1]) / ARCSEC


def test_rates_are_those_of_the_place(time):
    az_rate, el_rate = satellite_rates(GPS, time)
    az, el, _ = satellite_place(GPS, time)
    later = satellite_place(GPS, time + 3.0)
    earlier = satellite_place(GPS, time - 3.0)
    assert np.max(np.abs(wrap(later[0] - earlier[0]) / 6.0 - az_rate)) < 5e-4 * ARCSEC
    assert np.max(np.abs((later[1] - earlier[1]) / 6.0 - el_rate)) < 5e-4 * ARCSEC
    on_sky = np.hypot(az_rate * np.cos(el), el_rate) / ARCSEC
    assert on_sky.min() > 15.0 and on_sky.max() < 45.0
    assert np.shape(satellite_rates(GPS, float(time[0]))[0]) == ()


def test_effect_of_a_late_time_is_the_place_later(time, effects):
    right = satellite_place(GPS, time)
    late = _offset(satellite_place(GPS, time + 0.5)[:2], right)
    for axis in (0, 1):
        assert effects['rate'][axis] * 0.5 == pytest.approx(late[axis], abs=0.02)


def test_light_time_lags_behind(effects):
    rate, lag = np.array(effects['rate']), np.array(effects['light_time'])
    # 0.07 s of the motion in space, of which the Earth's turn is no part
    assert np.all(np.sum(rate * lag, axis=0) < 0.0)
    assert 1.0 < np.median(np.hypot(*lag)) < 6.0


def test_sidereal_effect_is_the_motion_of_a_star(time, effects):
    az, el, _ = satellite_place(GPS, time)
    i = len(time) // 3
    ra, dec = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 721), np.linspace(-0.5, 1.2, 341))
    stars = np.array(icrs_to_observed(ra.ravel(), dec.ravel(), float(time[i])))
    nearest = np.argmin(np.hypot(wrap(stars[0] - az[i]) * np.cos(el[i]), stars[1] - el[i]))
    place = ra.ravel()[nearest], dec.ravel()[nearest]
    first, last = (icrs_to_observed(*place, float(time[i] + dt)) for dt in (-5.0, 5.0))
    moved = _offset(last, first)
    assert effects['sidereal'][0][i] == pytest.approx(moved[0] / 10.0, rel=0.03, abs=0.2)
    assert effects['sidereal'][1][i] == pytest.approx(moved[1] / 10.0, rel=0.03, abs=0.2)


def test_clock_in_the_model_leaves_the_motion_among_the_stars(time, effects):
    for axis in (0, 1):
        assert effects['rate_on_sky'][axis] + effects['sidereal'][axis] == pytest.approx(
            effects['rate'][axis])


@pytest.mark.parametrize(('name', 'east', 'north'), [('site_east', 1, 0), ('site_north', 0, 1)])
def test_effect_of_a_displaced_site(time, effects, name, east, north):
    right = satellite_place(GPS, time)
    radius, metres = 6371e3, 300.0
    # computed for a site too far away in that direction; its axes turn with it by the same angle
    wrong_site = Site(DEFAULT_SITE.latitude + north * metres / radius,
                      DEFAULT_SITE.longitude
                      + east * metres / radius / np.cos(DEFAULT_SITE.latitude))
    wrong = satellite_place(GPS, time, wrong_site)
    # take the turn of the axes out: what a star would show
    far = _star_like(right, wrong_site)
    d_az = wrap(far[0] - wrong[0]) / ARCSEC
    d_el = (far[1] - wrong[1]) / ARCSEC
    scale = metres
    assert effects[name][0] * scale * np.cos(right[1]) == pytest.approx(
        d_az * np.cos(right[1]), abs=0.06)
    assert effects[name][1] * scale == pytest.approx(d_el, abs=0.06)


def _star_like(place, site):
    """The same direction in space as seen from axes at another site."""
    az, el = place[:2]
    vector = np.array([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)])

    def axes(s):
        lat, lon = s.latitude, s.longitude
        return np.array([[-np.sin(lon), np.cos(lon), 0.0],
                         [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
                         [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]])
    east, north, up = axes(site) @ axes(DEFAULT_SITE).T @ vector
    return np.arctan2(east, north), np.arcsin(up)


@pytest.mark.parametrize('name', ['CA', 'NPAE', 'AN', 'AW', 'TF', 'IA', 'IE'])
def test_effect_of_a_mount_is_that_of_the_rotation(time, effects, name):
    az, el, _ = satellite_place(GPS, time)
    size = 0.5
    turned = _offset(sky_to_encoder(az, el, {name: size * ARCSEC}), (az, el))
    assert size * effects[name][0] == pytest.approx(turned[0], abs=1e-3)
    assert size * effects[name][1] == pytest.approx(turned[1], abs=1e-3)
    polar = polaris_effects(DEFAULT_SITE, DEFAULT_WEATHER)[name]
    pole = 0.0, DEFAULT_SITE.latitude
    turned = _offset(sky_to_encoder(*pole, {name: size * ARCSEC}), pole)
    assert size * np.array(polar) == pytest.approx(np.array(turned), abs=1e-3)


# the search


@cache
def tracks_of_a_day():
    return _tracks(GPS, [GPS.epoch], DEFAULT_SITE, DEFAULT_WEATHER, Assumptions())


def _search(tracks, candidate):
    return _Search(tracks, candidate, polaris_effects(DEFAULT_SITE, DEFAULT_WEATHER), PAPER,
                   Assumptions())


def test_arc_numbers_are_those_of_the_samples():
    tracks = tracks_of_a_day()
    candidate = BY_NAME['time error and CA']
    arcs = _search(tracks, candidate).arcs
    size = np.array([0.2, 7.0])
    mean, std = arcs.numbers(size[None])
    effects = tracks[0][3]
    polar = 1.0 / np.cos(DEFAULT_SITE.latitude)
    for number in (0, 50, len(arcs.first) - 1):
        part = slice(arcs.first[number], arcs.last[number] + 1)
        d_az = 0.2 * effects['rate'][0][part] + 7.0 * (effects['CA'][0][part] - polar)
        d_el = 0.2 * effects['rate'][1][part]
        assert mean[0, number] == pytest.approx([d_az.mean(), d_el.mean()], abs=1e-9)
        assert std[0, number] == pytest.approx([d_az.std(), d_el.std()], abs=1e-6)


@pytest.mark.parametrize('name', ['time error', 'AW', 'along the orbit'])
def test_intervals_are_those_of_trying_every_size(name):
    tracks = tracks_of_a_day()
    search = _search(tracks, BY_NAME[name])
    sizes = np.linspace(-8.0, 8.0, 999)[:, None] * (0.1 if name != 'AW' else 1.0)
    for intervals, score in ((search.one_after(), search.after_score),
                             (search.one_before(), search.before_score)):
        tried = np.isfinite(score(sizes)).any(axis=1)
        inside = np.any([(a <= sizes[:, 0]) & (sizes[:, 0] <= b) for a, b in intervals], axis=0)
        assert np.array_equal(tried, inside)
        assert 0 < tried.sum() < len(tried)


def test_an_invented_cause_is_found_again(time):
    """0.2 s of late time on two arcs, with zero offset and noise: found, and others are not."""
    effects = {k: np.array(v) for k, v in track_effects(GPS, np.arange(time[0], time[-1], 30.0)
                                                        ).items()}
    rng = np.random.default_rng(7)
    made = {}
    for key, part, zero in (('before', slice(100, 500), (6.0, 9.0)),
                            ('after', slice(420, 460), (0.0, 0.0))):
        error = 0.2 * effects['rate'][:, part] + rng.normal(0.0, 0.5, (2, part.stop - part.start))
        error += np.array(zero)[:, None]
        made[key] = {f'{axis}_{what}_arcsec': float(value)
                     for axis, row in zip(('az', 'el'), error)
                     for what, value in (('mean', row.mean()), ('std', row.std(ddof=1)))}
    tight = Assumptions(samples=200, zero_az_arcsec=0.1, zero_el_arcsec=0.1)
    found = {r.name: r for r in candidate_report(
        GPS, published=made, assumptions=tight, candidates=[
            BY_NAME[n] for n in ('time error', 'CA', 'refraction', 'zero left', 'servo lag')])}
    for name in ('time error', 'servo lag'):
        assert found[name].both and found[name].known_both
    a, b = found['time error'].size_both[0][0]
    assert a <= 0.2 <= b and b - a < 0.05
    for low, high in (found['servo lag'].size_both[0][0], found['servo lag'].size_both[1][0]):
        assert low <= 0.21 and high >= 0.19
    assert not any(found[n].after for n in ('CA', 'refraction'))
    assert found['zero left'].after and not found['zero left'].before


def test_sizes_of_two_at_once_give_the_numbers():
    tracks = tracks_of_a_day()
    search = _search(tracks, BY_NAME['servo lag'])
    before, after = search.two_before(), search.two_after()
    assert len(before) > 1000 and np.isfinite(search.before_score(before[::7])).any(axis=1).all()
    assert len(after) > 1000 and np.isfinite(search.after_score(after[::7])).any(axis=1).all()
    beyond = 1.5 * np.abs(before).max(axis=0)
    tried = np.stack(np.meshgrid(*(np.linspace(-b, b, 40) for b in beyond)), -1).reshape(-1, 2)
    found = tried[np.isfinite(search.before_score(tried)).any(axis=1)]
    assert 0 < len(found) < len(tried)
    assert np.all(found.max(axis=0) <= 1.02 * before.max(axis=0))
    assert np.all(found.min(axis=0) >= 1.02 * before.min(axis=0))


def test_windows_are_those_of_ten_samples_and_the_zero():
    mean, tolerance, most, least, most_before = Assumptions().windows(PAPER)
    assert mean == pytest.approx([5.94, -3.49])
    assert tolerance == pytest.approx([np.hypot(2.2622 * 2.04 / np.sqrt(10), 2.74),
                                       np.hypot(2.2622 * 2.63 / np.sqrt(10), 1.08)], abs=1e-3)
    assert most == pytest.approx(np.array([2.04, 2.63]) * 1.8256, abs=1e-3)
    assert most_before == pytest.approx(np.array([11.33, 4.81]) * 1.8256, abs=1e-2)
    assert least[0] == pytest.approx(np.sqrt((0.68784 * 11.33)**2 - 2.04**2), abs=1e-2)


def test_one_night_needs_before_to_end_before_after():
    tracks = tracks_of_a_day()
    search = _search(tracks, BY_NAME['time error'])
    size = np.array([[0.16]])
    before = np.isfinite(search.before_score(size))[0]
    after = np.isfinite(search.after_score(size))[0]
    possible = (search.end[before][:, None] < search.start[after]).any()
    (found,) = candidate_report(GPS, candidates=[BY_NAME['time error']])
    assert possible and found.one_night
    (other,) = candidate_report(GPS, candidates=[BY_NAME['AN']],
                                assumptions=Assumptions(on_sky=True))
    assert other.both and not other.one_night


def test_verdicts_on_the_paper(results):
    """What can be said from four numbers: some causes are out, several remain."""
    assert len(results) == len(CANDIDATES)
    out = [n for n, r in results.items() if not r.after]
    assert {'light time ignored', 'parallactic refraction', 'diurnal aberration', 'refraction',
            'CA', 'NPAE', 'flexure'} <= set(out)
    assert not results['zero left'].before  # a constant makes no scatter
    assert not results['zero left'].known_after
    remaining = [n for n, r in results.items() if r.known_both]
    assert {'time error', 'AW', 'tilt', 'UT1 for the stars'} <= set(remaining)
    (low, high), = results['time error'].size_after[0]
    assert low < 0.15 < high


def test_ut1_is_an_alias_of_a_tilt(results):
    """The Earth's turn is a turn about the vertical, which the zero takes, and one of the axis."""
    for part in ('size_after', 'size_both'):
        tilt = np.array(getattr(results['AW'], part)[0])
        ut1 = np.array(getattr(results['UT1 for the stars'], part)[0])[::-1, ::-1]
        assert tilt == pytest.approx(-15.041 * np.cos(DEFAULT_SITE.latitude) * ut1, rel=0.02)


def test_best_arcs_give_the_numbers_within_the_stated_windows(results):
    mean, tolerance, most, least, most_before = Assumptions().windows(PAPER)
    for r in results.values():
        if r.best is None:
            continue
        arc = r.best['after']
        assert abs(arc['az_mean_arcsec'] - mean[0]) <= tolerance[0] * 1.001
        assert abs(arc['el_mean_arcsec'] - mean[1]) <= tolerance[1] * 1.001
        assert arc['az_std_arcsec'] <= most[0] * 1.001
        assert 5.0 < arc['el_deg'][0] < 90.0 and arc['minutes'] >= 4.0
        if r.both:
            arc = r.best['before']
            assert least[0] <= arc['az_std_arcsec'] * 1.001
            assert arc['az_std_arcsec'] <= most_before[0] * 1.001
            assert arc['az_mean_arcsec'] + arc['zero_az_arcsec'] == pytest.approx(13.99)
            assert abs(arc['zero_el_arcsec']) <= 27.0 * 1.001


def test_report_is_json_and_rows(results):
    text = json.dumps([r.to_dict() for r in results.values()], allow_nan=False)
    assert json.loads(text)[0]['name'] == 'time error'
    header, rows = report_rows(list(results.values()))
    assert all(len(row) == len(header) for row in rows) and len(rows) == len(CANDIDATES)
    assert rows[0][1].endswith(' s') and rows[[r[0] for r in rows].index('CA')][1] == 'none'


def test_more_samples_leave_less_room():
    wide, narrow = (candidate_report(GPS, assumptions=Assumptions(samples=n),
                                     candidates=[BY_NAME['time error']])[0] for n in (5, 50))
    (a, b), = wide.size_after[0]
    (c, d), = narrow.size_after[0]
    assert a < c < d < b
    published = copy.deepcopy(PAPER)
    published['after']['el_mean_arcsec'] = -30.0
    nothing = candidate_report(GPS, published=published, candidates=[BY_NAME['CA']])[0]
    assert not nothing.after and nothing.best is None


def test_no_pass_is_said_in_one_line():
    low = parse_elements([
        '1 25544U 98067A   13264.51000000  .00002182  00000-0  45000-4 0  9998',
        '2 25544  51.6480 100.0000 0003000  80.0000 280.0000 15.50000000849998'])
    with pytest.raises(ValueError, match='25544 has no pass above 20 degrees') as error:
        candidate_report(low, site=Site(80.0 * DEG, 0.0, 0.0), candidates=[BY_NAME['CA']])
    assert '\n' not in str(error.value)
