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

"""Effects of the direction alone that have a term: flexure, refraction, omitted terms."""

from pointing_model.mount_kinds import KINDS, USUAL
from pointing_model.pointing_terms import ZERO, Trig, terms_of

from .base import Effect, Offer, effect, form

_TERM_EFFECTS = {
    # name: (term, cause, formula, symptom, what to check)
    'refraction': (
        'TX', 'refraction constant wrong, or flexure that grows as cot E', '(0, cot E)',
        'Stars near the horizon are off as refraction would be: the refraction that was applied '
        'is wrong, or tube flexure looks alike',
        'pressure, temperature and wavelength that the refraction was computed with'),
    'refraction_cube': (
        'TX3', 'third order of the refraction wrong', '(0, cot^3 E)',
        'Stars very near the horizon are off: the refraction that was applied is wrong there',
        'the refraction formula below 15° of elevation'),
    'second_flexure': (
        'ECES', 'second flexure of the tube, or elevation encoder off centre', '(0, sin E)',
        'Tube flexure as the sine of the elevation, or the disc of the elevation encoder is off '
        'its centre',
        'bolts of the mirror cell and of the camera; the centring of the elevation disc'),
}


#: observed shapes
_SHAPES = {'refraction': 'a rise toward the horizon, as cot E',
           'refraction_cube': 'a steep rise near the horizon, as cot³ E',
           'second_flexure': 'a curve of the elevation, as sin E',
           'fork_flexure': 'a curve of the hour angle, as cos h',
           'declination_axis_flexure': 'a shift to one side that grows with the elevation'}
#: shorter cause, where the alternative in the full text has its own effect
_SUMMARIES = {'second_flexure': 'second flexure of the tube (as sin E)'}
#: for mounts other than alt-azimuth ones: flexure toward the zenith is not an error of an axis
_ELSEWHERE = {
    **{name: _TERM_EFFECTS[name] for name in ('refraction', 'refraction_cube')},
    'second_flexure': (
        'HZCZ', 'second flexure of the tube', 'sin E upward',
        'Tube flexure as the sine of the elevation',
        'bolts of the mirror cell and of the camera'),
    'fork_flexure': (
        'FO', 'flexure of the {0}', '(0, cos h)',
        'Flexure of the {0}: the declination error is the cosine of the hour angle',
        'stiffness of the {0}, and of the polar axis'),
    'declination_axis_flexure': (
        'DAF', 'flexure of the declination axis', '(-sin E, 0)',
        'Flexure of the declination axis: the higher the star, the farther it is to one side',
        'stiffness of the declination axis and its bearings; the counterweight'),
}


def _named(kind):
    table = _TERM_EFFECTS if KINDS[kind].vertical else _ELSEWHERE
    return {name: tuple(text.format(KINDS[kind].carrier) for text in row)
            for name, row in table.items() if row[0] in terms_of(kind)}


@form
def _terms(name, mount=USUAL):
    term, cause, formula, sentence, look_at = _named(mount)[name]
    known = terms_of(mount)[term]
    plain = KINDS[mount].vertical
    axes = 'el' if plain else {'FO': 'el', 'DAF': 'az'}.get(term, 'both')
    return Effect(name, cause, formula if plain else known.formula,
                  'hour_angle' if name == 'fork_flexure' else 'elevation', axes, (term,),
                  lambda c: [known.of(c.trig)], lambda _: sentence, look_at,
                  _SHAPES[name], _SUMMARIES.get(name, ''),
                  tpoint=term if known.tpoint_sign else None,
                  effort=0 if name.startswith('refraction') else 1)


@form
def _term(name, mount=USUAL):
    """A term of the mount that the declared model lacks, to first order."""
    term, names = terms_of(mount)[name], KINDS[mount]
    own = names.terms.get(name, ('', 1))[0]
    if KINDS[mount].vertical:
        x, y = term.of(Trig(1.0, 0.5))
        axes = 'el' if x is ZERO else 'az' if y is ZERO else 'both'
        driver = 'azimuth' if 'A' in term.formula else 'elevation'
    else:
        axes = {'IA': 'az', 'IE': 'el', 'CA': 'az', 'NPAE': 'az'}.get(own, 'both')
        driver = names.key('az' if own in ('AN', 'AW') else 'el') if own != 'TF' else 'elevation'
    return Effect(name, term.doc + (', or the latitude is wrong' if name == 'AN' else ''),
                  term.formula, driver, axes, (name,),
                  lambda c: [term.of(c.trig)],
                  look_at='whether the declared model should have this term (--base)', effort=0,
                  shape=f'the pattern of the term {name} over the sky',
                  tpoint=name if term.tpoint_sign else None)


@form
def _fork_cross_term(mount=USUAL):
    names, carried = KINDS[mount], KINDS[mount].carrier
    a, e = names.letters
    return Effect('fork_cross_term', f'{carried} flexure that turns with the '
                  f'{names.word("az")}',
                  f'(0, sin {e} cos {a}), (0, sin {e} sin {a})', names.key('az'), 'el',
                  ('cos', 'sin'),
                  lambda c: [(0.0, c.trig.sin_el * c.trig.cos_az),
                             (0.0, c.trig.sin_el * c.trig.sin_az)],
                  look_at=f'stiffness of the {carried} and its joint with the {names.shaft("az")}',
                  shape=f'a wave of the {names.word("az")}, once per turn, larger high up',
                  summary=f'{carried} flexure that turns with the {names.word("az")}')


def propose(context, lacking, own):
    """Terms that the declared model may lack; they need only the directions."""
    named = _named(context.mount.kind)
    # the dictionary has the same columns as these under another name
    alike = [term for term, *_ in named.values()]
    yield Offer('term', [effect('term', name=name, mount=context.mount.kind) for name in lacking
                         if name not in alike])
    yield Offer('terms', [effect('terms', name=name, mount=context.mount.kind) for name in named])
    yield Offer('fork_cross_term', [effect('fork_cross_term')])
