"""What follows the direction alone and has a term: refraction, flexure, terms left out."""

from pointing_model.terms import TERMS, ZERO, Trig

from .base import Effect, Offer, effect, form, proposal

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
                  tpoint=TERMS[term].tpoint_name or None, source='TPOINT')


#: name: (formula, driver that shows it)
_TERM_COLUMNS = {
    'IA': ('(cos E, 0)', 'elevation'), 'IE': ('(0, 1)', 'elevation'),
    'CA': ('(1, 0)', 'elevation'), 'NPAE': ('(sin E, 0)', 'elevation'),
    'AN': ('(sin A sin E, cos A)', 'azimuth'), 'AW': ('(cos A sin E, -sin A)', 'azimuth'),
    'TF': ('(0, cos E)', 'elevation'), 'TX': ('(0, cot E)', 'elevation'),
    'TX3': ('(0, cot^3 E)', 'elevation'), 'ECES': ('(0, sin E)', 'elevation'),
    'HECE2': ('(0, cos 2E)', 'elevation'), 'HESE2': ('(0, sin 2E)', 'elevation'),
    'ACEC': ('(cos A cos E, 0)', 'azimuth'), 'ACES': ('(sin A cos E, 0)', 'azimuth'),
    'HACA2': ('(cos 2A cos E, 0)', 'azimuth'), 'HASA2': ('(sin 2A cos E, 0)', 'azimuth'),
    'HECA': ('(0, cos A)', 'azimuth'), 'HESA': ('(0, sin A)', 'azimuth'),
    'HECA2': ('(0, cos 2A)', 'azimuth'), 'HESA2': ('(0, sin 2A)', 'azimuth'),
    'HVCA2': ('(cos 2A sin E, 0)', 'azimuth'), 'HVSA2': ('(sin 2A sin E, 0)', 'azimuth'),
}
#: of these the dictionary has the same columns under another name
_NAMED = tuple(term for term, *_ in _TERM_EFFECTS.values())


@form
def _term(name):
    """A term of `terms.TERMS` that the declared model does not have, in first order."""
    term, (formula, driver) = TERMS[name], _TERM_COLUMNS[name]
    x, y = term.of(Trig(1.0, 0.5))
    axes = 'el' if x is ZERO else 'az' if y is ZERO else 'both'
    return Effect(name, term.doc + (', or the latitude is wrong' if name == 'AN' else ''), formula,
                  driver, axes, (name,), lambda c: [term.of(c.trig)],
                  look_at='whether the declared model should have this term (--base)',
                  tpoint=term.tpoint_name, source='TPOINT' if term.tpoint_name else 'geometry')


@form
def _fork_cross_term():
    return Effect('fork_cross_term', 'fork bends: flexure that turns with the azimuth',
                  '(0, sin E cos A), (0, sin E sin A)', 'azimuth', 'el', ('cos', 'sin'),
                  lambda c: [(0.0, c.trig.sin_el * c.trig.cos_az),
                             (0.0, c.trig.sin_el * c.trig.sin_az)],
                  look_at='stiffness of the fork and its joint with the azimuth bearing')


@proposal
def propose(context, lacking, own):
    """Terms that the declared model may lack; whatever it is, the directions are known."""
    yield Offer('term', [effect('term', name=name) for name in lacking if name not in _NAMED])
    yield Offer('terms', [effect('terms', name=name) for name in _TERM_EFFECTS])
    yield Offer('fork_cross_term', [effect('fork_cross_term')])
