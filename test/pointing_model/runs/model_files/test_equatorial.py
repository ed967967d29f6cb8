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

"""Models of equatorial mounts for other programs, and back: signs, sides of the pier."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from msg_tools.units import ARCSEC, wrap
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.mounts import Mount
from pointing_model.pointing_terms import terms_of
from pointing_model.runs.model_files import (
    coefficient_table as table,
)
from pointing_model.runs.model_files.transfer import export, program_for, uniform_sky
from pointing_model.runs.model_reader import read_model
from pointing_model.runs.programs import PROGRAMS

PHI = math.radians(33.3)
GERMAN, FORK = Mount.equatorial(PHI, 'german'), Mount.equatorial(PHI)
SEVEN = {name: value * ARCSEC for name, value in {
    'IH': 212.5, 'ID': -131.25, 'CH': 44.0, 'NP': -18.5, 'MA': 30.75, 'ME': -64.0,
    'TF': 15.5}.items()}
NINE = {**SEVEN, 'FO': 6.0 * ARCSEC, 'DAF': -4.0 * ARCSEC}
MORE = {'HCES': 3.0 * ARCSEC, 'HDSH2': -2.0 * ARCSEC, 'TX': 5.0 * ARCSEC, 'DCES': 4.0 * ARCSEC}


def apart(one, other, dec):
    """Largest difference on the sky, arcsec."""
    return np.hypot(wrap(one[0] - other[0]) * np.cos(dec), wrap(one[1] - other[1])).max() / ARCSEC


def test_the_sky_of_a_german_mount_has_both_sides_of_the_pier():
    sky = uniform_sky(200, GERMAN)
    beyond = np.abs(wrap(sky.el)) > np.pi / 2
    assert beyond.sum() == 100
    # on either the counterweight is down
    assert (np.mod(sky.az, 2.0 * np.pi) <= np.pi).all()
    assert np.rad2deg(GERMAN.horizon_of(sky.az, sky.el)[1]).min() > 20.0
    assert not (np.abs(uniform_sky(200, FORK).el) > np.pi / 2).any()


def test_tpoints_signs_are_those_of_its_corrections():
    """Encoder to star, in hour angle and declination: Wallace's Bfun and TPOINT's own formulae."""
    ha, dec = 0.7, 0.5
    sh, ch, sd, cd = math.sin(ha), math.cos(ha), math.sin(dec), math.cos(dec)
    sp, cp = math.sin(PHI), math.cos(PHI)
    sin_el = sp * sd + cp * cd * ch
    tf = np.array([cp * sh, cp * ch * sd - sp * cd])
    theirs = {'IH': (cd, 0), 'ID': (0, 1), 'CH': (1, 0), 'NP': (sd, 0), 'ME': (sh * sd, ch),
              'MA': (-ch * sd, sh), 'TF': tf, 'TX': tf / sin_el, 'FO': (0, ch),
              'DAF': (-sin_el, 0), 'HCES': (sh * cd, 0), 'HCEC': (ch * cd, 0), 'DCES': (0, sd),
              'DCEC': (0, cd)}
    program = program_for(PROGRAMS['tpoint'], FORK)
    from pointing_model.pointing_terms import Trig
    for name, expected in theirs.items():
        ((own, share),) = program.column(name)
        x, y = terms_of(FORK)[own[0]].of(Trig(ha, dec, FORK))
        np.testing.assert_allclose([-share * x, -share * y], expected, atol=1e-14, err_msg=name)


def test_effects_that_are_terms_of_the_program_go_by_name():
    effects = [effect('encoder', axis='el', order=1, mount='german'),
               effect('nod', order=1, mount='german'), effect('term', name='HZCZ', mount='german')]
    values = [3.0, -2.0], [1.5, 4.0], [6.0]
    model = replace(PointingModel(SEVEN, mount=GERMAN), effects=[
        FittedEffect(one, np.array(v) * ARCSEC) for one, v in zip(effects, values)])
    exported = export(model, PROGRAMS['tpoint'])
    assert not exported.left and not exported.added and exported.loss.largest < 0.01
    named = {name: value for name, value, _ in exported.listed()}
    for name, value in {'DCEC': -3.0, 'DCES': 2.0, 'HDSH': -4.0, 'HZCZ': 6.0}.items():
        assert named[name] == pytest.approx(value, abs=0.01), name
    # what is none of them is told, and the rest stays by name
    grows = effect('polynomial', result='az', of='az', power=1, mount='german')
    exported = export(replace(model, effects=[*model.effects, FittedEffect(
        grows, [1.0 * ARCSEC])]), PROGRAMS['tpoint'])
    assert exported.left == [grows.name]


@pytest.mark.parametrize('mount', [FORK, GERMAN], ids=['fork', 'german'])
@pytest.mark.parametrize('name, geometry, terms', [
    ('tpoint', 'rotation', {**NINE, **MORE}), ('rts2', 'first_order', NINE)])
def test_a_model_comes_back_to_a_thousandth_of_an_arcsecond(tmp_path, mount, name, geometry, terms):
    model = PointingModel(terms, geometry=geometry, mount=mount)
    exported = export(model, PROGRAMS[name])
    assert exported.held and not exported.refitted
    path = tmp_path / 'model'
    path.write_text(exported.text)
    sky = uniform_sky(200, mount)
    got = read_model(path, mount).model
    assert got.mount == mount
    there, here = (m.sky_to_encoder(sky.az, sky.el) for m in (model, got))
    assert apart(there, here, sky.el) < 1e-3
    with pytest.raises(ValueError, match='equatorial mount'):
        read_model(path)


def gem(text, ha, dec):
    """What RTS2 adds to hour angle and declination, radians: its published formulae."""
    words = next(line for line in text.splitlines() if line.startswith('RTS2')).split()
    d0, me, ma, tf, ih, ch, np_, daf, fo = (float(w.rstrip('"')) * ARCSEC for w in words[1:])
    sp, cp = math.sin(PHI), math.cos(PHI)
    d_dec = d0 + me * math.cos(ha) + ma * math.sin(ha) + fo * math.cos(ha) + tf * (
        cp * math.sin(dec) * math.cos(ha) - sp * math.cos(dec))
    d_ha = ih + ch / math.cos(dec) + np_ * math.tan(dec) + (
        me * math.sin(ha) - ma * math.cos(ha)) * math.tan(dec) \
        + tf * cp * math.sin(ha) / math.cos(dec) \
        + daf * (sp * math.tan(dec) + cp * math.cos(ha))
    return d_ha, d_dec


@pytest.mark.parametrize('mount', [FORK, GERMAN], ids=['fork', 'german'])
def test_signs_of_rts2_are_those_of_its_formulae(mount):
    model = PointingModel(NINE, geometry='first_order', mount=mount)
    text = export(model, PROGRAMS['rts2']).text
    sky = uniform_sky(60, mount)
    got = model.sky_to_encoder(sky.az, sky.el)
    for i in range(len(sky)):
        d_ha, d_dec = gem(text, sky.az[i], sky.el[i])
        assert wrap(got[0][i] - sky.az[i]) * math.cos(sky.el[i]) == pytest.approx(
            d_ha * math.cos(sky.el[i]), abs=1e-5 * ARCSEC)
        assert wrap(got[1][i] - sky.el[i]) == pytest.approx(d_dec, abs=1e-5 * ARCSEC)


@pytest.mark.parametrize('mount', [FORK, GERMAN], ids=['fork', 'german'])
def test_spks_rotations_are_ours_on_both_sides_of_the_pier(mount):
    """Another geometry, by the author of TPOINT: each term alone, large, is the same rotation."""
    for name in SEVEN:
        size = 15.0 if name == 'TF' else 1800.0  # where along its way the droop is taken
        exported = export(PointingModel({name: size * ARCSEC}, mount=mount), PROGRAMS['spk'])
        assert exported.direct.largest < (0.05 if name == 'TF' else 1e-6), name
    exported = export(PointingModel(SEVEN, mount=mount), PROGRAMS['spk'])
    assert exported.loss.rms < 0.01 and exported.left == []


def goto(text, ha, dec, side):
    """What OnStepX makes of a place and a side of the pier, radians: its published formulae."""
    c = {n: int(v) * ARCSEC for n, v in re.findall(r':SX0(\w),(-?\d+)#', text)}
    ax1, ax2, alt, azm, do, pd, ff, tf = (c[n] for n in '01234568')
    sp, cp = math.sin(PHI), math.cos(PHI)
    a1, a2 = ha, dec
    for _ in range(3):
        t1 = (alt * math.sin(a1) - azm * math.cos(a1)) * math.tan(a2) + side * (
            do / math.cos(a2) - pd * math.tan(a2)) + tf * cp * math.sin(a1) / math.cos(a2)
        t2 = azm * math.sin(a1) + (alt + ff) * math.cos(a1) + tf * (
            cp * math.cos(a1) * math.sin(a2) - sp * math.cos(a2))
        a1, a2 = ha + t1, dec + t2
    a1, a2 = a1 - ax1, a2 + side * ax2
    return (a1, a2) if side > 0 else (a1 + math.pi, math.pi - a2)


@pytest.mark.parametrize('mount', [FORK, GERMAN], ids=['fork', 'german'])
def test_signs_of_onstepx_are_those_of_its_formulae(tmp_path, mount):
    terms = {**SEVEN, **({'FO': 20.0 * ARCSEC} if mount is FORK else {})}
    exported = export(PointingModel(terms, geometry='first_order', mount=mount),
                      PROGRAMS['onstepx'])
    assert exported.loss.rms < 1.0 and exported.left == []
    path = tmp_path / 'onstep.txt'
    path.write_text(exported.text)
    sky = uniform_sky(100, mount)
    got = read_model(path, mount).model.sky_to_encoder(sky.az, sky.el)
    there = np.empty((2, 100))
    for i, (ha, dec) in enumerate(zip(sky.az, sky.el)):
        beyond = math.cos(dec) < 0.0
        place = (ha - math.pi, math.pi - dec) if beyond else (ha, dec)
        there[:, i] = goto(exported.text, *place, -1.0 if beyond else 1.0)
    low = np.abs(np.cos(sky.el)) > 0.3  # near the pole the second order is not ours
    assert apart([g[low] for g in got], there[:, low], sky.el[low]) < 0.3
    again = export(read_model(path, mount).model, PROGRAMS['onstepx'])
    assert again.text.splitlines()[1:] == exported.text.splitlines()[1:]


def test_rotations_for_rts2_are_refitted_and_the_loss_is_told():
    exported = export(PointingModel(NINE, mount=GERMAN), PROGRAMS['rts2'])
    assert exported.refitted and not exported.held and exported.left == []
    assert exported.loss.rms < exported.direct.rms
    exported = export(PointingModel({**NINE, 'HCES': 30.0 * ARCSEC}, mount=GERMAN),
                      PROGRAMS['rts2'])
    assert exported.left == ['HCES'] and 1.0 < exported.loss.rms < 30.0


def test_the_table_takes_the_terms_of_the_mount(tmp_path):
    model = PointingModel(NINE, mount=GERMAN)
    path = tmp_path / 'model.csv'
    path.write_text(table.write(model, 'caption'))
    got = read_model(path, GERMAN).model
    assert got.terms == pytest.approx(model.terms) and got.mount == GERMAN


def test_what_is_of_another_mount_is_one_line(tmp_path):
    with pytest.raises(ValueError, match='katpoint .* alt-azimuth mounts only'):
        export(PointingModel(NINE, mount=GERMAN), PROGRAMS['katpoint'])
    path = tmp_path / 'model'
    for text, words in (('RTS2_ALTAZ 1 2 3 4 5 6 7', 'of an alt-azimuth mount'),
                        ('RTS2_GEM 1" 2"', 'RTS2_MODEL and nine'),
                        ('c\nT 3 1.0 0.0 0.0\n  IA  3.0 1.0\nEND\n', 'IA .row 3. is no term'),
                        ('0.1 0 0.2', 'alt-azimuth mounts only'),
                        (':SX00,3#\n:SX06,9#', 'dfCor is not read')):
        path.write_text(text)
        with pytest.raises(ValueError, match=words):
            read_model(path, GERMAN)
    PointingModel(NINE, mount=FORK).save(tmp_path / 'm.json')
    with pytest.raises(ValueError, match='another mount .equatorial, latitude [0-9.-]+. than'):
        read_model(tmp_path / 'm.json', GERMAN)
    near = Mount.equatorial(FORK.latitude + np.radians(1e-4))
    with pytest.raises(ValueError, match='another mount') as refused:
        read_model(tmp_path / 'm.json', near)
    assert f'{np.degrees(near.latitude):.7g}' in str(refused.value)
