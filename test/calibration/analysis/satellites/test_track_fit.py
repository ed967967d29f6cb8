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

"""Terms, clock and orbits from tracks: values within their sigmas, and what cannot be separated."""

from dataclasses import replace

import numpy as np
import pytest
from made_tracks import SITE, STEP, TRUTH, made_orbit, made_tracks, passes

from calibration.analysis.satellites.normal_points import normal_points
from calibration.analysis.satellites.track_faults import fault_chances, fit_without_faults
from calibration.analysis.satellites.track_fit import fit_tracks, with_origin
from calibration.analysis.satellites.track_summary import track_document
from calibration.analysis.term_fit import fit_terms
from calibration.report.wording import worded
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.mounts import parse_mount, through_pole
from pointing_model.runs.run import PointingRun
from pointing_model.runs.satellite_tracks import satellite_tracks, star_rates
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.satellite_place import satellite_place
from pointing_model.sky.star_catalogue import load_catalogue

FOUR = {'A01': 2, 'B02': 2, 'C03': 2, 'D04': 2}


@pytest.fixture(scope='module')
def tracks():
    return made_tracks(np.random.default_rng(1), FOUR, clock=0.03)


def test_satellites_alone_give_terms_and_clock(tracks):
    fit = fit_tracks(tracks)
    for name, value in TRUTH.items():
        found, sigma = fit[name]
        assert abs(found - value * ARCSEC) < 4.0 * sigma and sigma < 5.0 * ARCSEC, name
    late, sigma = fit['clock']
    assert abs(late - 0.03) < 4.0 * sigma and sigma < 0.01
    assert fit.determines and np.std(fit.after) == pytest.approx(ARCSEC, rel=0.1)
    document = worded(track_document(fit))
    assert any("The station's clock is" in note for note in document['notes'])
    assert document['after']['radial_arcsec'] < 1.6 < document['before']['radial_arcsec']


def test_one_pass_leaves_terms_and_time_open():
    one = made_tracks(np.random.default_rng(2), {'A01': 1})
    fit = fit_tracks(one, clock_sigma=0.0, bias_free=('A01',))
    assert not fit.separated('ahead A01') and not fit.determines
    notes = worded(track_document(fit))['notes']
    assert any('cannot be separated from the zeros' in note for note in notes)
    assert any('These tracks do not determine the terms' in note for note in notes)


def test_a_model_of_stars_lets_one_pass_tell_the_time_bias():
    rng = np.random.default_rng(3)
    stars = made_tracks(rng, {}, stars=60)
    held = fit_terms(stars.run).model
    one = made_tracks(rng, {'A01': 1}, ahead={'A01': 0.05}, truth={**TRUTH, 'IA': 130.0})
    fit = fit_tracks(one, held=held, clock_sigma=0.0, bias_free=('A01',))
    value, sigma = fit['ahead A01']
    assert fit.separated('ahead A01') and abs(value - 0.05) < 4.0 * sigma < 0.05
    zero, sigma = fit['IA']
    assert abs(zero - 130.0 * ARCSEC) < 4.0 * sigma


def test_stars_and_satellites_are_one_fit_with_a_noise_each():
    rng = np.random.default_rng(4)
    both = made_tracks(rng, {'A01': 1}, stars=40, clock=0.02)
    both.run['az_enc'][both.is_star] += 4.0 * ARCSEC * rng.normal(size=40)
    both.run['el_enc'][both.is_star] += 4.0 * ARCSEC * rng.normal(size=40)
    fit = fit_tracks(both)
    white = dict(zip(both.objects, fit.noise_of_rows()[0] / ARCSEC))
    assert white[''] > 2.0 * white['A01']
    assert abs(fit['clock'][0] - 0.02) < 4.0 * fit['clock'][1]


def test_a_clock_that_stars_alone_see_is_the_zeros():
    """Late stamps move stars as IA and AW do: no column of a clock without satellites."""
    stars = made_tracks(np.random.default_rng(5), {}, stars=40)
    assert 'clock' not in fit_tracks(stars).columns.names


@pytest.mark.parametrize('mount', ['altaz', 'equatorial', 'xy'])
def test_rates_of_stars_and_satellites_are_those_of_their_places(mount):
    mount = parse_mount(mount, SITE.latitude)
    star = load_catalogue(mag_limit=2.0).select([5])
    time = 1.5e9 + np.array([0.0, 1.0])
    first, second = mount.axes_of(*observed_place(star, time, SITE))
    rate = star_rates(first[:1], second[:1], SITE.latitude, mount)[:, 0]
    moved = (first[1] - first[0]) * np.cos(second[0]), second[1] - second[0]
    np.testing.assert_allclose(rate, moved, rtol=2e-3, atol=1e-8)
    orbit = made_orbit('A01', 10.0)
    when = passes(orbit, 1)[0][:2]
    zero = np.zeros(2)
    rows = satellite_tracks({'time': when, 'az_enc': zero, 'el_enc': zero}, ['A01'] * 2,
                            {'A01': orbit}, SITE, DEFAULT_WEATHER, mount)
    later = satellite_tracks({'time': when + 0.01, 'az_enc': zero, 'el_enc': zero}, ['A01'] * 2,
                             {'A01': orbit}, SITE, DEFAULT_WEATHER, mount)
    moved = np.stack(((later.run['az'] - rows.run['az']) * np.cos(rows.run['el']),
                      later.run['el'] - rows.run['el'])) / 0.01
    np.testing.assert_allclose(rows.clock, moved, rtol=1e-3, atol=1e-7)
    # along the orbit the Earth stands still: another direction, nearly the same rate
    assert np.all(np.hypot(*(rows.ahead - rows.clock)) < 80.0 * ARCSEC)
    assert np.all(np.abs(np.sum(rows.across * rows.ahead, axis=0)) < 0.2 * np.hypot(
        *rows.across) * np.hypot(*rows.ahead))


def test_a_wrong_orbit_is_named_and_left_out():
    tracks = made_tracks(np.random.default_rng(6), FOUR, ahead={'B02': 0.25})
    fit = fit_without_faults(tracks)
    assert fit.left_out == ('B02',) and 'B02' not in fit.tracks.objects
    assert abs(fit['AN'][0] - TRUTH['AN'] * ARCSEC) < 4.0 * fit['AN'][1]
    notes = worded(track_document(fit))['notes']
    assert notes[0].startswith('The orbit of B02 is wrong along the track (')


def test_no_orbit_is_named_where_none_is_wrong(tracks):
    chances = fault_chances(tracks)
    assert chances[''] > 0.5 and sum(chances.values()) == pytest.approx(1.0)


def test_noise_that_remembers_is_no_wrong_orbit():
    """One arc of each hardly tells the memory: the likeliest alone made an orbit of it."""
    rng, few = np.random.default_rng(116), dict.fromkeys(FOUR, 1)
    tracks = made_tracks(rng, few, sigma=20.0)
    walk = np.zeros((2, len(tracks)))
    for rows in (np.flatnonzero(tracks.arc == arc) for arc in np.unique(tracks.arc)):
        keep = np.exp(-STEP / 300.0)
        walk[:, rows] = rng.normal(size=(2, len(rows)))
        for before, now in zip(rows, rows[1:]):
            walk[:, now] = keep * walk[:, before] + np.sqrt(1.0 - keep**2) * walk[:, now]
    assert fault_chances(off(tracks, *1.4 * ARCSEC * walk))[''] > 0.5


def test_two_satellites_cannot_say_whose_orbit_is_wrong():
    tracks = made_tracks(np.random.default_rng(7), {'A01': 1, 'C03': 1}, ahead={'A01': 0.3},
                         stars=40)
    fit = fit_without_faults(tracks.select(~tracks.is_star))
    assert fit.left_out in ((), ('A01',))
    # stars know the mount: now it is plain
    assert fit_without_faults(tracks).left_out == ('A01',)


def test_one_satellite_alone_that_is_ahead_may_be_a_longitude_and_a_clock():
    """What no data can distinguish is named as such, and the terms are the mean over it."""
    tracks = made_tracks(np.random.default_rng(1), {'A01': 2}, stars=40, ahead={'A01': 0.3})
    fit = fit_without_faults(tracks)
    assert set(fit.suspects) == {'A01', 'longitude'} and fit.suspects['A01'] > 0.5
    assert fit.left_out == () and agrees(fit)
    said = worded(track_document(fit))['notes'][0]
    assert said.startswith('One of these is wrong (over 99 %): the orbit of A01 along the track, '
                           'or the longitude -0.00')
    fit = fit_without_faults(tracks, clock_sigma=0.001)
    assert set(fit.suspects) == {'A01'} and agrees(fit)
    said = worded(track_document(fit))['notes'][0]
    assert said.startswith('This is wrong (over 99 %): the orbit of A01 along the track. The fit')


def test_what_is_left_is_a_run_of_means(tracks):
    points = normal_points(fit_tracks(tracks))
    assert 60 < len(points) < len(tracks) / 2.5
    fit = fit_terms(points)
    for name, value, sigma in zip(fit.names, fit.coefficients, fit.sigma):
        assert abs(value - TRUTH[name] * ARCSEC) < 5.0 * sigma
    assert fit.rms_arcsec().radial < 1.2 and points['el'].min() > 24.0 * DEG


@pytest.mark.parametrize('errors', ['mount', 'sky'])
def test_on_both_sides_of_the_pier_terms_and_clock_are_those_of_one_fit(errors):
    """A pass through the meridian, on the other side after it, with stars on both."""
    rng, orbit = np.random.default_rng(7), made_orbit('A01')
    mount = parse_mount('german', SITE.latitude).with_errors(errors)
    truth = {'IH': 60.0, 'ID': -70.0, 'CH': 110.0, 'NP': -40.0, 'ME': 30.0, 'MA': -25.0, 'TF': 5.0}
    model = PointingModel({name: value * ARCSEC for name, value in truth.items()}, mount=mount)
    when = np.concatenate(passes(orbit, 3))
    n, late = 30, 0.02
    first, second = rng.uniform(-1.2, 1.2, n), rng.uniform(-0.3, 1.1, n)
    stars = mount.on_travel(*through_pole(first, second, first < 0.0))
    # where the satellite was as it was read, before the stamp
    seen = mount.axes_of(*satellite_place(orbit, when - late, SITE)[:2])
    beyond = seen[0] < 0.0
    assert 10 < np.count_nonzero(beyond) < len(when) - 10
    seen = mount.on_travel(*through_pole(*seen, beyond))
    time = np.concatenate([when, when[0] - 60.0 * np.arange(1, n + 1)])
    angles = [np.concatenate(pair) for pair in zip(seen, stars)]
    rates = star_rates(*stars, SITE.latitude, mount) * late
    angles[0][len(when):] -= rates[0] / np.cos(stars[1])
    angles[1][len(when):] -= rates[1]
    readings = model.sky_to_encoder(*angles)
    nothing = np.full(len(when), np.nan)
    tracks = satellite_tracks(
        {'time': time, 'az': np.append(nothing, stars[0]), 'el': np.append(nothing, stars[1]),
         'az_enc': readings[0] + ARCSEC * rng.normal(size=len(time)) / np.cos(angles[1]),
         'el_enc': readings[1] + ARCSEC * rng.normal(size=len(time))},
        ['A01'] * len(when) + [''] * n, {'A01': orbit}, SITE, DEFAULT_WEATHER,
        parse_mount('german', SITE.latitude))
    tracks, origin = with_origin(tracks)
    assert origin.holds == errors == tracks.run.mount.errors
    fit = fit_tracks(tracks)
    for name, value in truth.items():
        found, sigma = fit[name]
        assert abs(found - value * ARCSEC) < 4.0 * sigma and sigma < 2.0 * ARCSEC, name
    found, sigma = fit['clock']
    assert abs(found - late) < 4.0 * sigma and sigma < 0.01
    assert np.std(fit.after) == pytest.approx(ARCSEC, rel=0.1)


SEVEN = {'A01': 3, 'B02': 2, 'C03': 2}


def off(tracks, x, y=0.0):
    """The tracks read x, y (rad on the sky) off."""
    run = tracks.run
    moved = {'az_enc': run['az_enc'] + x / np.cos(run['el']), 'el_enc': run['el_enc'] + y}
    return replace(tracks, run=PointingRun({**run.columns, **moved}, run.meta))


def agrees(fit):
    return all(abs(fit[name][0] - value * ARCSEC) < 4.5 * fit[name][1]
               for name, value in TRUTH.items())


@pytest.mark.parametrize('degrees', [0.05, 2.0])
def test_a_pass_that_no_other_agrees_with_is_left_out(degrees):
    tracks = made_tracks(np.random.default_rng(11), SEVEN)
    arc = np.unique(tracks.arc)[1]
    fit = fit_without_faults(off(tracks, (tracks.arc == arc) * degrees * DEG))
    assert fit.left_out == () and arc not in fit.tracks.arc and agrees(fit)
    assert len(np.unique(fit.tracks.arc)) == len(np.unique(tracks.arc)) - 1
    said = worded(track_document(fit))['notes'][0]
    assert said.startswith('The pass of A01 that begins 20') and 'is excluded with its' in said


@pytest.mark.parametrize('count', [1, 2, 3])
@pytest.mark.parametrize('wrong', [False, True])
def test_a_few_rows_of_one_more_satellite_do_no_harm(count, wrong):
    """Their noise is that of the others: by themselves they would fit exactly."""
    tracks = made_tracks(np.random.default_rng(12), SEVEN | {'D04': 1})
    few = tracks.object == tracks.objects.index('D04')
    tracks = tracks.select(~few | (np.cumsum(few) <= count))
    few = tracks.object == tracks.objects.index('D04')
    fit = fit_without_faults(off(tracks, few * wrong * 1.0 * DEG))
    assert fit.left_out == () and agrees(fit) and min(fit.fit.sigma) > 0.0
    assert ('D04' in fit.tracks.objects) != wrong


def test_tracks_that_disagree_are_not_to_be_trusted():
    two = made_tracks(np.random.default_rng(13), {'A01': 2})
    fit = fit_without_faults(off(two, (two.arc == two.arc[0]) * 1.0 * DEG))
    notes = worded(track_document(fit))['notes']
    assert any('The tracks disagree' in one or 'is left out' in one for one in notes)


def test_each_power_on_has_a_zero():
    tracks = made_tracks(np.random.default_rng(14), SEVEN)
    second = tracks.run['time'] > np.median(tracks.run['time'])
    moved = off(tracks, ~second * 100.0 * ARCSEC * np.cos(tracks.run['el']))
    unsaid = fit_without_faults(moved)  # no column says it: it is no orbit's fault
    first = worded(track_document(unsaid))['notes'][0]
    assert unsaid.left_out == () and 'of most satellites: rather a zero jumped' in first
    moved.run = PointingRun({**moved.run.columns, 'run': 7.0 + second}, moved.run.meta)
    fit = fit_without_faults(moved)
    assert agrees(fit)  # the zeros are those of the newest
    value, sigma = fit['IA[7]']
    assert abs(value - 100.0 * ARCSEC) < 4.0 * sigma < 4.0 * ARCSEC
    notes = ' '.join(worded(track_document(fit))['notes'])
    assert 'The zeros in the terms are those of power-on 8, the newest. Power-on 7' in notes


@pytest.mark.parametrize(('name', 'wrong', 'text'), [
    ('height', 2000.0, 'height of the site'), ('latitude', 0.02 * DEG, 'latitude'),
    ('longitude', -0.02 * DEG, 'longitude'), ('refraction', -0.1, 'refraction')])
def test_what_all_satellites_share_is_named_before_an_orbit(name, wrong, text):
    tracks = made_tracks(np.random.default_rng(15), FOUR)
    fit = fit_without_faults(off(tracks, *wrong * tracks.common[name]))
    assert fit.left_out == () and fit.suspects == {} and agrees(fit)
    first, *_ = notes = worded(track_document(fit))['notes']
    assert 'This is wrong (over 99 %)' in first or 'One of these is wrong (over' in first
    assert text in first and 'no orbit need be wrong' in first
    assert not any('wrong along the track' in note for note in notes)
    value, sigma = fit.notes[0][name]
    assert abs(value - wrong) < 4.0 * sigma < abs(wrong)


def test_a_clock_that_is_said_to_be_right_is_named_before_an_orbit():
    fit = fit_without_faults(made_tracks(np.random.default_rng(16), FOUR, clock=0.2),
                             clock_sigma=0.0)
    assert fit.left_out == () and "station's clock +0.2" in worded(track_document(fit))['notes'][0]


def test_what_site_and_air_move_is_that_of_places():
    orbit = made_orbit('A01', 10.0)
    when = passes(orbit, 1)[0][:3]
    zero, star = np.zeros(4), load_catalogue(mag_limit=2.0).select([5])
    shape = {'height': 300.0, 'latitude': 1e-4, 'longitude': -1e-4}

    def rows(site, air=DEFAULT_WEATHER):
        az, el = observed_place(star, when[:1], site, air)
        return satellite_tracks(
            {'time': [*when, when[0]], 'az': [*zero[:3], az[0]], 'el': [*zero[:3], el[0]],
             'az_enc': zero, 'el_enc': zero}, ['A01'] * 3 + [''], {'A01': orbit}, site, air)
    here = rows(SITE)
    airless = rows(SITE, replace(DEFAULT_WEATHER, pressure_hpa=0.0))
    moves = {name: (rows(replace(SITE, **{name: getattr(SITE, name) + step})), step)
             for name, step in shape.items()} | {'refraction': (airless, -1.0)}
    for name, (there, step) in moves.items():
        moved = np.stack(((there.run['az'] - here.run['az']) * np.cos(here.run['el']),
                          there.run['el'] - here.run['el'])) / step
        size = np.abs(here.common[name]).max()
        np.testing.assert_allclose(here.common[name], moved, atol=0.05 * size, err_msg=name)


def test_a_part_of_a_pass_that_is_elsewhere_is_left_out_by_name():
    """As rows of another satellite under its name are, at the same times."""
    tracks = made_tracks(np.random.default_rng(17), FOUR)
    rows = (tracks.arc == np.unique(tracks.arc)[2]) & (np.arange(len(tracks)) % 2 == 0)
    fit = fit_without_faults(off(tracks, rows * 5.0 * DEG))
    assert agrees(fit) and len(fit.tracks) == len(tracks) - rows.sum()
    assert f'is excluded with its {rows.sum()} rows' in worded(track_document(fit))['notes'][0]


def test_stamps_of_whole_seconds_or_that_scatter_are_named():
    rng = np.random.default_rng(18)
    tracks = made_tracks(rng, FOUR)
    assert np.all(tracks.run['time'] % 1.0 == 0.0) and 'clock' in track_document(fit_tracks(tracks))
    rounded = off(tracks, *tracks.clock * rng.uniform(-0.5, 0.5, len(tracks)))
    document = worded(track_document(fit_tracks(rounded)))
    assert 'clock' not in document and 'Every time stamp is a whole second' in document['notes'][0]
    # a message that comes early or late stamps so; an orbit that is off does it smoothly
    moved = off(tracks, *tracks.clock * rng.normal(0.0, 0.05, len(tracks)))
    document = worded(track_document(fit_tracks(moved)))
    assert 'clock' in document
    assert document['notes'][0].startswith('Rows scatter along the track by 0.05')
    drifts = off(tracks, *tracks.ahead * 0.1 * np.sin(tracks.run['time'] / 300.0))
    notes = worded(track_document(fit_tracks(drifts)))['notes']
    assert not any('scatter' in note for note in notes)


@pytest.mark.parametrize('signs', [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_miss_distances_of_the_opposite_sign_are_named(signs):
    rng = np.random.default_rng(19)
    tracks = made_tracks(rng, FOUR)
    run, (x, y) = tracks.run, 6.0 * ARCSEC * rng.normal(size=(2, len(tracks)))
    wrong = [2.0 * miss * (sign < 0) for miss, sign in zip((x, y), signs)]
    taken = replace(tracks, run=PointingRun(
        {**run.columns, 'miss_x': x, 'miss_y': y, 'el_enc': run['el_enc'] + wrong[1],
         'az_enc': run['az_enc'] + wrong[0] / np.cos(run['el'])}, run.meta))
    notes = ' '.join(worded(track_document(fit_tracks(taken)))['notes'])
    named = ' and '.join(name for name, sign in zip(('miss_x', 'miss_y'), signs) if sign < 0)
    assert (f'The sign of {named} looks reversed: the other sign would leave 1.' in notes) == bool(
        named)
