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

"""Columns that are not what they are named are told; what is right passes."""

from itertools import product

import numpy as np
import pytest
from places import ROOT

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.mistaken_columns import MistakenColumns, check_columns
from calibration.analysis.run_fit import fit_run
from calibration.report.diagnosis_view import view_of
from calibration.report.row_wording import signs_sentences
from calibration.report.wording import wording
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.geometry import sky_to_encoder
from pointing_model.model import PointingModel
from pointing_model.mounts import Mount
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run

SHARED = ROOT.parent / 'shared' / 'data'
NAMES = ('az', 'el', 'az_enc', 'el_enc')


def telescope(seed, n, terms, az=(0.0, 360.0), noise=1.0):
    """The four columns of a mount with terms in arcsec."""
    rng = np.random.default_rng(seed)
    a, e = rng.uniform(*az, n) * DEG, np.arcsin(rng.uniform(0.3, 0.995, n))
    a_enc, e_enc = sky_to_encoder(a, e, {k: v * ARCSEC for k, v in terms.items()})
    x, y = rng.normal(size=(2, n)) * noise * ARCSEC
    seen = np.isfinite(a_enc)
    return [v[seen] for v in (a, e, a_enc + x / np.cos(e), e_enc + y)]


def mmt():
    run = read_run(ROOT / 'calibration' / 'data' / 'mmt_2021-08-21.csv')
    return [np.asarray(run[name]) for name in NAMES]


TELESCOPES = {
    'mmt': mmt,
    'squared': lambda: telescope(3, 60, {
        'IA': 60, 'IE': -35, 'CA': 12, 'NPAE': -6, 'AN': 8, 'AW': -10, 'TF': 14}),
    # a zero anywhere and terms of a degree
    'crooked': lambda: telescope(4, 60, {
        'IA': 360000, 'IE': 3600, 'CA': 4000, 'NPAE': -2500, 'AN': 5000, 'AW': -3000, 'TF': 600}),
}

MISTAKES = {
    'swapped': lambda a, e: (e, np.mod(a, 2.0 * np.pi)),
    'zenith': lambda a, e: (a, np.pi / 2 - e),
    'reversed': lambda a, e: (-a, e),
    'south': lambda a, e: (np.mod(np.pi - a, 2.0 * np.pi), e),
    'hours': lambda a, e: (np.mod(a, 2.0 * np.pi) / 15.0, e),
    'arcseconds': lambda a, e: (3600.0 * a, 3600.0 * e),
}
SAID = {'swapped': 'azimuth and elevation {} exchanged', 'zenith': 'zenith distance in place of '
        'the elevation {}', 'reversed': 'azimuth {} counted the other way', 'hours': 'azimuth {} '
        'in hours', 'arcseconds': 'azimuth and elevation {} in arcseconds',
        'south': 'azimuth {} counted from the south through east'}
WHERE = {'catalogue': 'of the catalogue', 'encoders': 'of the encoders',
         'both': 'of catalogue and encoders'}


def run_of(columns):
    """As a reader hands it over: what no telescope looks at is left out, and kept aside."""
    az, el, az_enc, el_enc = columns
    lost = (el < -5.0 * DEG) | (el > 90.1 * DEG)
    for value in columns:
        lost |= np.abs(value) > 20.0 * np.pi
    line = np.arange(len(az))
    return PointingRun(
        {n: v[~lost] for n, v in zip(NAMES, columns)},
        {'lines': line[~lost], 'as_written': {
            'line': line, 'misplaced': lost, 'misplaced_rows': int(lost.sum()),
            **dict(zip(NAMES, columns))}})


def mistaken(columns, kind, where):
    az, el, az_enc, el_enc = columns
    if where in ('catalogue', 'both'):
        az, el = MISTAKES[kind](az, el)
    if where in ('encoders', 'both'):
        az_enc, el_enc = MISTAKES[kind](az_enc, el_enc)
    return run_of((az, el, az_enc, el_enc))


@pytest.mark.parametrize('name, kind, where', [
    *product(('mmt', 'crooked'), MISTAKES, WHERE), ('squared', 'swapped', 'both'),
    ('squared', 'zenith', 'catalogue'), ('squared', 'south', 'encoders')])
def test_mistaken_columns_are_named(name, kind, where):
    run = mistaken(TELESCOPES[name](), kind, where)
    if where == 'both' and kind in ('reversed', 'south'):
        # the mirror image of a mount is a mount
        assert 'azimuth of catalogue and encoders counted the other way' \
            in check_columns(run).alike
        return
    with pytest.raises(MistakenColumns, match='Nothing was concluded') as told:
        check_columns(run)
    expected = SAID[kind].format(WHERE[where])
    if kind == 'south' and name == 'crooked':  # its zero is no south
        expected = SAID['reversed'].format(WHERE[where])
    rms = {entry['reading']: entry['rms_arcsec'] for entry in told.value.readings}
    assert 1.0 < rms[expected] < 2.0
    # where one pair is reversed, nothing tells which
    assert len(rms) == (2 if kind in ('reversed', 'south') else 1)
    assert f'{expected} ({rms[expected]:.1f} arcsec)' in str(told.value)
    assert '\n' not in str(told.value) and told.value.rows_read in (60, 80)


@pytest.mark.parametrize('where', ['catalogue', 'encoders'])
def test_an_azimuth_from_the_south_in_one_pair_is_named(where):
    for name in ('mmt', 'squared'):
        columns = TELESCOPES[name]()
        i = 0 if where == 'catalogue' else 2
        columns[i] = columns[i] + np.pi
        with pytest.raises(MistakenColumns, match='azimuth of one of the two pairs counted from '
                                                  'the south'):
            check_columns(run_of(columns))


@pytest.mark.parametrize('offsets', [False, True])
def test_a_mount_synchronised_on_each_star_is_named(offsets):
    az, el, az_enc, el_enc = TELESCOPES['squared']()
    x, y = (np.diff(one, prepend=0.0) for one in (wrap(az_enc - az), el_enc - el))
    run = run_of((az, el, az + x, el + y))
    if offsets:
        run.meta['raw_reading'] = False
    with pytest.raises(MistakenColumns, match='the mount was synchronised on each star') as refused:
        check_columns(run)
    (reading,) = refused.value.readings
    assert 'added up' in reading['reading'] and 1.0 < reading['rms_arcsec'] < 2.0


@pytest.mark.parametrize('unit', ['degrees', 'arcseconds'])
@pytest.mark.parametrize('on_sky', [False, True])
@pytest.mark.parametrize('name', ['mmt', 'crooked'])
def test_offsets_in_place_of_readings_are_named(name, unit, on_sky):
    az, el, az_enc, el_enc = TELESCOPES[name]()
    x, y = wrap(az_enc - az), el_enc - el
    factor = 3600.0 if unit == 'arcseconds' else 1.0
    if on_sky:
        x = x * np.cos(el)
    with pytest.raises(MistakenColumns) as told:
        check_columns(run_of((az, el, factor * x, factor * y)))
    said = f'offsets in place of the encoders\' readings, in {unit}{" on the sky" * on_sky}, '
    readings = [entry['reading'] for entry in told.value.readings]
    assert f'{said}encoder - catalogue' in readings
    assert set(readings) <= {f'{said}encoder - catalogue', f'{said}catalogue - encoder'}


def test_mount_and_catalogue_exchanged_show_where_the_terms_are_large():
    for name in ('mmt', 'squared'):
        az, el, az_enc, el_enc = TELESCOPES[name]()
        assert 'mount and catalogue exchanged' in check_columns(
            run_of((az_enc, el_enc, az, el))).alike
    az, el, az_enc, el_enc = TELESCOPES['crooked']()
    with pytest.raises(MistakenColumns, match='fit: mount and catalogue exchanged'):
        check_columns(run_of((az_enc, el_enc, az, el)))


def test_a_drift_is_no_doubt_of_the_columns():
    rng = np.random.default_rng(45)  # read in gradians the run fits 1.2 times as well
    az, el = rng.uniform(0.0, 2.0 * np.pi, 80), np.arcsin(rng.uniform(0.26, 0.996, 80))
    drift = np.linspace(0.0, 67.0, 80)
    x, y = ARCSEC * (rng.normal(size=(2, 80)) + [np.zeros(80), drift])
    model = PointingModel({'IA': 500.0 * ARCSEC, 'AN': 15.0 * ARCSEC, 'AW': -20.0 * ARCSEC})
    az_enc, el_enc = model.sky_to_encoder(az, el)
    checked = check_columns(run_of((az, el, az_enc + x / np.cos(el), el_enc + y)))
    assert checked.doubts(Mount().names) == []


@pytest.mark.parametrize('latitude, noise, reported', [
    (-35.3, 0.0, False), (-35.3, 1.0, False), (-77.0, 0.0, False), (35.3, 0.0, False),
    (-5.0, 0.0, True), (-5.0, 1.0, True)])
def test_declinations_with_the_other_sign_are_no_doubt_where_their_stars_are_below_the_horizon(
        latitude, noise, reported):
    rng = np.random.default_rng(3)
    mount = Mount.equatorial(latitude * DEG)
    h, d = mount.axes_of(rng.uniform(0.0, 2.0 * np.pi, 40),
                         np.arcsin(rng.uniform(0.35, 0.98, 40)))
    model = PointingModel({'ME': 1800.0 * ARCSEC, 'MA': -900.0 * ARCSEC}, mount=mount)
    h_enc, d_enc = model.sky_to_encoder(h, d)
    x, y = (noise + 0.01) * ARCSEC * rng.normal(size=(2, 40))
    columns = h, d, h_enc + x / np.cos(d), d_enc + y

    def run(columns):
        return PointingRun(dict(zip(NAMES, columns)), {'mount': mount})
    checked = check_columns(run(columns))
    said = 'declination of catalogue and encoders with the other sign'
    # the mirror image of a mount without flexure fits as well near the equator: no doubt of a run
    assert (said in checked.alike) == reported
    assert not any('declination' in wording(found) for found in checked.doubts(mount.names))
    assert any(said in text for text in signs_sentences(checked.alike, mount.names)) == reported
    if noise and not reported:
        with pytest.raises(MistakenColumns, match='with the other sign'):
            check_columns(run((h, -d, columns[2], -columns[3])))


def test_two_mistakes_are_named():
    az, el, az_enc, el_enc = TELESCOPES['mmt']()
    zenith = [np.pi / 2 - el, np.pi / 2 - el_enc]
    with pytest.raises(MistakenColumns, match='azimuth of the catalogue in hours, and zenith '
                                              'distance in place of the elevation of catalogue '
                                              'and encoders'):
        check_columns(run_of((np.mod(az, 2 * np.pi) / 15.0, zenith[0], az_enc, zenith[1])))


def test_offsets_that_the_file_gives_are_held_where_the_places_are_wrong():
    az, el, az_enc, el_enc = TELESCOPES['squared']()
    x, y = wrap(az_enc - az) * np.cos(el), el_enc - el

    def run(a, e):
        return PointingRun({'az': a, 'el': e, 'az_enc': a + x / np.cos(e), 'el_enc': e + y},
                           {'raw_reading': False})
    with pytest.raises(MistakenColumns, match='fit: azimuth of the catalogue in hours'):
        check_columns(run(az / 15.0, el))
    # an encoder off its centre and a second flexure would do the same
    note = wording(*check_columns(run(az, np.pi / 2 - el)).findings)
    assert 'zenith distance in place of the elevation of the catalogue' in note


def held(columns, work=lambda x, y, c: (x, y)):
    """A run whose file gives offsets on the sky, as `work` writes them."""
    az, el, az_enc, el_enc = columns
    x, y = work(wrap(az_enc - az) * np.cos(el), el_enc - el, np.cos(el))
    return PointingRun({'az': az, 'el': el, 'az_enc': az + x / np.cos(el), 'el_enc': el + y},
                       {'raw_reading': False})


def test_offsets_that_are_not_what_they_are_named_are_refused_or_noted():
    columns = TELESCOPES['squared']()
    assert check_columns(held(columns)).findings == []
    for said, work in {
            r'column x_arcsec not multiplied by cos\(elevation\)': lambda x, y, c: (x / c, y),
            r'column x_arcsec multiplied twice by cos\(elevation\)': lambda x, y, c: (x * c, y),
            'columns x_arcsec and y_arcsec exchanged': lambda x, y, _: (y, x),
            'columns x_arcsec and y_arcsec exchanged, one of them with the other sign':
            lambda x, y, _: (-y, x)}.items():
        with pytest.raises(MistakenColumns, match=rf'fit: {said} \(1\.\d arcsec\)'):
            check_columns(held(columns, work))


@pytest.mark.usefixtures('short_diagnosis')
def test_a_reading_that_fits_as_well_as_the_effects_stands_first():
    columns = telescope(3, 60, {'IA': 120, 'IE': -40, 'CA': 15, 'NPAE': -8, 'AN': 20, 'AW': 12,
                                'TF': 25}, noise=0.5)
    said = 'column x_arcsec or y_arcsec with the other sign'
    for work in (lambda x, y, _: (-x, y), lambda x, y, _: (x, -y)):
        run = held(columns, work)
        found, = check_columns(run).findings
        assert said in found.causes and found.after < 1.0 < found.before
        result = diagnose(run)
        assert result.verdict == 'ambiguous' and result.cautions == [found]
        view = view_of(result)
        assert said in view.summary.cautions[0] and 'would fit to 0.' in view.summary.cautions[0]
        assert view.summary.effects[0].check == 'the columns of the file'
        assert said in view.summary.effects[0].causes
        assert not view.summary.todo
        assert wording(fit_run(run).findings[0]) == wording(found)


def test_right_columns_pass():
    """Terms from none to degrees, any zero, few rows, a strip of sky; beside that, effects."""
    for seed in range(36):
        rng = np.random.default_rng(seed)
        n = int(rng.choice([12, 20, 40, 120]))
        terms = {name: rng.normal() * 10**rng.uniform(0.0, 3.8)
                 for name in ('IA', 'IE', 'CA', 'NPAE', 'AN', 'AW', 'TF') if rng.random() < 0.7}
        if rng.random() < 0.3:
            terms['IA'] = rng.uniform(-170.0, 170.0) * 3600.0
        if rng.random() < 0.2:
            terms['IE'] = 3600.0
        start, width = rng.uniform(0.0, 360.0), rng.choice([30.0, 90.0, 180.0, 360.0])
        az, el, az_enc, el_enc = telescope(
            seed, n, terms, (start, start + width), 10**rng.uniform(-0.5, 1.0))
        size = 10**rng.uniform(0.0, 1.7) * ARCSEC
        x, y = [(0.0, size * np.sin(el)), (0.0, size / np.tan(el)),
                (size * np.cos(2.0 * az) * np.cos(el), 0.0), (0.0, size * np.cos(az)),
                (size * np.linspace(0.0, 1.0, len(az)), 0.0), (0.0, 0.0)][seed % 6]
        check_columns(run_of((az, el, az_enc + x / np.cos(el), el_enc + y)))


def test_an_effect_that_a_wrong_reading_explains_too_is_noted():
    az, el, az_enc, el_enc = telescope(8, 60, {'IA': 80, 'IE': -40})
    checked = check_columns(run_of((az, el, az_enc, el_enc + 60.0 * ARCSEC * np.sin(el))))
    note = wording(*checked.findings)
    assert 'zenith distance in place of the elevation of catalogue and encoders' in note
    assert 'Check the columns' in note


def test_outliers_and_what_fits_nothing():
    columns = TELESCOPES['squared']()
    columns[2][:6] += 0.5 * DEG
    check_columns(run_of(columns))
    rng = np.random.default_rng(1)
    columns[3] = np.arcsin(rng.uniform(0.3, 0.99, 60))
    with pytest.raises(MistakenColumns, match='^catalogue and encoders do not belong together: 60 '
                       'of 60 .* No other reading that was tried fits'):
        check_columns(run_of(columns))


def test_every_run_is_judged_and_many_rows_cost_little():
    right = TELESCOPES['squared']()
    wrong = mistaken(right, 'zenith', 'encoders')
    wrong.meta['source'] = '/somewhere/second.csv'
    with pytest.raises(MistakenColumns, match='^second.csv: '):
        check_columns([run_of(right), wrong])
    with pytest.raises(MistakenColumns, match='^second.csv: '):
        diagnose(run_of(right), holdout=wrong)
    assert check_columns(run_of(telescope(9, 50000, {'IA': 30, 'AN': 20}))).findings == []
    # two numbers, one direction: nothing to judge
    assert check_columns(run_of([v[:3] for v in right])).alike == []
    assert check_columns(run_of([np.full(20, v[0]) for v in right])).alike == []


def test_measured_runs_pass():
    files = sorted((SHARED / 'arc35m').glob('*.dat')) + sorted((SHARED / 'iram30m').glob('*.log'))
    files += [SHARED / 'spk8m' / 'pmfit_altaz.dat', SHARED / 'mmt' / 'k_and_e.dat',
              SHARED / 'mmt' / 'point_20210821.dat']
    if not files[0].is_file():
        pytest.skip(f'no measured runs in {SHARED}')
    passed = 0
    for path in files[::3]:
        try:
            run = read_run(path)
        except ValueError:
            continue  # a header without rows
        check_columns(run)
        passed += 1
    assert passed >= 23
