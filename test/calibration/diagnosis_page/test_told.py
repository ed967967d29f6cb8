"""What is said of causes, of single rows and of nights held out."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis.facts import bad_nights, nights_held_out, worst_sentence
from calibration.diagnosis.result import diagnosed
from calibration.diagnosis_page.plain_words import verdict_sentences
from calibration.diagnosis_page.told import (
    WORDS,
    explained,
    next_sentence,
    no_star_sentences,
    signs_sentences,
    way,
)
from calibration.term_notes import notes_of_terms
from msg_tools.units import ARCSEC
from pointing_model.effects import effect
from pointing_model.effects.words import coefficient_word, common_shape
from pointing_model.fitted_effects import FittedEffect
from pointing_model.mounts import ALTAZ

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
    assert common_shape([nod.shape, wobble.shape], 'azimuth') == \
        'a wave of the azimuth, once per turn'
    assert common_shape([nod.shape, 'a rise'], 'azimuth') == 'a curve of the azimuth'
    saw = effect('smooth', axis='el', driver='elevation', shape='sawtooth', start=0.0,
                 period=np.radians(15.2))
    assert saw.shape == 'a sawtooth of the elevation with a period of 15.2°'
    assert coefficient_word(saw, 's1') == 'height of a tooth'


def test_the_way_is_the_headline_where_the_readings_are_known():
    told = document(CAUSES)
    headline, sentences = verdict_sentences(told, ['The error has a wave.'], whole=True)
    assert headline == way(told) == ('From 134.7″ as the encoders read to 5.67″ with 7 terms, and '
                                     'to 4.30″ with 1 effect beyond them')
    assert sentences[0] == ('One effect found beyond the terms, and more than one cause would '
                            'explain it. RMS on the sky, on rows left out.')
    assert way({**told, 'as_read_rms_arcsec': None}) == ''


def test_a_star_for_the_largest_effect_or_none():
    row = {'az_deg': 60.0, 'el_deg': 17.0, 'separates': ['elevation_encoder_2', 'second_flexure'],
           'separation_before': 0.7, 'separation_after': 5.9}
    told = document(CAUSES, next_observations=[row])
    text = next_sentence(told, told['effects'][0])
    assert 'observe first azimuth 60°, elevation 17°' in text and 'still below 6' in text
    told = document(CAUSES, no_star=[row['separates']])
    assert next_sentence(told, told['effects'][0]).startswith('No star tells them apart')
    sentence, = no_star_sentences(told)
    assert 'second flexure of the tube' in sentence and '_' not in sentence
    assert next_sentence(told, {'name': 'a', 'causes': CAUSES[:1]}) == ''


def test_worst_rows():
    def rows(before, after):
        keys = 'row', 'before_arcsec', 'after_arcsec'
        return {'worst_rows': {'before': dict(zip(keys, before)), 'after': dict(zip(keys, after))}}
    assert worst_sentence(rows((3, 9.0, 2.0), (4, 5.0, 4.0))) == ''
    assert 'row 3, became worse: 9.00″ before, 9.50″' in worst_sentence(
        rows((3, 9.0, 9.5), (3, 9.0, 9.5)))
    assert worst_sentence(rows((3, 9.0, 2.0), (4, 3.0, 5.0))).startswith('Row 4 became the worst')


@pytest.mark.parametrize('size, bad', [((1.0, 1.0), False), ((1.0, 6.0), True)])
def test_a_bad_night_is_told_by_axis(size, bad):
    rng = np.random.default_rng(2)
    left = rng.normal(size=(2, 90)) * ARCSEC
    left[:, 60:] *= np.array(size)[:, None]
    obs = SimpleNamespace(label=np.repeat([0, 1, 2], 30), runs=['a.dat:0', 'b.dat:0', 'c.dat:0'],
                          sources=np.repeat(['a.dat', 'b.dat', 'c.dat'], 30))
    own = SimpleNamespace(residual_after=rng.normal(size=(2, 60)) * ARCSEC, weights=np.ones(60))
    nights = nights_held_out(obs, [left, left], np.ones(90, bool), own)
    assert [bool(night['bad']) for night in nights] == [False, False, bad]
    said = bad_nights({'held_out': nights}, ('azimuth', 'elevation'))
    assert len(said) == bad
    if bad:
        assert 'c.dat is bad: azimuth' in said[0] and 'as the others, elevation' in said[0]


def test_a_tube_that_bends_up():
    row = {'name': 'TF', 'value_arcsec': -78.1, 'sigma_arcsec': 6.3}
    assert 'as if the tube bent up' in notes_of_terms([row])[0]
    assert not notes_of_terms([{**row, 'value_arcsec': -12.0}, {**row, 'name': 'TX'},
                               {**row, 'value_arcsec': 78.1}])


def test_signs_in_words():
    mirror = 'azimuth of catalogue and encoders counted the other way'
    text, = signs_sentences([mirror, 'mount and catalogue exchanged'], ALTAZ.names)
    assert text.startswith('all is well') and 'every sign here be the opposite' in text
    assert signs_sentences([], ALTAZ.names) == []
    assert 'zenith distance' in signs_sentences(['zenith distance in place'], ALTAZ.names)[0]


def test_words_are_in_the_glossary():
    glossary = (ROOT / 'docs' / 'glossary.md').read_text(encoding='utf-8').lower()
    others = {'wanders': '**wander**', 'rows left out': '**left out**'}
    for word in WORDS:
        assert others.get(word, f'**{word.lower()}**') in glossary, word
    assert dict(explained('A sawtooth'))['sawtooth'] == WORDS['sawtooth']
