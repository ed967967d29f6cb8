"""What is said of causes, figures and terms."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis import diagnose
from calibration.diagnosis.as_read import as_read_sentence
from calibration.diagnosis.result import diagnosed
from calibration.diagnosis.unexplained import _like
from calibration.diagnosis.unphysical import refraction_in_place
from calibration.diagnosis_page.causes import (
    causes_sentence,
    contenders_sentence,
    first_check,
    open_causes,
)
from calibration.diagnosis_page.effects_told import EffectTold, title_of
from calibration.diagnosis_page.plain_words import (
    figures_sentence,
    told_verdict,
    verdict_sentences,
)
from calibration.diagnosis_page.told import (
    WORDS,
    choice_sentence,
    explained,
    model_words,
    next_sentence,
    no_star_sentences,
    place_words,
    repeat_sentence,
    serves_sentence,
    signs_sentences,
    spread_sentence,
    way,
)
from calibration.page.parts import said
from calibration.term_notes import notes_of_terms, said_of_term, suspicious
from msg_tools.units import ARCSEC
from pointing_model.effects import effect
from pointing_model.effects.words import coefficient_word, common_shape
from pointing_model.fitted_effects import FittedEffect
from pointing_model.mounts import ALTAZ, KINDS
from pointing_model.run import PointingRun
from pointing_model.run_files.mmt import _WANTED as WANTED

ROOT = Path(__file__).resolve().parents[3]


def causes_of(effects, gains):
    """As a diagnosis has them, the first one chosen and the others in its set."""
    fitted = FittedEffect(effects[0], np.zeros(len(effects[0].coefficient_names)))
    return diagnosed(fitted, 0.001, None, effects, np.array(gains), 0,
                     list(range(1, len(effects))), []).causes


def document(causes, **more):
    rms = {'rms_arcsec': 5.4, 'cv_rms_arcsec': 5.67}
    return {'verdict': 'ambiguous', 'before': rms, 'after': {'rms_arcsec': 3.7,
            'cv_rms_arcsec': 4.3}, 'base_terms': ['IA'] * 7, 'as_read_rms_arcsec': 134.72,
            'effects': [{'name': 'elevation_encoder_2', 'causes': causes}], **more}


CAUSES = causes_of([effect('encoder', axis='el', order=2), effect('terms', name='second_flexure')],
                   [20.0, 20.1])


def test_causes_are_equals_and_the_best_is_first():
    assert [one['effects'] for one in CAUSES] == [['second_flexure'], ['elevation_encoder_2']]
    assert CAUSES[0]['delta_bic'] == 20.1


def test_no_cause_is_an_alternative_for_itself():
    # with a memory of 10 degrees or at once, people are told one cause
    one = [effect('hysteresis', axis='az', shape='cosE', memory_deg=m) for m in (10.0, 0.0)]
    told = causes_of(one, [20.0, 19.0])
    assert len(told) == 1 and len(told[0]['effects']) == 2
    other = effect('hysteresis', axis='az', shape='1', memory_deg=10.0)
    assert len(causes_of([*one, other], [20.0, 19.0, 18.0])) == 2


def test_what_is_seen_is_what_all_causes_share():
    nod, wobble = effect('nod', order=1), effect('bearing_wobble', order=1)
    assert common_shape([nod.shape, wobble.shape], ['azimuth']) == \
        'a wave of the azimuth, once per turn'
    assert common_shape([nod.shape, 'a rise'], ['azimuth']) == 'a curve of the azimuth'
    # a curve of one angle is a hypothesis where causes follow others
    assert common_shape(['a', 'b', 'c'], ['elevation', 'hour_angle', 'elevation']) == \
        'a curve of the elevation or of the hour angle'
    assert common_shape(['a', 'b', 'c'], ['elevation', 'hour_angle', 'time']) == \
        'a curve of the elevation, of the hour angle or of time'
    saw = effect('smooth', axis='el', driver='elevation', shape='sawtooth', start=0.0,
                 period=np.radians(15.2))
    assert saw.shape == 'a sawtooth of the elevation with a period of 15.2°'
    assert coefficient_word(saw, 's1') == 'height of a tooth'

    def wave(order):
        return effect('smooth', axis='el', driver='elevation', shape='fourier', orders=[order],
                      period=2.0 * np.pi).shape
    # one of the periods that are tried; of a long one no second wave is seen
    assert wave(2.5) == 'a smooth curve of the elevation'
    assert wave(12) == 'a wave of the elevation with a period of about 30.0°'


def test_an_effect_acts_where_its_causes_act():
    flexure = effect('terms', name='declination_axis_flexure', mount='german')
    slope = effect('polynomial', result='az', of='az', power=1, mount='german')
    wobble = effect('bearing_wobble', order=1, mount='german')

    def seen(*effects):
        found = SimpleNamespace(fitted=SimpleNamespace(effect=effects[0]),
                                causes=causes_of(list(effects), [9.0] * len(effects)))
        return title_of(found, KINDS['german'].axes)
    assert seen(flexure, slope) == 'hour angle: a curve of the elevation or of the hour angle'
    assert seen(flexure, wobble).startswith('both axes: a curve of the ')


def test_what_would_look_like_a_wander_is_told_by_what_it_follows():
    def like(*effects):
        return _like(SimpleNamespace(like=[SimpleNamespace(effect=lambda _, e=e: e)
                                           for e in effects]), None)
    step = effect('step', axis='az', at=5.0)
    assert like(step) == f'"{step.cause_told}"'
    many = [step, effect('nod', order=2), effect('encoder', axis='az', order=3),
            effect('drift', of='IA', driver='temperature'),
            effect('terms', name='refraction')]
    assert like(*many[:3]) == 'something that changes with time or the azimuth'
    assert like(*many).endswith('the temperature or the elevation') and '_' not in like(*many)
    many += [effect('proportional', axis='el', driver=name) for name in ('magnitude', 'fan')]
    # of more than are named it is said where the others are
    assert like(*many).endswith('the elevation or 2 more that the ranking has')
    assert like() == ''


def test_the_headline_says_what_is_wrong_and_what_remains():
    told = document(CAUSES, noise_floor_arcsec=3.9)
    headline, sentences = verdict_sentences(told, [EffectTold('The error has a wave', 3.5)])
    assert headline == (
        'The error has a wave (3.50″ RMS on the sky), the only error found beyond the terms of the '
        'model. With it in the model 4.30″ remain on rows left out (5.67″ without, −24 %)')
    assert sentences[0] == ('One effect was found beyond the seven declared terms; more than one '
                            'cause would explain it.')
    assert way(told) in sentences and way(told).startswith(
        'RMS on the sky: 134.7″ as the encoders read, 5.67″ with the seven declared terms, 4.30″')
    assert way({**told, 'as_read_rms_arcsec': None}) == ''
    held = {'holdout_rms_arcsec': 5.0}
    told['before'], told['after'] = {**told['before'], **held}, {**told['after'], **held}
    headline, sentences = verdict_sentences(told, [EffectTold('The error has a wave', 3.5)])
    assert headline.endswith('on rows held out (5.00″ without, +0 %): that is no gain')
    assert 'Rows left out of the runs fitted are missed by 4.30″' in sentences[-1]


def slow(size, **more):
    trend = {'rate_arcsec_per_hour': -226.4, 'share': 0.8, 'removes_rms_arcsec': 55.0}
    return {'slow': True, 'along_the_sky': {'step_deg': 9.0, 'any_deg': 51.0},
            'removes_rms_arcsec': size, 'text': 'neighbouring rows err alike',
            'axes': {'az': {'trend': {**trend, 'share': 0.2}}, 'el': {'trend': trend}}, **more}


def test_what_moves_slowly_leads_where_it_is_the_largest():
    told = document(CAUSES, mount='german', wander=slow(62.6))
    told['effects'][0]['removes_rms_arcsec'] = 3.5
    told['after'] = {**told['after'], 'cv_rms_arcsec': 5.3}
    headline, sentences = verdict_sentences(told, [EffectTold('The error has a wave', 3.5)])
    assert headline == (
        'The largest error moves slowly, with time or over the sky, and its cause is not known '
        '(62.6″ RMS on the sky): the declination error falls by 226″ an hour. Beside it the error '
        'has a wave (3.50″ RMS on the sky). With it in the model 5.30″ remain on rows left out '
        '(5.67″ without, −7 %): most of the error stays unexplained')
    assert sentences[0] == 'Neighbouring rows err alike.'
    small = {**told, 'wander': slow(3.0)}
    headline, sentences = verdict_sentences(small, [EffectTold('The error has a wave', 3.5)])
    assert headline.startswith('The error has a wave') and 'only error found' in headline
    assert sentences[0].startswith('One effect') and 'Neighbouring rows err alike.' in sentences


def test_a_zero_that_wanders_evenly_has_its_rate_in_the_headline():
    told = {**document([]), 'verdict': 'wanders', 'effects': [], 'wander': slow(62.6)}
    headline, _ = verdict_sentences(told)
    assert headline.endswith(
        'an error that no effect describes: the elevation error falls by 226″ an hour')
    headline, _ = verdict_sentences({**told, 'wander': {**slow(62.6), 'along_the_sky': None}})
    assert headline == ('The zero wanders, and what moves it is not known: the elevation error '
                        'falls by 226″ an hour')


def test_a_cause_that_takes_more_effects_is_the_last_and_is_not_checked_first():
    easy = {'cause': 'scale', 'effects': ['scale'], 'look_at': 'the scale', 'effort': 0,
            'more_effects': 3, 'delta_bic': 20.0}
    row = {'name': 'elevation_encoder_2', 'causes': [*CAUSES[1:], easy]}
    told = causes_sentence(row['causes'])
    assert told.endswith('; or scale (with three effects more beside it).')
    said = first_check({}, row)
    assert said.startswith(f'Check first: {CAUSES[1]["look_at"]}.')
    assert 'the other stands only with more effects beside it' in said


def test_the_terms_are_called_by_the_mount_that_has_them():
    def words(terms, mount='altaz', **more):
        return model_words({'base_terms': terms, 'mount': mount}, **more)
    assert words(ALTAZ.names.physical) == 'the seven terms of an alt-azimuth mount'
    assert words(KINDS['german'].physical, 'german') == 'the seven terms of a German mount'
    assert words(ALTAZ.names.standard6) == 'the usual six terms of an alt-azimuth mount'
    assert words(['IA', 'IE']) == 'the zeros of an alt-azimuth mount'
    assert words(['IA', 'IE', 'TX']) == 'the three declared terms'
    assert words(ALTAZ.names.physical, whose=False) == 'the seven terms'


@pytest.mark.parametrize('figures, wanders, said', [
    ((3.7, 3.1, 5.2), True, 'the zero moves less by then than over the whole run, and the '
     'difference is within its uncertainty.'),
    ((3.0, 2.5, 3.5), False, 'rows late in the run may scatter less than the others.'),
    ((4.2, 3.1, 5.2), True, 'in the ten rows after the last row.')])
def test_which_figure_to_quote_and_why_others_differ(figures, wanders, said):
    told = document(CAUSES, noise_floor_arcsec=3.9, wander={'slow': wanders}, expected=dict(
        zip(('rms_arcsec', 'low_arcsec', 'high_arcsec'), figures), within='ten rows'))
    text = figures_sentence(told)
    assert text.startswith('Quote 4.30″, on rows left out') and text.endswith(said)
    assert ('over the whole run is in it' in text) == wanders
    assert ('The noise floor, ' in text) != wanders
    assert ('It can be below ' in text) == (figures[0] < 3.9)
    fitted = {'before': {'rms_arcsec': 5.4}, 'after': {'rms_arcsec': 3.7}}
    assert figures_sentence({**told, **fitted}).startswith('3.70″ is of the rows fitted alone')


@pytest.mark.parametrize('slow, apart, quoted', [(True, 5.3, '5.30'), (False, 5.3, '4.30'),
                                                 (True, 4.1, '4.30')])
def test_where_neighbours_err_alike_the_larger_figure_is_quoted_everywhere(slow, apart, quoted):
    told = document(CAUSES, wander={'slow': slow, 'text': 'it wanders'},
                    cv_contiguous={'before': 6.1, 'after': apart})
    headline, sentences = verdict_sentences(told, [EffectTold('A')])
    where = 'stretches of rows left out' if quoted == '5.30' else 'rows left out'
    assert f'{quoted}″ remain on {where} (' in headline
    assert figures_sentence(told).startswith(f'Quote {quoted}″, on {where}, ')
    assert f'{quoted}″ with one effect more; the terms judged on {where}.' in way(told)
    assert ('at random, is less than it should be' in figures_sentence(told)) == (
        quoted == '5.30')


@pytest.mark.parametrize('kind, values, said', [
    ('german', [-1059, 30, 5, 2, 3, -256, 60], 'Most of what the encoders read is IH −1059″ (zero '
     'of the hour angle). The polar axis points 4.3′ too low (ME) and 3″ west of the pole (MA).'),
    ('altaz', [-60, 30, 5, 2, -24, 19, 600], 'Most of what the encoders read is TF +600″ (the tube '
     'bends). The azimuth axis leans 24″ to the south (AN) and 19″ to the west (AW).'),
    ('free', [900, 30, 5, 2, 3, 4, 5], 'Most of what the encoders read is I1 +900″ (zero of the '
     'first axis).')])
def test_what_the_errors_as_read_consist_of(kind, values, said):
    rows = [{'name': name, 'value_arcsec': float(v), 'rms_arcsec': 0.8 * abs(v)}
            for name, v in zip(KINDS[kind].physical, values)]
    told = document(CAUSES, mount=kind, as_read_rms_arcsec=850.0, as_read_terms=sorted(
        rows, key=lambda row: -row['rms_arcsec']))
    assert as_read_sentence({**told, 'effects': []}) == said
    said += ' These values are of the terms fitted alone, without the effect.'
    assert as_read_sentence(told) == said
    assert as_read_sentence({**told, 'as_read_rms_arcsec': 9.0}) == ''
    assert told_verdict(told, [EffectTold('A')]).sentences[2].endswith(f'rows left out. {said}')
    if kind == 'german':  # the other pole
        assert 'too high (ME) and 3″ east' in as_read_sentence({**told, 'south': True})


def test_what_is_read_beyond_the_zeros_and_what_effects_move():
    values = {'IH': -7295.0, 'ID': -7192.0, 'CH': 1284.0, 'NP': 65.0, 'MA': -245.0, 'ME': 594.0,
              'TF': 122.0}
    rows = [{'name': name, 'value_arcsec': v, 'rms_arcsec': 0.8 * abs(v)}
            for name, v in values.items()]
    told = document(CAUSES, mount='german', as_read_rms_arcsec=9384.0, as_read_terms=rows)
    text = as_read_sentence(told)
    assert 'and ID −7192″ (zero of the declination). Beyond the zeros it is CH +1284″ ' \
        '(collimation, the cone error; 1027″ RMS on the sky) and ME +594″ (the tilt of the polar ' \
        'axis; 475″ RMS on the sky). The polar axis' in text
    assert text.endswith('terms fitted alone, without the effect.')
    rows[2].update(beside_effects_arcsec=1046.0, resembles='declination_axis_flexure',
                   correlation=-0.97)
    rows[5].update(beside_effects_arcsec=620.0, resembles='declination_axis_flexure',
                   correlation=0.2)
    assert as_read_sentence(told).endswith(
        'Beside it CH is +1046″ in place of +1284″, for it resembles declination axis flexure '
        '(correlation −0.97); ME is +620″ in place of +594″.')
    rows[2]['rms_arcsec'] = 150.0  # no more than a part of the lean
    assert 'Beyond the zeros' not in as_read_sentence(told)
    # rows come by their size on the sky: what is larger there is said first
    rows[2]['rms_arcsec'] = 400.0
    told['as_read_terms'] = sorted(rows, key=lambda row: -row['rms_arcsec'])
    text = as_read_sentence(told)
    assert 0 < text.index('ME +594″ (the tilt') < text.index('CH +1284″ (collimation')


def test_terms_that_an_effect_moves_are_told_with_it():
    rng = np.random.default_rng(2)
    n = 60
    az, el = rng.uniform(0.0, 6.28, n), rng.uniform(0.4, 1.4, n)
    bend = 60.0 * ARCSEC * np.sin(2.0 * el)
    x, y = ARCSEC * rng.normal(size=(2, n))
    run = PointingRun({'az': az, 'el': el, 'az_enc': az + x / np.cos(el),
                       'el_enc': el + y + bend}, {})
    found = diagnose(run, flips=199, cross_validation=False)
    rows = {row['name']: row for row in found.to_dict()['as_read_terms']}
    assert found.effects and rows['TF']['beside_effects_arcsec'] == pytest.approx(
        found.model.terms['TF'] / ARCSEC)
    assert rows['TF']['resembles'] == found.effects[0].fitted.effect.name
    assert 0.5 < abs(rows['TF']['correlation']) <= 1.0
    assert 'beside_effects_arcsec' not in rows['IA']


@pytest.mark.parametrize('hour, kind, up', [(186.0, 'german', True), (-20.0, 'german', True),
                                            (140.0, 'german', False),
                                            (186.0, 'equatorial', False)])
def test_a_place_is_told_with_the_counterweight_and_from_when_hours_count(hour, kind, up):
    text = place_words({'az_deg': 345.0, 'el_deg': 21.0, 'ha_deg': hour, 'dec_deg': 68.0,
                        'after_hours': 2.0}, kind)
    assert ('counterweight up' in text) == up
    assert text.endswith('2 h after the last row')


def test_whether_the_choice_repeats_is_told():
    spread = {'partitions': 15, 'min_arcsec': 76.0, 'max_arcsec': 101.9, 'folds': 160,
              'same_choice': 40, 'no_choice': 1, 'chosen': {'fork_cross_term': 90},
              'others': dict(zip('abcde', (70, 50, 2, 1, 1)))}
    told = document(CAUSES, mount='german')
    assert choice_sentence(told) == spread_sentence(told) == ''
    told['after'] = {**told['after'], 'cv_spread': spread}
    assert choice_sentence(told) == (
        'With a part of the rows left out the choice was repeated 160 times. Of what was found it '
        'had saddle cross term 90 times. Of other effects it had a 70 times; b 50 times; c twice; '
        'and 2 more. It had no effect at all once.')
    assert spread_sentence(told).endswith('15 ways to leave them out, after from 76.0″ to 102″.')
    two = {'folds': 7, 'same_choice': 0, 'chosen': {'x': 0, 'y': 7}}
    assert choice_sentence({**told, 'after': {'cv_spread': two}}).endswith(
        'found it had y each time; x never; all of it and nothing else never.')
    assert choice_sentence({**told, 'verdict': 'none'}) == ''


def test_where_the_axis_points_hangs_on_an_equinox_that_is_a_guess():
    values = zip(KINDS['german'].physical, [-7290, -7200, 1280, 60, -245, 594, 120])
    rows = [{'name': name, 'value_arcsec': float(v), 'rms_arcsec': abs(v)} for name, v in values]
    found = {'taken': 'J2000', 'other': 'of date', 'told': False, 'polar_axis_arcsec': {
        'J2000': {'ME': 594.0, 'MA': -245.0}, 'of date': {'ME': 108.0, 'MA': -84.0}}}
    told = document(CAUSES, mount='german', as_read_rms_arcsec=9400.0, as_read_terms=rows,
                    equinox=found)
    said = as_read_sentence(told)
    assert (
        'The polar axis points 9.9′ too high (ME) and 4.1′ east of the pole (MA), if the catalogue '
        'of the file is J2000, which its rows do not tell; if it is of date, it points 1.8′ too '
        'high (ME) and 84″ east of the pole (MA). Say which with --equinox before the axis is '
        'moved.') in said
    assert said in ' '.join(told_verdict(told, [EffectTold('A')]).sentences)
    for settled in (None, {**found, 'told': True}):
        assert 'catalogue' not in as_read_sentence({**told, 'equinox': settled})
    few = as_read_sentence({**told, 'equinox': {**found, 'polar_axis_arcsec': {}}})
    assert 'do not tell. Say which' in few


def test_a_sign_that_the_effects_only_leave_in_doubt_is_told():
    text = said_of_term({'name': 'TF', 'value_arcsec': -60.2, 'sigma_arcsec': 3.1, 'what': 'sign',
                         'beside_effects_arcsec': -13.4, 'altaz': True})
    assert text.startswith(
        'TF, the bending of the tube, is negative (−60.2 ± 3.1″ before the effects were added; '
        '−13.4″ beside them, which take up the same curve), and weight bends no tube upward.')


def test_a_german_mount_has_no_fork():
    for one in (effect('terms', name='fork_flexure', mount='german'),
                effect('fork_cross_term', mount='german'), effect('nod', order=1, mount='german'),
                effect('line_of_sight', order=1, mount='german')):
        text = f'{one.cause} {one.cause_told} {one.look_at} {one.clause(None)} {one.shape}'
        assert 'fork' not in text.lower() and 'saddle' in text.lower()
    assert 'fork or saddle' in effect('terms', name='fork_flexure', mount='equatorial').cause


def test_effects_are_ranked_with_their_size():
    told = document(CAUSES)
    told['effects'] = [{'name': 'a', 'removes_rms_arcsec': 1.0, 'cv_gain_arcsec': 0.4,
                        'axes': 'el'}, {'name': 'b', 'removes_rms_arcsec': 3.0}]
    verdict = told_verdict(told, [EffectTold('A'), EffectTold('B')])
    assert [(one.lead, one.size_arcsec) for one in verdict.ranked] == [('B.', 3.0), ('A.', 1.0)]
    html = said(verdict.ranked, True)
    assert html.index('width:100%') < html.index('<b>A.</b>') < html.index('width:33%')


def test_the_cheapest_check_is_advice():
    told = document(CAUSES, unphysical=[{'name': 'TF'}])
    row = {**told['effects'][0], 'axes': 'el', 'driver': 'elevation'}
    text = first_check(told, row)
    assert text.startswith('It bears on the same curve as TF (above): check that first. Then: ')
    assert text.endswith('and takes a look at the mount, with nothing taken apart; the other takes '
                         'more. Which is likelier these rows do not say.')
    assert first_check(document(CAUSES), row).startswith('Check first: bolts')
    equal = causes_of([effect('nod', order=1), effect('bearing_wobble', order=1)], [9.0, 8.0])
    text = first_check(document(equal), {'name': 'elevation_nod_1', 'causes': equal})
    assert text.startswith('Check first: wheels') and 'the other takes as much' in text
    assert first_check(told, {'name': 'smooth_of_x', 'causes': equal[:1]}).endswith('not beyond.')
    assert first_check(told, {'name': 'a', 'alternatives': ['b']}) == ''


def test_a_check_tests_all_causes_that_it_looks_at():
    mount = 'equatorial'
    four = causes_of([effect('nod', order=2, mount=mount), effect('nod', order=1, mount=mount),
                      effect('bearing_wobble', order=1, mount=mount),
                      effect('bearing_wobble', order=2, mount=mount)], [22.7, 19.5, 19.5, 18.3])
    text = first_check(document(four), {'name': 'declination_nod_2', 'causes': four})
    for one in four[:2]:
        assert f'"{one["cause"]}"' in text.split('; ')[0]
    assert '; the others take more.' in text
    text = first_check(document(four[:2]), {'name': 'declination_nod_2', 'causes': four[:2]})
    assert 'other' not in text
    # where nothing goes over a pier, and what a polar axis carries
    assert 'fork, yoke or horseshoe' in text and 'counterweight' not in text
    german = effect('nod', order=1, mount='german')
    assert 'saddle and counterweight' in german.look_at
    assert 'horseshoe ring' in effect('encoder', axis='az', order=2, mount=mount).cause_told
    assert 'horseshoe' not in effect('encoder', axis='az', order=2, mount='german').cause_told
    assert 'horseshoe' not in effect('encoder', axis='el', order=2, mount=mount).cause_told


def contended(**more):
    """An effect of a document with one cause, and what was often chosen in its place."""
    own, other = causes_of([effect('encoder', axis='az', order=2, mount='equatorial'),
                            effect('line_of_sight', order=2, mount='equatorial')], [94.0, 49.0])
    return {'name': 'hour_angle_encoder_2', 'causes': [own], 'removes_rms_arcsec': 4.6,
            'contenders': [{**other, 'behind': 45.0, 'alone': 111.0, 'found_alone': 110.0,
                            'instead': 50, 'folds': 150, 'open': True, **more}]}


def test_what_contends_with_an_effect_is_named_and_why_it_lost():
    row = contended()
    told = document([], mount='equatorial')
    text = contenders_sentence(row, row['causes'][0]['cause'])
    assert 'Line of sight swings is not excluded: alone it explains the rows as well (ΔBIC 111, ' \
        'against 110) and it was chosen instead 50 of the 150 times' in text
    assert text.endswith('but with all effects in the model it is 45 behind in ΔBIC.')
    assert open_causes(row) == 2
    assert 'for "line of sight swings": what turns with the polar axis' in first_check(told, row)
    closed = contended(open=False, instead=0)
    assert open_causes(closed) == 1 and 'swings' not in first_check(told, closed)
    assert contenders_sentence(closed, '').startswith('Line of sight swings lost its place: alone')
    assert contenders_sentence({'contenders': []}, '') == ''


def test_proposals_that_do_not_serve_the_largest_effect_say_so():
    small = {**contended(), 'name': 'declination_nod_2', 'removes_rms_arcsec': 1.8}
    star = {'az_deg': 60.0, 'el_deg': 17.0, 'separates': ['declination_nod_2', 'line_of_sight_2'],
            'separation_before': 0.7, 'separation_after': 5.9}
    told = {**document([], next_observations=[star]), 'effects': [contended(open=False), small]}
    text = serves_sentence(told)
    assert 'Of the largest, hour angle encoder, 2 per turn (4.60″ RMS on the sky)' in text
    assert 'one cause was left' in text
    star['separates'][0] = 'hour_angle_encoder_2'
    assert serves_sentence(told) == '' == serves_sentence({**told, 'next_observations': []})


def test_how_often_all_was_chosen_stands_beside_what_was_found():
    told = document(CAUSES)
    told['after'] = {**told['after'], 'cv_spread': {
        'folds': 150, 'same_choice': 37, 'chosen': {'elevation_encoder_2': 99}}}
    assert repeat_sentence(told) == ('With a part of the rows left out, this effect and no other '
                                     'was found 37 of 150 times.')
    told['effects'] = [{**told['effects'][0], 'removes_rms_arcsec': 2.0}, {'name': 'b'}]
    assert repeat_sentence(told).endswith('were found 37 of 150 times, the largest 99 times.')
    told['after']['cv_spread'] |= {'same_set': 120, 'chosen_set': {'elevation_encoder_2': 148}}
    assert repeat_sentence(told).endswith(
        ', by one or another of the causes, and no other were found 120 of 150 times, '
        'the largest 148 times.')
    told['after']['cv_spread'] |= {'same_choice': 0, 'same_set': 0, 'chosen_set': None}
    assert ' were found in none of 150 times, the largest 99 times.' in repeat_sentence(told)
    assert repeat_sentence(document(CAUSES)) == ''


def test_a_star_for_the_largest_effect_or_none():
    row = {'az_deg': 60.0, 'el_deg': 17.0, 'separates': ['elevation_encoder_2', 'second_flexure'],
           'separation_before': 0.7, 'separation_after': 5.9}
    told = document(CAUSES, next_observations=[row])
    text = next_sentence(told, told['effects'][0])
    assert 'observe first azimuth 60°, elevation 17°; ' in text and 'still below 6' in text
    later = document(CAUSES, next_observations=[{**row, 'after_hours': 2.0}])
    assert '17°, 2 h after the last row (something in one of the explanations changes with ' \
        'time); ' in next_sentence(later, later['effects'][0])
    told = document(CAUSES, no_star=[row['separates']])
    assert next_sentence(told, told['effects'][0]).startswith(
        f'No star tells {CAUSES[1]["cause"]} from the other')
    sentence, = no_star_sentences(told)
    assert no_star_sentences({**told, 'no_star': [['a', 'b', 'c', 'b']]})[0].startswith(
        'No star tells a from b or c:')
    assert 'second flexure of the tube' in sentence and '_' not in sentence
    assert next_sentence(told, {'name': 'a', 'causes': CAUSES[:1]}) == ''


def test_a_tube_that_bends_up():
    row = {'name': 'TF', 'value_arcsec': -78.1, 'sigma_arcsec': 6.3}
    text, = notes_of_terms([row])
    assert text.startswith('TF, the bending of the tube, is negative (−78.1 ± 6.3″)')
    assert 'refraction is in the star places twice' in text and 'Check first, at the desk' in text
    assert not notes_of_terms([{**row, 'value_arcsec': -12.0}, {**row, 'name': 'AW'},
                               {**row, 'value_arcsec': 78.1}])


@pytest.mark.parametrize('gain, said', [
    (9.0, 'Most likely the refraction is in the star places twice'), (0.0, 'explains it as well'),
    (-30.0, 'is not the whole of it')])
def test_what_refraction_has_to_do_with_it(gain, said):
    fitted = {'value_arcsec': -41.0, 'delta_bic': gain, 'beside_arcsec': -20.0}
    row = {'name': 'TF', 'what': 'sign', 'value_arcsec': -78.1, 'sigma_arcsec': 6.3,
           'alone_arcsec': -58.0, 'altaz': True, 'refraction': fitted}
    text = said_of_term(row)
    assert said in text and '−41.0″ of cot E' in text and '−58.0″ before the effects' in text
    assert ('disc is off centre' in text) == (gain < 6.0)
    assert 'disc' not in said_of_term({**row, 'altaz': False})
    other = {'cause': 'disc oval', 'value_arcsec': 24.3, 'sigma_arcsec': 5.5}
    text_of_both = said_of_term({**row, 'sound_with': [other]})
    assert 'not with others that fit as well (+24.3 ± 5.5″ with disc oval)' in text_of_both
    # among the first things, also where nothing is missing
    told = document([], unphysical=[row])
    assert told_verdict(told, [EffectTold('A')]).first[0].more in text
    told.update(verdict='none', effects=[])
    headline, sentences = verdict_sentences(told)
    assert headline.endswith('But look at TF, which is negative') and sentences[0] == text


def test_sizes_that_no_mount_has():
    def named(name, value):
        return [row['what'] for row in suspicious(
            [{'name': name, 'value_arcsec': value, 'sigma_arcsec': 1.0}])]
    assert named('TX', -58.0) == named('TX', 58.0) == named('NPAE', 4000.0) == ['size']
    assert not named('TX', 8.0) and not named('CA', 900.0) and not named('AW', 4000.0)
    text, = notes_of_terms([{'name': 'TX', 'value_arcsec': -58.0, 'sigma_arcsec': 1.0}])
    assert 'put into the star places twice' in text


def test_refraction_that_was_put_in_twice_is_told_from_the_rows():
    rng = np.random.default_rng(4)
    az, el = rng.uniform(0.0, 2.0 * np.pi, 80), np.arcsin(rng.uniform(0.2, 0.98, 80))
    noise = rng.normal(size=(2, 80)) * ARCSEC

    def fitted(bend):
        run = PointingRun({'az': az, 'el': el, 'az_enc': az + noise[0] / np.cos(el),
                           'el_enc': el + bend + noise[1]})
        found = diagnose(run, flips=199, cross_validation=False)
        return found, {row['name']: row for row in found.to_dict()['unphysical']}
    found, told = fitted(-58.0 * ARCSEC / np.tan(el))
    # found as an effect, it is as large as all of the refraction
    assert list(told) == ['TX'] and 'twice' in said_of_term(told['TX'])
    twice = refraction_in_place(found)
    assert twice['delta_bic'] > 100.0 and twice['value_arcsec'] == pytest.approx(-58.0, abs=2.0)
    assert twice['beside_arcsec'] == pytest.approx(0.0, abs=5.0)
    found, told = fitted(-40.0 * ARCSEC * np.cos(el))
    assert list(told) == ['TF'] and told['TF']['refraction']['delta_bic'] < -20.0
    assert told['TF']['value_arcsec'] == pytest.approx(-40.0, abs=5.0)
    assert fitted(40.0 * ARCSEC * np.cos(el))[1] == {}


def test_signs_in_words():
    mirror = 'azimuth of catalogue and encoders counted the other way'
    text, = signs_sentences([mirror, 'mount and catalogue exchanged'], ALTAZ.names)
    assert text.startswith('signs: the columns were taken as the file names them')
    assert f'exchanged in the file, or {mirror}' in text
    assert signs_sentences([], ALTAZ.names) == []
    # a format of fixed columns names none
    assert WANTED['RAA'] == ('az', 'el') and WANTED['TAA'] == ('az_enc', 'el_enc')
    text, = signs_sentences([mirror], ALTAZ.names, 'mmt')
    assert 'RAA, with the refraction in it, was taken for the catalogue and TAA for the' in text
    text, = signs_sentences([mirror], ALTAZ.names, 'tpoint')
    assert 'first the catalogue' in text and 'the file names' not in text
    assert 'zenith distance' in signs_sentences(['zenith distance in place'], ALTAZ.names)[0]


def test_words_are_in_the_glossary():
    glossary = (ROOT / 'docs' / 'glossary.md').read_text(encoding='utf-8').lower()
    others = {'wanders': '**wander**', 'rows left out': '**left out**',
              'rows held out': '**held out**'}
    for word in WORDS:
        assert others.get(word, f'**{word.lower()}**') in glossary, word
    assert dict(explained('A sawtooth'))['sawtooth'] == WORDS['sawtooth']
