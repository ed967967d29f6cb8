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

"""Models of other programs: their files, their signs against what they compute, round trips."""

import math
import re
from xml.etree import ElementTree

import erfa
import numpy as np
import pytest

from msg_tools.units import ARCSEC, wrap
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.harmonics import COUNT, Harmonics
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL, TERMS, Trig
from pointing_model.runs.model_files import (
    coefficient_table as table,
)
from pointing_model.runs.model_files.term_columns import TERM_KEYS, model_columns, on_sky, summed
from pointing_model.runs.model_files.transfer import export, uniform_sky
from pointing_model.runs.model_reader import read_model
from pointing_model.runs.programs import PROGRAMS
from pointing_model.runs.programs.tpoint import columns_of

SEVEN = dict(zip(PHYSICAL, np.array([412.5, -31.25, 25.0, -18.5, 30.75, -22.0, 15.5]) * ARCSEC))
SKY = uniform_sky(200)


def seven(geometry='first_order', **more):
    return PointingModel({**SEVEN, **{k: v * ARCSEC for k, v in more.items()}}, geometry=geometry)


def apart(one, other, el):
    """Largest difference on the sky, arcsec."""
    return np.hypot(wrap(one[0] - other[0]) * np.cos(el), one[1] - other[1]).max() / ARCSEC


def back(tmp_path, exported):
    path = tmp_path / f'model.{exported.program.name}'
    path.write_text(exported.text)
    return read_model(path)


def round_trip(tmp_path, model, name):
    """The model exported and read again: largest difference on the sky, arcsec, and the export."""
    exported = export(model, PROGRAMS[name])
    model_back = back(tmp_path, exported).model
    there, here = (m.sky_to_encoder(SKY.az, SKY.el) for m in (model, model_back))
    return apart(there, here, SKY.el), exported


# ------------------------------------------------------------------------------- what we compare by

def test_every_term_has_the_column_of_its_definition():
    assert set(TERM_KEYS) <= set(TERMS)
    trig = Trig(SKY.az, SKY.el)
    for name, key in TERM_KEYS.items():
        if name in ('AN', 'AW'):
            continue
        result, factors = key
        made = PointingModel({}, geometry='first_order', effects=[FittedEffect(
            effect('product', result=result, factors=list(factors)), [ARCSEC])])
        expected = np.zeros((2, len(SKY)))
        expected[0], expected[1] = TERMS[name].of(trig)
        got = np.stack(made.offsets(SKY.az, SKY.el)) / ARCSEC
        np.testing.assert_allclose(got, expected, atol=1e-7, err_msg=name)
        np.testing.assert_array_equal(on_sky(key, SKY.az, SKY.el), expected)


def test_effects_and_harmonics_are_the_sum_of_their_columns():
    rng = np.random.default_rng(1)
    forms = [('encoder', {'axis': 'az', 'order': 3}), ('encoder', {'axis': 'el', 'order': 2}),
             ('bearing_wobble', {'order': 2}), ('nod', {'order': 4}),
             ('line_of_sight', {'order': 3}), ('elevation_axis_wobble', {'order': 2}),
             ('fork_cross_term', {}), ('terms', {'name': 'refraction'}),
             ('term', {'name': 'HVCA2'}), ('latitude', {}), ('diurnal_aberration', {})]
    effects = []
    for form, parameters in forms:
        made = effect(form, **parameters)
        effects.append(FittedEffect(made, rng.normal(size=len(made.coefficient_names)) * ARCSEC))
    series = Harmonics('zenith', *rng.normal(size=(2, COUNT)) * ARCSEC,
                       np.zeros((2 * COUNT, 2 * COUNT)))
    model = PointingModel(SEVEN, None, series, geometry='first_order', effects=effects)
    values, _, left = model_columns(model)
    assert left == []
    difference = summed(values, SKY.az, SKY.el) - np.stack(model.offsets(SKY.az, SKY.el))
    assert np.abs(difference).max() < 1e-9 * ARCSEC


# ----------------------------------------------------------- signs, against what each one computes

def test_signs_of_katpoint_are_those_of_katpoint(tmp_path):
    katpoint = pytest.importorskip('katpoint')
    model = seven(ECES=7.0, ACEC=-6.0, ACES=5.0, HECA2=4.0, HESA2=-3.0, HACA2=2.0, HASA2=1.5,
                  HECA=-1.0, HESA=0.5)
    exported = export(model, PROGRAMS['katpoint'])
    path = tmp_path / 'a.ini'
    path.write_text(exported.text)
    theirs = katpoint.PointingModel()
    with open(path) as stream:
        theirs.fromfile(stream)
    from pointing_model.runs.programs.katpoint import description
    for one in (theirs, katpoint.PointingModel(description(exported.terms))):
        assert apart(one.apply(SKY.az, SKY.el), model.sky_to_encoder(SKY.az, SKY.el),
                     SKY.el) < 1e-6
    # and a model that katpoint wrote, scales and 8E too
    theirs = katpoint.PointingModel('0.01 0 -0.02 0.03 0:01:30 -0:00:20 0.005 0.004 2e-5 0 0.003 '
                                    '3e-5 0 0 0 0 0 0 0.001 -0.002 0.0015')
    text = tmp_path / 'b.txt'
    text.write_text(theirs.description)
    rounded = katpoint.PointingModel(theirs.description)
    ours = read_model(text).model
    assert apart(rounded.apply(SKY.az, SKY.el), ours.sky_to_encoder(SKY.az, SKY.el),
                 SKY.el) < 1e-6
    with open(tmp_path / 'c.ini', 'w') as stream:
        theirs.tofile(stream)
    ours = read_model(tmp_path / 'c.ini').model
    assert apart(rounded.apply(SKY.az, SKY.el), ours.sky_to_encoder(SKY.az, SKY.el),
                 SKY.el) < 1e-6


def test_signs_of_tpoint_are_those_of_pytelpoint():
    """pytelpoint corrects raw to observed with TPOINT's names, to first order."""
    transform = pytest.importorskip('pytelpoint.transform')
    import astropy.units as u
    from astropy.coordinates import SkyCoord
    model = seven('rotation', TX=3.0)
    terms = export(model, PROGRAMS['tpoint']).terms
    az, el = model.sky_to_encoder(SKY.az, SKY.el)
    raw = SkyCoord(az * u.rad, el * u.rad, frame='altaz')
    out = transform.azel_model(raw, **{k.lower(): v / ARCSEC for k, v in terms.items()})
    low = SKY.el < np.radians(70.0)  # higher up the second order is no test of signs
    assert apart((out.az.rad[low], out.alt.rad[low]), (SKY.az[low], SKY.el[low]),
                 SKY.el[low]) < 0.2


def test_tpoints_generic_names_are_those_of_its_convention():
    """Corrections take the encoder to the star; azimuth S = 0, E = 90."""
    their_az, z = np.pi - SKY.az, 0.5 * np.pi - SKY.el
    sin, cos = np.sin, np.cos
    cases = {
        'HASA2': ('A', sin(2 * their_az)), 'HACA3': ('A', cos(3 * their_az)),
        'HSCACE4': ('S', cos(their_az) * cos(4 * SKY.el)), 'HVSA2': ('V', sin(2 * their_az)),
        'HESA3CE3': ('E', sin(3 * their_az) * cos(3 * SKY.el)), 'HECA': ('E', cos(their_az)),
        'HESE4': ('E', sin(4 * SKY.el)), 'HZSZ': ('Z', sin(z)), 'HZCZ3': ('Z', cos(3 * z)),
        'HZSZ2': ('Z', sin(2 * z)), 'HZCZ4': ('Z', cos(4 * z)), 'PZZ1': ('Z', z),
        'PEE1': ('E', SKY.el), 'PAA1': ('A', their_az), 'PAA3': ('A', their_az**3),
        'PZZ2': ('Z', z**2), 'ECEC': ('E', cos(SKY.el)), 'HSCE5': ('S', cos(5 * SKY.el)),
    }
    for name, (result, value) in cases.items():
        # encoder - star is the opposite of the correction, and their azimuth runs against ours
        x, y = {'A': (value * cos(SKY.el), 0.0), 'S': (value, 0.0), 'V': (value * sin(SKY.el), 0.0),
                'E': (0.0, -value), 'Z': (0.0, value)}[result]
        got = sum(share * on_sky(key, SKY.az, SKY.el) for key, share in columns_of(name))
        np.testing.assert_allclose(got[0], x, atol=1e-12, err_msg=name)
        np.testing.assert_allclose(got[1], y, atol=1e-12, err_msg=name)
    for name, term in TERMS.items():
        if term.tpoint_sign:
            assert columns_of(name) == [(TERM_KEYS[name], term.tpoint_sign)], name


def gpoint(text, az_deg, el_deg):
    """What RTS2 adds to a target, degrees, azimuth S = 0, W = 90: its published formulae."""
    lines = [line.split() for line in text.splitlines() if line and not line.startswith('#')]
    number = lambda word: math.radians(float(word.rstrip('"')) / 3600.0)  # noqa: E731
    ia, tn, te, npae, npoa, ie, tf = map(number, lines[0][1:])
    az, el = math.radians(az_deg), math.radians(el_deg)
    d_az = -ia + (tn * math.sin(az) - te * math.cos(az) - npae) * math.tan(el) \
        + npoa / math.cos(el)
    d_el = -ie + tn * math.cos(az) + te * math.sin(az) + tf * math.cos(el)
    angle = {'az': az, 'el': el, 'zd': math.pi / 2 - el}
    for axis, value, function, angles, numbers in lines[1:]:
        u = [float(k) * angle[a] for a, k in zip(angles.split(';'), numbers.split(';'))]
        made = {'sin': lambda: math.sin(u[0]), 'cos': lambda: math.cos(u[0]),  # noqa: B023
                'cot': lambda: 1.0 / math.tan(u[0]),  # noqa: B023
                'sincos': lambda: math.sin(u[0]) * math.cos(u[1]),  # noqa: B023
                'coscos': lambda: math.cos(u[0]) * math.cos(u[1])}[function]()  # noqa: B023
        if axis.lower() == 'az':
            d_az += number(value) * made
        else:
            d_el += number(value) * made
    return math.degrees(d_az), math.degrees(d_el)


def test_signs_of_rts2_are_those_of_its_formulae(tmp_path):
    wobble = FittedEffect(effect('nod', order=3), np.array([3.0, -2.0]) * ARCSEC)
    fork = FittedEffect(effect('fork_cross_term'), np.array([4.0, 0.0]) * ARCSEC)
    model = PointingModel(seven(TX=2.0, ACEC=5.0, HASA2=-4.0, HECE2=3.0).terms,
                          geometry='first_order', effects=[wobble, fork])
    exported = export(model, PROGRAMS['rts2'])
    assert exported.held and not exported.refitted
    az, el = model.sky_to_encoder(SKY.az, SKY.el)
    for i in range(0, len(SKY), 7):
        d_az, d_el = gpoint(exported.text, math.degrees(SKY.az[i]) - 180.0,
                            math.degrees(SKY.el[i]))
        assert math.radians(d_az) == pytest.approx(wrap(az[i] - SKY.az[i]), abs=1e-4 * ARCSEC)
        assert math.radians(d_el) == pytest.approx(el[i] - SKY.el[i], abs=1e-4 * ARCSEC)
    # what its own checks expect of one degree of ia, two of ie and two extra lines
    path = tmp_path / 'check'
    path.write_text('# a check\n\nRTS2_ALTAZ 1d 0 0 0 0 -120m 0\nAZ 3d SiN el 2\n'
                    'EL 14400" cos az 2\n')
    ours = read_model(path).model
    for az, el, expected in ((0, 45, (2, 51)), (90, 45, (92, 43)), (30, 15, (30.5, 19))):
        got = ours.sky_to_encoder(np.radians(az + 180.0), np.radians(el))
        assert np.degrees(got[0]) - 180.0 == pytest.approx(expected[0], abs=1e-9)
        assert np.degrees(got[1]) == pytest.approx(expected[1], abs=1e-9)


def test_spks_rotations_are_ours():
    """The kernel is another geometry by the same author as TPOINT: coefficients by name agree."""
    exported = export(seven('rotation'), PROGRAMS['spk'])
    assert exported.direct.largest < 0.01 and exported.loss.largest < 0.005
    one = {}
    for name in SEVEN:  # each alone, large, is the same rotation
        model = PointingModel({name: 1800.0 * ARCSEC})
        one[name] = export(model, PROGRAMS['spk']).direct.largest
    assert max(v for n, v in one.items() if n != 'TF') < 1e-6, one
    assert one['TF'] < 10.0  # 0.0005 at 15 arcsec: where along its way the droop is taken


def onstepx(text, az, el):
    """What OnStepX's align model makes of a place, radians: its published formulae."""
    c = {n: int(v) for n, v in re.findall(r':SX0(\w),(-?\d+)#', text)}
    ax1, ax2, alt, azm, do, pd, df, tf, hca, dca = (
        c.get(n, 0) * ARCSEC for n in ('0', '1', '2', '3', '4', '5', '6', '8', 'b', 'd'))
    hcp, dcp = (math.radians(c.get(n, 0)) for n in 'ac')
    a1, a2 = az, el
    for _ in range(3):
        t1 = -azm * math.cos(a1) * math.tan(a2) + alt * math.sin(a1) * math.tan(a2) \
            - pd * math.tan(a2) + do / math.cos(a2) + hca * math.cos(a1 + hcp)
        t2 = azm * math.sin(a1) + alt * math.cos(a1) + df * math.cos(a1) - tf * math.cos(a2) \
            + dca * math.cos(a2 + dcp)
        a1, a2 = az + t1, el + t2
    return a1 - ax1, a2 + ax2


def test_signs_of_onstepx_are_those_of_its_formulae():
    model = seven(HECA=40.0, ACEC=30.0, ACES=-20.0, ECES=25.0)
    exported = export(model, PROGRAMS['onstepx'])
    got = np.array([onstepx(exported.text, *place) for place in zip(SKY.az, SKY.el)]).T
    assert apart(got, model.sky_to_encoder(SKY.az, SKY.el), SKY.el) == pytest.approx(
        exported.loss.largest, rel=0.5)
    # whole arcseconds of eleven coefficients and degrees of two phases
    assert exported.loss.rms < 1.0 and not exported.held


def test_indi_fits_the_model_back_from_its_points(tmp_path):
    model = PointingModel({n: v for n, v in SEVEN.items() if n != 'NPAE'})
    site = np.radians((31.5, -110.9))
    exported = export(model, PROGRAMS['indi'], facts={'site': tuple(site)})
    assert exported.loss.largest < 0.005 and exported.left == []
    # what its plug-in would see, by its own formulae: hour angle, then azimuth and elevation
    entry = ElementTree.fromstring(exported.text).find('.//DatabaseEntry')
    cell = lambda name: float(entry.findtext(name))  # noqa: E731
    sidereal = erfa.gst94(2400000.5, cell('ObservationJulianDate') - 2400000.5) + site[1]
    az, el = erfa.hd2ae(sidereal - math.radians(15.0 * cell('RightAscension')),
                        math.radians(cell('Declination')), site[0])
    x, y, z = (cell(f'TelescopeDirectionVector{c}') for c in 'XYZ')
    a, e = model.sky_to_encoder(az, el)
    assert wrap(math.atan2(-y, x) - a) * math.cos(el) == pytest.approx(0.0, abs=0.1 * ARCSEC)
    assert math.asin(z) == pytest.approx(e, abs=0.1 * ARCSEC)
    again = export(back(tmp_path, exported).model, PROGRAMS['indi'], facts={'site': tuple(site)})
    for name, value in again.terms.items():
        assert value == pytest.approx(exported.terms[name], abs=1e-3 * ARCSEC)
    with pytest.raises(ValueError, match='give the site'):
        export(model, PROGRAMS['indi'])


# ----------------------------------------------------------------------------------- round trips

@pytest.mark.parametrize('name, geometry', [
    ('tpoint', 'rotation'), ('katpoint', 'first_order'), ('rts2', 'first_order')])
def test_a_model_that_a_program_holds_comes_back_to_a_thousandth_of_an_arcsecond(
        tmp_path, name, geometry):
    more = {'ECES': 8.0, 'ACES': -7.0, 'HECA2': 2.5, 'HASA2': 1.25}
    difference, exported = round_trip(tmp_path, seven(geometry, **more), name)
    assert exported.held and not exported.refitted and exported.left == exported.added == []
    assert difference < 1e-3


def test_what_spk_and_onstepx_hold_comes_back_too(tmp_path):
    """Their geometry is neither ours nor first order: models of theirs, read and written again."""
    for name, text in (
            ('spk', 'pm.pia = 412.5 * AS2R;\npm.pib = 31 * AS2R;\npm->pca = -1.2e-4;\n'
             'pm.pan = 30 * AS2R; pm.ga = 0.0;\npm.paw = -40*AS2R;  /* +AW */\n'
             'pm.pvd = 15.0 * AS2R;\npm.pnp = 8 * AS2R;\n'),
            ('onstepx', ':SX00,-412#\n:SX01,-31#\n:SX02,30#\n:SX03,12#\n:SX04,15#\n:SX08,-15#\n'
             ':SX09,2#\n')):
        program = PROGRAMS[name]
        path = tmp_path / f'{name}.txt'
        path.write_text(text.replace('; pm.ga', ';\npm.ga'))
        model = read_model(path).model
        again = export(model, program)
        theirs = program.read(path, path.read_text()).terms
        for term, value in again.terms.items():
            assert value == pytest.approx(theirs.get(term, 0.0), abs=0.01 * ARCSEC), (name, term)
    assert round_trip(tmp_path, back(tmp_path, export(seven('rotation'), PROGRAMS['spk'])).model,
                      'spk')[0] < 1e-3


def test_the_table_holds_everything(tmp_path):
    rng = np.random.default_rng(2)
    side = FittedEffect(effect('encoder', axis='az', order=3), np.array([3.0, -2.0]) * ARCSEC,
                        np.array([0.1, 0.2]) * ARCSEC)
    drift = FittedEffect(effect('drift', of='IA', driver='temperature', origin=4.0, scale=1.0,
                                within=[0.0, 8.0]), [2.5 * ARCSEC])
    series = Harmonics('printed', *rng.normal(size=(2, COUNT)) * ARCSEC,
                       np.eye(2 * COUNT) * ARCSEC**2)
    model = PointingModel(SEVEN, np.eye(7) * ARCSEC**2, series, {}, 'rotation', [side, drift])
    path = tmp_path / 'model.csv'
    path.write_text(table.write(model, 'a caption'))
    got = read_model(path)
    assert got.program == 'table' and got.model.geometry == 'rotation'
    here = {'temperature': np.linspace(0.0, 8.0, len(SKY))}
    assert apart(model.sky_to_encoder(SKY.az, SKY.el, here),
                 got.model.sky_to_encoder(SKY.az, SKY.el, here), SKY.el) < 1e-9
    np.testing.assert_allclose(got.model.covariance, model.covariance, rtol=1e-12)
    assert got.model.effects[0].sigma == pytest.approx(side.sigma)


# ----------------------------------------------------------------- what a program cannot hold

def test_rotations_in_first_order_are_refitted_and_the_loss_is_told():
    exported = export(seven('rotation'), PROGRAMS['katpoint'])
    assert exported.refitted and not exported.held and exported.added == []
    assert exported.loss.rms < exported.direct.rms
    theirs = PROGRAMS['katpoint'].encoder(
        {k: s * exported.terms[n] for n in exported.terms
         for k, s in PROGRAMS['katpoint'].column(n)}, SKY.az, SKY.el)
    left = apart(theirs, seven('rotation').sky_to_encoder(SKY.az, SKY.el), SKY.el)
    assert 0.2 * exported.loss.largest < left < 1.01 * exported.loss.largest


@pytest.mark.parametrize('name, most', [('katpoint', 0.25), ('rts2', 0.01), ('tpoint', 0.01)])
def test_a_part_without_a_term_goes_into_the_programs_other_terms(name, most):
    model = seven('rotation' if name == 'tpoint' else 'first_order', TX3=2.0, TX=10.0)
    exported = export(model, PROGRAMS[name])
    assert exported.left == (['TX3'] if name != 'katpoint' else ['TX3', 'TX'])
    assert exported.added and exported.direct.rms > 3.0
    assert exported.loss.rms < most * exported.direct.rms
    assert not exported.held


def test_tpoint_holds_the_harmonics_of_the_paper_as_harmonics_of_its_own(tmp_path):
    rng = np.random.default_rng(3)
    series = Harmonics('zenith', *rng.normal(size=(2, COUNT)) * 20.0 * ARCSEC,
                       np.zeros((2 * COUNT, 2 * COUNT)))
    difference, exported = round_trip(tmp_path, PointingModel(SEVEN, None, series), 'tpoint')
    # constants of the series join CA, IE and TF, which are rotations there: a second order
    assert exported.left == exported.added == [] and exported.loss.rms < 0.01
    difference, exported = round_trip(tmp_path, PointingModel({}, None, Harmonics(
        'zenith', np.zeros(COUNT), series.coef_y, series.covariance)), 'tpoint')
    assert exported.held and difference < 1e-3


def test_what_follows_a_driver_is_left_out_and_counts_where_the_run_tells_it():
    from pointing_model.context import Context
    drift = FittedEffect(effect('drift', of='IA', driver='temperature', origin=4.0, scale=1.0,
                                within=[0.0, 8.0]), [5.0 * ARCSEC])
    model = PointingModel(SEVEN, geometry='first_order', effects=[drift])
    assert export(model, PROGRAMS['rts2']).loss.largest < 1e-3
    sky = Context(SKY.az, SKY.el, {'temperature': np.tile([0.0, 8.0], 100)})
    exported = export(model, PROGRAMS['rts2'], sky, 'a run')
    assert exported.left == [f'{drift.effect.name} (follows temperature)']
    assert 10.0 < exported.loss.rms < 20.0 and not exported.held


# ------------------------------------------------------------------------------------- bad files

TELMOD = """A telescope with two instruments, 2026-02-03
T   80   3.2500    0.000   0.0000
  IA        +95.1250     3.10250
  IE        +61.5000     1.00500
&=HACA2      -4.2500
&=HESA3CE3   +2.1250
  NPAE       +3.0625     5.50000
  TF       +180.2500     1.25000
END
"""


def test_a_model_file_of_tpoint_is_read(tmp_path):
    path = tmp_path / 'telmod.dat'
    path.write_text(TELMOD)
    got = read_model(path)
    assert got.program == 'tpoint' and got.notes == [
        'held fixed in TPOINT, taken as the others: HACA2, HESA3CE3']
    terms = {name: value / ARCSEC for name, value in got.model.terms.items()}
    assert terms == pytest.approx({'IA': 95.125, 'IE': -61.5, 'HACA2': -4.25, 'NPAE': 3.0625,
                                   'TF': 180.25})
    assert got.model.covariance[0, 0] ** 0.5 / ARCSEC == pytest.approx(3.1025)
    again = export(got.model, PROGRAMS['tpoint'])
    assert again.held
    assert {n: round(v / ARCSEC, 4) for n, v in again.terms.items()} == {
        'IA': 95.125, 'IE': 61.5, 'HACA2': -4.25, 'NPAE': 3.0625, 'TF': 180.25,
        'HESA3CE3': 2.125}


@pytest.mark.parametrize('text, words', [
    (TELMOD.replace('NPAE ', 'XYZ  '), 'XYZ .row 7. is no term'),
    (TELMOD.replace('+180.2500', 'nan'), 'TF is .nan., which is not finite'),
    (TELMOD.replace('+180.2500', '+21,3'), 'which is no number'),
    (TELMOD.replace('IA ', 'IH '), 'equatorial mount .IH.'),
    (TELMOD.replace('NPAE', 'IE  '), 'row 7: IE is there twice'),
    (TELMOD.replace('END\n', ''), 'without END'),
    ('RTS2_MODEL 0.01 0 0 0 -0.02 0 0 0 0', 'equatorial mount .RTS2_MODEL'),
    ('RTS2_ALTAZ 1" 2" 3"', 'seven numbers'),
    ('RTS2_ALTAZ 1" 2" 3" 4" 5" 6" nan"', 'tf is .nan., which is not finite'),
    ('RTS2_ALTAZ 0 0 0 0 0 0 0\nEL 1" sinsin az;el 1;1', 'sinsin is not read'),
    ('RTS2_ALTAZ 0 0 0 0 0 0 0\nEL 1" wave az 1', 'not known here'),
    ('RTS2_ALTAZ 0 0 0 0 0 0 0\nHA 1" sin az 1', "axis 'ha'"),
    ('RTS2_ALTAZ -120 -20 12 8 15 40 25', 'IA would be 6875 deg'),
    ('3 0 -8 -15 20 -12 -40 25', 'are these numbers in arcsec'),
    ('[header]\n[params]\nP1 = 0.1\nP23 = 1', 'P23 is no parameter'),
    ('0.1 0 nan 0.2', 'P3 is .nan., which is not finite'),
    (' '.join(['1'] * 23), '23 numbers'),
    ('pm.pia = 3 * AS2R;\npm.pxx = 4 * AS2R;', 'pxx is no member'),
    ('pm.pvd = 10.0 * AS2R * cos(tare);', 'follows the target'),
    (':SX00,10#\n:SX07,5#', 'equatorial mount'),
    (':SX00,ten#', 'ax1Cor is .ten.'),
    ('<INDIAlignmentDatabase><DatabaseEntries/></INDIAlignmentDatabase>', 'no Database'),
    ("<INDIAlignmentDatabase><DatabaseReferenceLocation latitude='31' longitude='4'/>"
     '<DatabaseEntry><ObservationJulianDate>2461041.5</ObservationJulianDate><RightAscension>nan'
     '</RightAscension></DatabaseEntry></INDIAlignmentDatabase>', 'point 1: RightAscension'),
    ('<INDIAlignmentDatabase>', 'is no XML'),
    ('name,value_arcsec\nIA,3\nZZ,4', 'row 3: ZZ is no term'),
    ('name,value_arcsec\nIA,inf', 'not finite'),
    ('name,value_arcsec\nID,1', 'equatorial mount'),
    ('Dear colleague,\nhere is the model', 'is no model file'),
    ('', 'is empty'),
])
def test_a_bad_file_is_one_line(tmp_path, text, words):
    path = tmp_path / 'bad.dat'
    path.write_text(text)
    with pytest.raises(ValueError, match=words) as caught:
        read_model(path)
    assert '\n' not in str(caught.value) and str(path) in str(caught.value)


# ------------------------------------------------------- INDI's database of an equatorial mount

def pmfit(points, latitude):
    """indilib libs/alignment/spk/pmfit.c and SPKMathPlugin.cpp, mount 'E', written once more."""
    date, ra, dec, *vector = np.array(points).T
    lst = erfa.gst94(2400000.5, date - 2400000.5) + SITE[1]
    h, d = np.mod(lst - ra * np.pi / 12.0 + np.pi, 2 * np.pi) - np.pi, np.radians(dec)
    seen = np.arctan2(vector[1], vector[0]), np.arcsin(vector[2])
    he, de = np.mod(lst - seen[0] + np.pi, 2 * np.pi) - np.pi, seen[1]

    def basis(h, d):
        sh, ch, sd, cd = np.sin(h), np.cos(h), np.sin(d), np.cos(d)
        sp, cp, one, no = np.sin(latitude), np.cos(latitude), np.ones_like(h), np.zeros_like(h)
        return np.array([(cd, no), (no, one), (sh * sd, ch), (-ch * sd, sh), (one, no),
                         (cp * sh, cp * ch * sd - sp * cd)])
    pm = np.zeros(6)
    for _ in range(20):
        lon, lat = he, de
        for value, (x, y) in zip(pm, basis(he, de)):
            lon, lat = lon + value * x / np.cos(lat), lat + value * y
        left = np.concatenate([wrap(h - lon) * np.cos(d), wrap(d - lat)])
        pm = pm + np.linalg.lstsq(basis(h, d).reshape(6, -1).T, left, rcond=None)[0]
    return dict(zip(('IH', 'ID', 'ME', 'MA', 'CH', 'TF'), pm / ARCSEC))


SITE = np.radians(48.0), np.radians(11.0)
GERMAN = {'IH': 60.0, 'ID': -40.0, 'CH': 35.0, 'NP': 0.0, 'MA': 45.0, 'ME': -70.0, 'TF': 20.0}


def german(errors='mount', latitude=SITE[0], **terms):
    from pointing_model.mounts import Mount
    return PointingModel({n: v * ARCSEC for n, v in {**GERMAN, **terms}.items()},
                         np.eye(7) * ARCSEC**2,
                         mount=Mount.equatorial(latitude, 'german').with_errors(errors))


@pytest.mark.parametrize('beyond', [False, True])
@pytest.mark.parametrize('latitude', [SITE[0], -0.5])
def test_indi_fits_a_german_mount_back_from_the_points_of_a_side(tmp_path, beyond, latitude):
    from pointing_model.mounts import is_beyond
    model = german(latitude=latitude)
    exported = export(model, PROGRAMS['indi'], facts={'site': (latitude, SITE[1])}, beyond=beyond)
    points = [[float(cell.text) for cell in entry] for entry in
              ElementTree.fromstring(exported.text).iter('DatabaseEntry')]
    fitted = pmfit(points, latitude)
    for name, value, _ in exported.listed():
        assert fitted[name] == pytest.approx(value, abs=1e-5), name
    # through the pole the zero in declination and the collimation turn over
    side = -1.0 if beyond else 1.0
    assert fitted['ID'] == pytest.approx(side * 40.0, abs=0.1)
    assert fitted['CH'] == pytest.approx(side * -35.0, abs=0.3)
    assert fitted['MA'] == pytest.approx(-45.0, abs=0.1)
    assert exported.loss.largest < 0.1 and 200 < exported.loss.directions < 400
    path = tmp_path / 'points.xml'
    path.write_text(exported.text)
    ours = read_model(path, model.mount).model
    sky = uniform_sky(300, model.mount)
    sky = sky.select(is_beyond(sky.el) == beyond)
    there, here = (one.sky_to_encoder(sky.az, sky.el) for one in (model, ours))
    assert apart(there, here, sky.el) < 0.15


def test_indi_takes_errors_that_act_on_the_sky_on_both_sides():
    exported = export(german('sky'), PROGRAMS['indi'], facts={'site': SITE})
    assert exported.loss.rms < 0.02 and exported.loss.directions == 600
    assert dict(row[:2] for row in exported.listed())['CH'] == pytest.approx(-35.0, abs=0.3)
