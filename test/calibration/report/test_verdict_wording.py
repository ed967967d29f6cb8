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

"""What is said of figures, of proposals and of what was found."""


import pytest
from documents import CAUSES, contended, document

from calibration.report.diagnosis_summary import summary_of
from calibration.report.figure_wording import (
    choice_sentence,
    figures_sentence,
    model_words,
    repeat_sentence,
    way,
)
from calibration.report.noise_wording import cause_words, explanation
from calibration.report.observation_wording import (
    next_sentence,
    no_star_sentences,
    place_words,
    serves_sentence,
)
from calibration.report.row_wording import signs_sentences
from calibration.report.verdict_wording import Statement, short_headline, verdict_sentences
from pointing_model.effects import effect
from pointing_model.mount_kinds import KINDS
from pointing_model.mounts import ALTAZ
from pointing_model.runs.formats import mmt, tpoint_data
from pointing_model.runs.formats.mmt import _WANTED as WANTED

WAVE = Statement('The error has a wave (3.50″ RMS on the sky).')


def test_what_explains_a_drift_as_well_is_named():
    def like(*effects):
        return explanation([{'cause': e.cause_summary, 'driver': e.driver,
                             'curve': e.kind == 'smooth'} for e in effects])
    step = effect('step', axis='az', at=5.0)
    assert like(step) == f'"{step.cause_summary}"'
    many = [step, effect('nod', order=2), effect('terms', name='refraction')]
    assert like(*many[:2]) == ('"azimuth zero jumped at once" or "mount wobble on its wheels, pads '
                               'or base (twice per turn of azimuth)"')
    # of more than are named it is said where the others are
    assert like(*many, *many).endswith(' or one more of the ranking')
    curve = effect('smooth', axis='el', driver='temperature', shape='sawtooth', start=0.2,
                   period=0.4)
    assert like(curve) == 'something that changes with the temperature'
    assert like() == '' and cause_words({}) == '; its cause is unknown'
    assert cause_words({'explained_by': [{'cause': 'a: b', 'driver': 'time', 'curve': False}]}) \
        == ': a drift, or "a: b"'


def test_the_headline_says_what_is_wrong_and_what_remains():
    told = document(CAUSES, noise_floor_arcsec=3.9)
    headline, sentences = verdict_sentences(told, [WAVE])
    assert headline == (
        'The error has a wave (3.50″ RMS on the sky). The only error found beyond the terms of the '
        'model. RMS 4.30″ with it, cross-validated (5.67″ without, −24 %)')
    assert sentences[0] == 'One effect beyond the seven declared terms; the cause is open.'
    assert way(told) in sentences and way(told).startswith(
        'RMS on the sky: 134.7″ raw, 5.67″ with the seven declared terms, 4.30″')
    assert way({**told, 'as_read_rms_arcsec': None}) == ''
    held = {'holdout_rms_arcsec': 5.0}
    told['before'], told['after'] = {**told['before'], **held}, {**told['after'], **held}
    headline, sentences = verdict_sentences(told, [WAVE])
    assert headline.endswith('on held-out runs (5.00″ without, +0 %): that is no gain')
    assert 'Cross-validated within the fitted runs it is 4.30″: ' in sentences[-1]


def slow(size, **more):
    trend = {'rate_arcsec_per_hour': -226.4, 'share': 0.8, 'removes_rms_arcsec': 55.0}
    return {'slow': True, 'along_the_sky': {'step_deg': 9.0, 'any_deg': 51.0},
            'removes_rms_arcsec': size, 'text': 'neighbouring rows err alike',
            'axes': {'az': {'trend': {**trend, 'share': 0.2}}, 'el': {'trend': trend}}, **more}


def test_what_moves_slowly_leads_where_it_is_the_largest():
    told = document(CAUSES, mount='german', wander=slow(62.6))
    told['effects'][0]['removes_rms_arcsec'] = 3.5
    told['after'] = {**told['after'], 'cv_rms_arcsec': 5.3}
    headline, sentences = verdict_sentences(told, [WAVE])
    assert headline == (
        'The largest error is a drift with time or over the sky, cause unknown '
        '(62.6″ RMS on the sky): the declination error falls by 226″ an hour. Second: the error '
        'has a wave (3.50″ RMS on the sky). RMS 5.30″ with it, cross-validated (5.67″ without, '
        '−7 %): most of the error is unexplained')
    assert sentences[0] == 'Neighbouring rows err alike.'
    small = {**told, 'wander': slow(3.0)}
    headline, sentences = verdict_sentences(small, [WAVE])
    assert headline.startswith('The error has a wave') and 'only error found' in headline
    assert sentences[0].startswith('One effect') and 'Neighbouring rows err alike.' in sentences


def test_a_zero_that_wanders_evenly_has_its_rate_in_the_headline():
    told = {**document([]), 'verdict': 'wanders', 'effects': [], 'wander': slow(62.6)}
    headline, _ = verdict_sentences(told)
    assert headline.endswith(
        'the model lacks an effect of direction: the elevation error falls by 226″ an hour')
    assert short_headline(told, ()).endswith(
        'the zero drifts. An effect of direction or of each star explains it as well.')
    headline, _ = verdict_sentences({**told, 'wander': {**slow(62.6), 'along_the_sky': None}})
    assert headline == ('The zero drifts; the cause is unknown: the elevation error falls by 226″ '
                        'an hour')


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
    ((3.7, 3.1, 5.2), True, 'the zero drifts less by then than over the whole run, and the '
     'difference is within its uncertainty.'),
    ((3.0, 2.5, 3.5), False, 'late rows may scatter less than the others.'),
    ((4.2, 3.1, 5.2), True, 'in the ten rows after the last row: 4.20″ (3.10″ to 5.20″, 90 %).')])
def test_which_figure_to_quote_and_why_others_differ(figures, wanders, said):
    told = document(CAUSES, noise_floor_arcsec=3.9, wander={'slow': wanders}, expected=dict(
        zip(('rms_arcsec', 'low_arcsec', 'high_arcsec'), figures), within='ten rows'))
    text = figures_sentence(told)
    assert text.startswith('Use 4.30″ RMS (cross-validated). ') and text.endswith(said)
    assert 'Fit RMS corrected for degrees of freedom: 3.90″' in text
    assert ('includes the drift of the zero, so it is no noise floor' in text) == wanders
    assert ('3.90″ (noise floor)' in text) != wanders
    assert ('It can be below ' in text) == (figures[0] < 3.9)
    fitted = {'before': {'rms_arcsec': 5.4}, 'after': {'rms_arcsec': 3.7}}
    assert figures_sentence({**told, **fitted}).startswith(
        '3.70″ is the RMS of the fitted rows only')


@pytest.mark.parametrize('slow, blocks, low', [(True, 5.3, True), (False, 5.3, False),
                                               (True, 4.1, False)])
def test_the_figure_of_blocks_of_time_is_quoted_everywhere(slow, blocks, low):
    told = document(CAUSES, wander={'slow': slow, 'text': 'it wanders'},
                    cv_contiguous={'before': 6.1, 'after': blocks})
    headline, sentences = verdict_sentences(told, [Statement('A.')])
    assert f'RMS {blocks:.2f}″ with it, cross-validated in blocks of time (' in headline
    text = figures_sentence(told)
    assert text.startswith(f'Use {blocks:.2f}″ RMS (cross-validated in blocks of time)')
    assert f'{blocks:.2f}″ with one effect more; cross-validated in blocks of time.' in way(told)
    assert ('4.30″, cross-validated in random folds, is too low' in text) == low


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
    assert choice_sentence(told) == ''
    told['after'] = {**told['after'], 'cv_spread': spread}
    assert choice_sentence(told) == (
        'found in 160 resamples:\n  90 saddle cross term\n  others: 70 a, 50 b, 2 c, 2 more\n'
        '  1 no effect')
    two = {'folds': 7, 'same_choice': 0, 'chosen': {'x': 0, 'y': 7}}
    assert choice_sentence({**told, 'after': {'cv_spread': two}}).endswith(
        '\n  7 y\n  0 x\n  0 exactly these')
    assert choice_sentence({**told, 'verdict': 'none'}) == ''
    # what repeats is the set of equal causes: another one of it is no other effect
    spread |= {'chosen_set': {'fork_cross_term': 155}, 'others_set': {'b': 2}}
    assert ('  155 saddle cross term (65 by an equal cause)\n  others: 2 b\n'
            ) in choice_sentence(told)


@pytest.mark.parametrize('found, uncertain', [(4, True), (79, True), (80, False)])
def test_a_cause_that_few_resamples_find_is_uncertain(found, uncertain):
    told = document(CAUSES, runs=1)
    told['after'] = {**told['after'], 'cv_spread': {
        'folds': 160, 'chosen_set': {told['effects'][0]['name']: found}}}
    summary = summary_of(told, ['elevation encoder'], [5.0])
    assert f'({"uncertain: " * uncertain}in {found} of 160 resamples)' in summary.headline
    assert any('trust the RMS, not the causes' in one for one in summary.cautions) == uncertain


def test_effects_are_ranked_with_their_size():
    told = document(CAUSES)
    told['effects'] = [{'name': 'a', 'removes_rms_arcsec': 1.0, 'cv_gain_arcsec': 0.4,
                        'axes': 'el'}, {'name': 'b', 'removes_rms_arcsec': 3.0}]
    effects = [Statement('A.'), Statement('B.')]
    _, sentences = verdict_sentences(told, effects)
    assert [text for text in sentences if text[0] in '12'] == ['1. B.', '2. A.']
    _, sentences = verdict_sentences(told, effects, limit=1)
    assert sentences[1:3] == ['B.', 'And 1 more, smaller.']


def test_proposals_that_do_not_serve_the_largest_effect_say_so():
    small = {**contended(), 'name': 'declination_nod_2', 'removes_rms_arcsec': 1.8}
    star = {'az_deg': 60.0, 'el_deg': 17.0, 'separates': ['declination_nod_2', 'line_of_sight_2'],
            'separation_before': 0.7, 'separation_after': 5.9}
    told = {**document([], next_observations=[star]), 'effects': [contended(open=False), small]}
    text = serves_sentence(told)
    assert 'The largest is hour angle encoder, 2 per turn (4.60″ RMS on the sky): ' in text
    assert 'it has one likely cause' in text
    star['separates'][0] = 'hour_angle_encoder_2'
    assert serves_sentence(told) == '' == serves_sentence({**told, 'next_observations': []})


def test_how_often_all_was_chosen_stands_beside_what_was_found():
    told = document(CAUSES)
    told['after'] = {**told['after'], 'cv_spread': {
        'folds': 150, 'same_choice': 37, 'chosen': {'elevation_encoder_2': 99}}}
    assert repeat_sentence(told) == 'Stability: exactly this effect in 37 of 150 resamples.'
    told['effects'] = [{**told['effects'][0], 'removes_rms_arcsec': 2.0}, {'name': 'b'}]
    assert repeat_sentence(told).endswith(
        'these two effects in 37 of 150 resamples; the largest in 99.')
    told['after']['cv_spread'] |= {'same_set': 120, 'chosen_set': {'elevation_encoder_2': 148}}
    assert repeat_sentence(told).endswith(
        'exactly these two effects in 120 of 150 resamples; the largest in 148.')
    told['after']['cv_spread'] |= {'same_choice': 0, 'same_set': 0, 'chosen_set': None}
    assert 'in 0 of 150 resamples; the largest in 99.' in repeat_sentence(told)
    told['after']['cv_spread'] |= {'runs': 5, 'runs_set': {'elevation_encoder_2': 4, 'b': 0}}
    assert repeat_sentence(told).endswith(
        'Of 5 runs or sessions, each alone, 4 show the largest.')
    assert repeat_sentence(document(CAUSES)) == ''


def test_a_star_for_the_largest_effect_or_none():
    row = {'az_deg': 60.0, 'el_deg': 17.0, 'separates': ['elevation_encoder_2', 'second_flexure'],
           'separation_before': 0.7, 'separation_after': 5.9}
    told = document(CAUSES, next_observations=[row])
    text = next_sentence(told, told['effects'][0])
    assert 'Observe first azimuth 60°, elevation 17°. ' in text and 'still below 6' in text
    later = document(CAUSES, next_observations=[{**row, 'after_hours': 2.0}])
    assert '17°, 2 h after the last row (something in one of the explanations changes with ' \
        'time). ' in next_sentence(later, later['effects'][0])
    told = document(CAUSES, no_star=[row['separates']])
    assert next_sentence(told, told['effects'][0]).startswith(
        f'No star separates {CAUSES[1]["cause"]} from the other')
    sentence, = no_star_sentences(told).values()
    assert no_star_sentences({**told, 'no_star': [['a', 'b', 'c', 'b']]})['a'].startswith(
        'No star separates a from b or c.')
    assert 'second flexure of the tube' in sentence and '_' not in sentence
    assert next_sentence(told, {'name': 'a', 'causes': CAUSES[:1]}) == ''


def test_signs_in_words():
    mirror = 'azimuth of catalogue and encoders counted the other way'
    text, = signs_sentences([mirror, 'mount and catalogue exchanged'], ALTAZ.names)
    assert text.startswith('signs: the columns were taken as the file names them')
    assert f'exchange mount and catalogue, or {mirror}' in text
    assert signs_sentences([], ALTAZ.names) == []
    # a format of fixed columns names none
    assert WANTED['RAA'] == ('az', 'el') and WANTED['TAA'] == ('az_enc', 'el_enc')
    text, = signs_sentences([mirror], ALTAZ.names, mmt.FORMAT.taken)
    assert 'RAA, with the refraction in it, was taken for the catalogue and TAA for the' in text
    text, = signs_sentences([mirror], ALTAZ.names, tpoint_data.FORMAT.taken)
    assert 'taken as catalogue' in text and 'the file names' not in text
    assert 'zenith distance' in signs_sentences(['zenith distance in place'], ALTAZ.names)[0]
