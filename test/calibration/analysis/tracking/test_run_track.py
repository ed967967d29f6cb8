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

"""A run that was observed, followed star by star."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
from drifting_rows import MOUNT, rows

from calibration.analysis.tracking.run_track import track_run
from calibration.report.track_page import render_track
from calibration.report.wording import worded
from msg_tools.units import ARCSEC
from pointing_model.mounts import Mount
from pointing_model.rms import rms


def drifting():
    """60 stars in ten hours; the azimuth's zero drifts by 1 arcsec a star and slips by 60."""
    run = rows(60, 11, drift=1.0)
    run.columns['az_enc'] = run['az_enc'] + 60.0 * ARCSEC * (np.arange(60) >= 45)
    return run


def test_a_mount_that_drifts_and_slips_is_followed():
    tracked = track_run(drifting(), first=15)
    assert tracked.fitted == 15 and list(tracked.rows) == list(range(15, 60))
    missed = tracked.summary()['missed_rms_arcsec']
    assert missed['tracked'] < 0.3 * missed['model of the evening']
    assert missed['tracked, middle'] < 5.0 and missed['expected'] < 12.0
    assert [(event['star'], 'azimuth' in event['what']) for event in tracked.smoothed.events] == [
        (30, True)]
    # in hindsight it is known better than it was live, and right
    back = tracked.smoothed
    ia = back.terms[:, back.names.index('IA')] / ARCSEC
    truth = 310.0 + np.arange(15, 60) + 60.0 * (np.arange(15, 60) >= 45)
    sigma = back.sigma[:, back.names.index('IA')] / ARCSEC
    assert np.mean(np.abs(ia - truth) < 3.0 * sigma) > 0.9


def test_each_star_counts_by_its_own_sigma():
    run, rng = rows(60, 11, drift=1.0), np.random.default_rng(2)
    poor = rng.uniform(size=60) < 0.5
    for axis, factor in (('az', np.cos(run['el'])), ('el', 1.0)):
        run.columns[f'{axis}_enc'] = run[f'{axis}_enc'] + (
            30.0 * ARCSEC * rng.normal(size=60) * poor / factor)
    sigma = np.where(poor, 30.0, 1.0) * ARCSEC

    def good(run):  # what the good stars were missed by, arcsec
        found = track_run(run, first=15)
        return rms(*found.live[~poor[found.rows]].T) / ARCSEC
    without, right, small, large = (good(run.__class__(
        run.columns | {f'sigma_{axis}': times * sigma for axis in 'xy' if times}, run.meta))
        for times in (None, 1.0, 0.1, 10.0))
    assert right < 0.5 * without
    assert max(small, large) < 1.3 * right  # times what the fit finds


def test_a_swing_in_the_first_rows_is_no_noise_of_stars():
    run = rows(90, 11)
    run.columns['el_enc'] = run['el_enc'] + 30.0 * ARCSEC * np.sin(np.arange(90) / 5.0)
    missed = track_run(run, first=30).summary()['missed_rms_arcsec']
    assert missed['model of the evening'] > 20.0 > 12.0 > missed['expected']
    assert missed['tracked'] < 1.3 * missed['expected']


def test_the_order_of_the_rows_is_that_of_their_times():
    run, order = drifting(), np.random.default_rng(4).permutation(60)
    one, other = track_run(run, MOUNT), track_run(run.select(order), MOUNT)
    assert one.fitted == 0 and np.array_equal(order[other.rows], one.rows)
    assert np.array_equal(one.live, other.live) and np.array_equal(one.time, other.time)
    assert one.time[0] == run['time'][0]


def test_its_page_is_whole():
    tracked = track_run(drifting(), first=15)
    page = render_track(tracked, ())
    ElementTree.fromstring(page.removeprefix('<!DOCTYPE html>\n'))
    assert '://' not in page and 'jumped before star 30' in page
    assert 'a wrong star' in page and 'zero of the azimuth encoder off, changing' in page
    assert json.loads(json.dumps(worded(tracked.summary())))['fitted_rows'] == 15


def test_what_it_cannot_follow():
    run = drifting()
    with pytest.raises(ValueError, match='no time'):
        track_run(run.__class__({k: v for k, v in run.columns.items() if k != 'time'}))
    with pytest.raises(ValueError, match='takes three more'):
        track_run(run.select(np.arange(14)))
    other = run.__class__(run.columns, {'mount': Mount.equatorial(0.5)})
    with pytest.raises(ValueError, match='another mount'):
        track_run(other, MOUNT)
