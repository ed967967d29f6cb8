"""What follows the direction alone and has a term: refraction, flexure, terms left out."""

from pointing_model.terms import TERMS, ZERO, Trig

from .base import Effect, Offer, effect, form

_TERM_EFFECTS = {
    # name: (term, cause, formula, what goes wrong, what to look at)
    'refraction': (
        'TX', 'refraction constant wrong, or flexure that grows as cot E', '(0, cot E)',
        'Stars near the horizon are off as refraction would be: the refraction that was applied '
        'is wrong, or the tube bends that way',
        'pressure, temperature and wavelength that the refraction was computed with'),
    'refraction_cube': (
        'TX3', 'third order of the refraction wrong', '(0, cot^3 E)',
        'Stars very near the horizon are off: the refraction that was applied is wrong there',
        'the refraction formula below 15° of elevation'),
    'second_flexure': (
        'ECES', 'second flexure of the tube, or elevation encoder off centre', '(0, sin E)',
        'The tube bends with the sine of the elevation, or the disc of the elevation encoder is '
        'off its centre',
        'the centring of the elevation disc; bolts of the mirror cell and of the camera'),
}


@form
def _terms(name):
    term, cause, formula, sentence, look_at = _TERM_EFFECTS[name]
    return Effect(name, cause, formula, 'elevation', 'el', (term,),
                  lambda c: [TERMS[term].of(c.trig)], lambda _: sentence, look_at,
                  tpoint=term if TERMS[term].tpoint_sign else None)


#: of these the dictionary has the same columns under another name
_NAMED = tuple(term for term, *_ in _TERM_EFFECTS.values())


@form
def _term(name):
    """A term of `terms.TERMS` that the declared model does not have, in first order."""
    term = TERMS[name]
    x, y = term.of(Trig(1.0, 0.5))
    axes = 'el' if x is ZERO else 'az' if y is ZERO else 'both'
    return Effect(name, term.doc + (', or the latitude is wrong' if name == 'AN' else ''),
                  term.formula, 'azimuth' if 'A' in term.formula else 'elevation', axes, (name,),
                  lambda c: [term.of(c.trig)],
                  look_at='whether the declared model should have this term (--base)',
                  tpoint=name if term.tpoint_sign else None)


@form
def _fork_cross_term():
    return Effect('fork_cross_term', 'fork bends: flexure that turns with the azimuth',
                  '(0, sin E cos A), (0, sin E sin A)', 'azimuth', 'el', ('cos', 'sin'),
                  lambda c: [(0.0, c.trig.sin_el * c.trig.cos_az),
                             (0.0, c.trig.sin_el * c.trig.sin_az)],
                  look_at='stiffness of the fork and its joint with the azimuth bearing')


def propose(context, lacking, own):
    """Terms that the declared model may lack; whatever it is, the directions are known."""
    yield Offer('term', [effect('term', name=name) for name in lacking if name not in _NAMED])
    yield Offer('terms', [effect('terms', name=name) for name in _TERM_EFFECTS])
    yield Offer('fork_cross_term', [effect('fork_cross_term')])
