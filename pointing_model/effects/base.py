"""Families of effects: what a mount may do beyond its declared terms, and how it would show.

An effect is a group of first-order columns (x, y), on the sky, encoder - catalogue, that belong
together physically, with the driver that makes it visible. The same object evaluates them for a
run (to look for it) and for a pointing (to correct it). A row whose driver is unknown (NaN, or a
column that is not there) gets zero: the drivers are centred, so this is the effect's value in the
middle of the run that it was found in.

Sources: TPOINT (P. T. Wallace, names of terms), paper 000 (circular gratings, drift of the zero),
paper 001 (bars of a coded disc, decoding); first-order geometry otherwise.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.terms import TERMS, ZERO, Trig

_TURN = 2.0 * np.pi
#: periods of the encoders' graduation, radians (paper 000: lines; paper 001: bars)
PERIODS = {'grating': _TURN / 47200, 'bars': _TURN / 1080}
AXES = {'az': 'azimuth', 'el': 'elevation'}
_ZERO_TERM = {'az': 'IA', 'el': 'IE'}
_HOUR = 3600.0


@dataclass(frozen=True)
class Effect:
    """One candidate effect.

    Attributes
    ----------
    family : str
        What builds it again: ``effect(family, **parameters)``.
    parameters : dict
        JSON values.
    name : str
        Unique.
    cause, formula : str
        In plain words; columns (x, y) for each coefficient.
    driver : str
        Name in `Context.get`.
    axes : {'az', 'el', 'both'}
        Where it acts.
    coefficient_names : tuple of str, length k
    of : callable
        `Context` -> list of k pairs (x, y); 0.0 is zero everywhere.
    unit : str
        Of a coefficient; ``'s'`` and ``'yr'`` are written as that many "arcsec".
    tpoint : str or None
        Names of the same terms in TPOINT.
    source : str
    requires : tuple of str
        Drivers without which it cannot be tested.
    alias : str or None
        Terms that it equals exactly, in words.
    scan : str or None
        Members of one scan (unknown time of a step, ...) share this name: one of them is meant,
        and its choice costs an extra ln n.
    kind : {'effect', 'smooth'}
    """

    family: str
    parameters: dict
    name: str
    cause: str
    formula: str
    driver: str
    axes: str
    coefficient_names: tuple
    of: Callable = field(compare=False, repr=False)
    unit: str = 'arcsec'
    tpoint: str | None = None
    source: str = 'geometry'
    requires: tuple = ()
    alias: str | None = None
    scan: str | None = None
    kind: str = 'effect'

    def columns(self, context):
        """Design columns.

        Parameters
        ----------
        context : Context
            n rows.

        Returns
        -------
        ndarray, shape (k, 2, n)
            On-sky offset (x, y), encoder - catalogue, for unit coefficients; zero in rows whose
            driver is unknown.
        """
        out = np.zeros((len(self.coefficient_names), 2, len(context)))
        if all(context.get(name) is not None for name in self.requires):
            with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
                for row, (x, y) in zip(out, self.of(context)):
                    row[0], row[1] = x, y
            # unknown drivers, and cot E on the horizon
            np.nan_to_num(out, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
        return out


_FAMILIES = {}


def family(build):
    """Register a function that builds an `Effect` from parameters under its name."""
    _FAMILIES[build.__name__.lstrip('_')] = build
    return build


def effect(family, **parameters):
    """Build an effect by its family and parameters.

    Parameters
    ----------
    family : str
    parameters
        Of the family.

    Returns
    -------
    Effect

    Raises
    ------
    ValueError
        Unknown family, or parameters that do not fit it.
    """
    build = _FAMILIES.get(family)
    if build is None:
        raise ValueError(f'unknown effect {family!r}; known are {", ".join(sorted(_FAMILIES))}')
    try:
        return build(**parameters)
    except (TypeError, KeyError, IndexError) as error:
        raise ValueError(f'effect {family} with wrong parameters {parameters}: {error}') from None


def make(family, parameters, name, cause, formula, driver, axes, coefficients, of, **rest):
    """An `Effect` from positional texts."""
    return Effect(family, parameters, name, cause, formula, driver, axes, tuple(coefficients), of,
                  **rest)


def _on(axis, value, cos_el):
    """Pair for an error of an axis' angle: on the sky the azimuth's is times cos E."""
    return (value * cos_el, 0.0) if axis == 'az' else (0.0, value)


# --------------------------------------------------------------------- direction: existing terms

_TERM_EFFECTS = {
    # name: (terms, cause, formula, driver, axes)
    'refraction': (('TX',), 'refraction constant wrong, or flexure that grows as cot E',
                   '(0, cot E)', 'elevation', 'el'),
    'refraction_cube': (('TX3',), 'third order of the refraction wrong', '(0, cot^3 E)',
                        'elevation', 'el'),
    'second_flexure': (('ECES',), 'second flexure of the tube, or elevation encoder off centre',
                       '(0, sin E)', 'elevation', 'el'),
}


@family
def _terms(name):
    names, cause, formula, driver, axes = _TERM_EFFECTS[name]
    return make('terms', {'name': name}, name, cause, formula, driver, axes, names,
                 lambda c: [TERMS[n].of(c.trig) for n in names],
                 tpoint=' '.join(t for t in (TERMS[n].tpoint_name for n in names) if t) or None,
                 source='TPOINT')


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


@family
def _term(name):
    """A term of `terms.TERMS` that the declared model does not have, in first order."""
    term, (formula, driver) = TERMS[name], _TERM_COLUMNS[name]
    x, y = term.of(Trig(1.0, 0.5))
    axes = 'el' if x is ZERO else 'az' if y is ZERO else 'both'
    return make('term', {'name': name}, name,
                 term.doc + (', or the latitude is wrong' if name == 'AN' else ''), formula, driver,
                 axes, (name,), lambda c: [term.of(c.trig)], tpoint=term.tpoint_name,
                 source='TPOINT' if term.tpoint_name else 'geometry')


@family
def _encoder(axis, order):
    """Harmonic of an encoder, `order` a turn."""
    k = int(order)
    az = axis == 'az'
    names = {('az', 1): 'ACEC ACES', ('az', 2): 'HACA2 HASA2', ('el', 1): 'ECEC ECES',
             ('el', 2): 'HECE2 HESE2'}
    letter = 'A' if az else 'E'

    def of(c):
        angle = k * (c.az if az else c.el)
        return [_on(axis, f(angle), c.trig.cos_el) for f in (np.cos, np.sin)]

    cause = 'encoder disc off its centre' if k == 1 else \
        ('encoder disc oval or tilted, or two heads uneven' if k == 2 else
         'encoder or its coupling uneven')
    return make('encoder', {'axis': axis, 'order': k}, f'{AXES[axis]}_encoder_{k}',
                 f'{AXES[axis]} {cause}: {k} a turn',
                 f'cos {k}{letter}, sin {k}{letter} on the {AXES[axis]} angle'
                 + (' (on the sky x cos E)' if az else ''),
                 AXES[axis], axis, ('cos', 'sin'), of,
                 tpoint=names.get((axis, k), f'H{letter}C{letter}{k} H{letter}S{letter}{k}'),
                 source='TPOINT; paper 001, centring of the disc')


@family
def _bearing_wobble(order):
    k = int(order)

    def of(c):
        ca, sa, se = np.cos(k * c.az), np.sin(k * c.az), c.trig.sin_el
        return [(0.0, ca), (0.0, sa), (se * ca, 0.0), (se * sa, 0.0)]

    return make('bearing_wobble', {'order': k}, f'azimuth_bearing_wobble_{k}',
                 f'azimuth axis wobbles {k} a turn: bearing or track not flat',
                 f'(0, cos {k}A), (0, sin {k}A), (sin E cos {k}A, 0), (sin E sin {k}A, 0)',
                 'azimuth', 'both', ('el_cos', 'el_sin', 'az_cos', 'az_sin'), of,
                 tpoint='HECA HESA HVCA HVSA' if k == 1 else f'HECA{k} HESA{k} HVCA{k} HVSA{k}',
                 source='TPOINT')


@family
def _nod(order):
    k = int(order)
    return make('nod', {'order': k}, f'elevation_nod_{k}',
                 f'the mount nods {k} a turn of azimuth', f'(0, cos {k}A), (0, sin {k}A)',
                 'azimuth', 'el', ('cos', 'sin'),
                 lambda c: [(0.0, np.cos(k * c.az)), (0.0, np.sin(k * c.az))],
                 tpoint='HECA HESA' if k == 1 else f'HECA{k} HESA{k}', source='TPOINT')


@family
def _elevation_axis_wobble(order):
    k = int(order)
    return make('elevation_axis_wobble', {'order': k}, f'elevation_axis_wobble_{k}',
                 f'elevation axis wobbles {k} a turn',
                 f'(sin E cos {k}E, 0), (sin E sin {k}E, 0)', 'elevation', 'az', ('cos', 'sin'),
                 lambda c: [(c.trig.sin_el * np.cos(k * c.el), 0.0),
                            (c.trig.sin_el * np.sin(k * c.el), 0.0)])


@family
def _fork_cross_term():
    return make('fork_cross_term', {}, 'fork_cross_term',
                 'fork bends: flexure that turns with the azimuth',
                 '(0, sin E cos A), (0, sin E sin A)', 'azimuth', 'el', ('cos', 'sin'),
                 lambda c: [(0.0, c.trig.sin_el * c.trig.cos_az),
                            (0.0, c.trig.sin_el * c.trig.sin_az)])


# --------------------------------------------------- a term that follows time, temperature, ...

_DRIFT_OF = {
    'IA': ('azimuth zero', 'az'), 'IE': ('elevation zero', 'el'), 'CA': ('collimation', 'az'),
    'TF': ('flexure', 'el'), 'tilt': ('tilt of the azimuth axis', 'both'),
}
#: drivers in words, where their name is not the word
DRIVER_WORDS = {'order': 'order of the rows', 'run_hours': 'time since the start of the run'}


def _pattern(of):
    return ('AN', 'AW') if of == 'tilt' else (of,)


@family
def _drift(of, driver, power=1, origin=0.0, scale=1.0, within=None):
    """A term x ((driver - origin) / scale)^power; the driver is held at the ends of `within`."""
    what, axes = _DRIFT_OF[of]
    word = DRIVER_WORDS.get(driver, driver)
    symbol = {'time': 't', 'temperature': 'T', 'order': 'n',
              'run_hours': '(t - start of the run)'}.get(driver, driver)
    names = _pattern(of)

    def columns(c):
        u = c.get(driver) if within is None else np.clip(c.get(driver), *within)
        u = ((u - origin) / scale) ** power
        return [(x * u, y * u) for x, y in (TERMS[n].of(c.trig) for n in names)]

    unit = {'time': '/h', 'run_hours': '/h', 'temperature': '/K', 'order': '/run'}.get(
        driver, f'/({scale:.4g})')
    return make('drift',
                 {'of': of, 'driver': driver, 'power': power, 'origin': origin, 'scale': scale,
                  'within': within},
                 f'{what.replace(" of the azimuth axis", "").replace(" ", "_")}_with_{driver}'
                 + ('_squared' if power == 2 else ''),
                 f'{what} moves with {word}' + (', quadratically' if power == 2 else ''),
                 f'{", ".join(names)} x {symbol}' + ('^2' if power == 2 else ''), driver, axes,
                 names, columns, unit=f'arcsec{unit}' + ('^2' if power == 2 else ''),
                 source='paper 000, drift of the zero', requires=(driver,))


@family
def _step(axis, at, driver='time'):
    """A zero that jumps where the driver passes `at`."""
    return make('step', {'axis': axis, 'at': at, 'driver': driver},
                 f'{AXES[axis]}_zero_step', f'{AXES[axis]} zero jumps once: lost counts, a slip, '
                 'a reference mark found anew', f'{_ZERO_TERM[axis]} x H({driver} - tau)',
                 driver, axis, ('step',),
                 lambda c: [_on(axis, np.where(np.isnan(c.get(driver)), np.nan,
                                               1.0 * (c.get(driver) >= at)), c.trig.cos_el)],
                 source='paper 000, reference mark', requires=(driver,), scan=f'step_{axis}')


@family
def _run_zero(axis, runs):
    runs = list(runs)
    return make('run_zero', {'axis': axis, 'runs': runs}, f'{AXES[axis]}_zero_per_run',
                 f'{AXES[axis]} zero of its own in each run or power-on',
                 f'{_ZERO_TERM[axis]} in each run but the first', 'run', axis,
                 tuple(f'run {r:g}' for r in runs[1:]),
                 lambda c: [_on(axis, 1.0 * (c.get('run') == r), c.trig.cos_el)
                            for r in runs[1:]],
                 source='paper 000, Table 1', requires=('run',))


# ------------------------------------------------------------------------------------ hysteresis

@family
def _hysteresis(axis, shape='1', memory_deg=0.0):
    """Offset by the direction of approach, times 1 or cos E, reached after some degrees."""
    length = memory_deg * DEG
    requires = (f'approach_{axis}',)
    if length:
        requires += (f'travel_{axis}', f'before_{axis}')

    def of(c):
        sign = c.get(f'approach_{axis}')
        if length:
            # a move leaves part of the old side behind; unknown before: fully on the new side
            before = np.where(np.isnan(c.get(f'before_{axis}')), sign, c.get(f'before_{axis}'))
            travel = np.where(np.isnan(c.get(f'travel_{axis}')), np.inf, c.get(f'travel_{axis}'))
            sign = sign + (before - sign) * np.exp(-travel / length)
        value = sign * c.trig.cos_el if shape == 'cosE' else sign
        # of azimuth: of the encoder's angle, x cos E on the sky; or of the line of sight
        return [(value, 0.0) if axis == 'az' else (0.0, value)]

    tail = '_cosE' if shape == 'cosE' else ''
    place = {('az', '1'): ' across the line of sight', ('az', 'cosE'): '',
             ('el', '1'): '', ('el', 'cosE'): ', as the weight of the tube acts'}[axis, shape]
    return make('hysteresis', {'axis': axis, 'shape': shape, 'memory_deg': memory_deg},
                 f'{AXES[axis]}_hysteresis{tail}'
                 + (f'_memory_{memory_deg:g}deg' if length else ''),
                 f'{AXES[axis]} reads differently by the side of approach (backlash){place}'
                 + (f', reached within {memory_deg:g} degrees' if length else ''),
                 f'sign(approach{", fading over some degrees" if length else ""})'
                 + (' x cos E' if shape == 'cosE' else ''),
                 f'approach_{axis}', axis, ('half_difference',), of, source='backlash',
                 requires=requires, scan=f'memory_{axis}{tail}' if length else None)


# --------------------------------------------------------------------------- sky and catalogue

def _displaced(c, vector):
    """Offset (x, y) for a displacement of the direction by `vector`, shape (3, n)."""
    return tuple(np.sum(vector * t, axis=0) for t in c.tangent())


@family
def _annual_aberration():
    return make('annual_aberration', {}, 'annual_aberration',
                 'annual aberration left out of the star places',
                 'the part across the line of sight of a dipole fixed among the stars', 'lst',
                 'both', ('X', 'Y', 'Z'),
                 lambda c: [_displaced(c, axis) for axis in c.equatorial()]
                 if c.equatorial() is not None else [(np.nan, np.nan)] * 3,
                 source='Explanatory Supplement; 20.5"', requires=('lst',))


@family
def _diurnal_aberration():
    return make('diurnal_aberration', {}, 'diurnal_aberration',
                 'diurnal aberration left out of the star places (0.32" cos latitude)',
                 '(cos A, -sin E sin A)', 'azimuth', 'both', ('east',),
                 lambda c: [(c.trig.cos_az, -c.trig.sin_el * c.trig.sin_az)], tpoint=None,
                 source='Explanatory Supplement')


@family
def _epoch_error():
    def of(c):
        axes = c.equatorial()
        if axes is None:
            return [(np.nan, np.nan)] * 2
        place = c.direction()
        return [_displaced(c, np.cross(axis, place, axis=0)) for axis in axes[:2]]

    return make('epoch_error', {}, 'precession_or_epoch_error',
                 'star places of a wrong equinox: precession left out or applied twice',
                 'rotation about the equatorial X and Y axes', 'lst', 'both', ('X', 'Y'), of,
                 source='Explanatory Supplement', requires=('lst',))


@family
def _proper_motion():
    return make('proper_motion', {}, 'proper_motion',
                 'proper motion of the stars left out',
                 'proper motion on the sky x years', 'star', 'both', ('years',),
                 lambda c: [(c.get('pm_x'), c.get('pm_y'))], unit='yr', source='Hipparcos-2',
                 requires=('pm_x', 'pm_y'))


def _turned(c, axis):
    """Rotation of the sky about a fixed east-north-up axis."""
    return _displaced(c, np.cross(axis[:, None], c.direction(), axis=0))


@family
def _clock(latitude):
    pole = np.array([0.0, np.cos(latitude), np.sin(latitude)])
    return make('clock', {'latitude': latitude}, 'clock_or_longitude',
                 'clock, UT1 or longitude wrong (15" a second of time)',
                 'rotation about the pole', 'azimuth', 'both', ('hour_angle',),
                 lambda c: [tuple(-v for v in _turned(c, pole))],
                 alias='clock and longitude are exactly IA + AW: no pointing run can tell them '
                       'from these terms')


@family
def _latitude():
    return make('latitude', {}, 'latitude', 'latitude wrong', 'the columns of AN', 'azimuth',
                 'both', ('latitude',), lambda c: [TERMS['AN'].of(c.trig)],
                 alias='latitude is exactly AN: no pointing run can tell it from this term')


@family
def _latency():
    return make('latency', {}, 'latency', 'angles read or stamped too late (or early)',
                 '(azimuth rate x cos E, elevation rate) x delay', 'az_rate', 'both', ('delay',),
                 lambda c: [(c.get('az_rate') * c.trig.cos_el / ARCSEC,
                             c.get('el_rate') / ARCSEC)],
                 unit='s', requires=('az_rate', 'el_rate'),
                 alias='at sidereal rate latency is exactly a clock error, IA + AW: only '
                       'satellites or slews show it', source='timing')


# ------------------------------------------------------------------------- camera, star, encoder

@family
def _camera(of):
    rotation = of == 'rotation'
    return make('camera', {'of': of}, f'camera_{of}',
                 'camera turned' if rotation else 'plate scale of the camera wrong',
                 '(-m_y, m_x)' if rotation else '(m_x, m_y)', 'miss_x', 'both',
                 ('angle' if rotation else 'scale',),
                 lambda c: [(-c.get('miss_y') / ARCSEC, c.get('miss_x') / ARCSEC) if rotation
                            else (c.get('miss_x') / ARCSEC, c.get('miss_y') / ARCSEC)],
                 unit='arcsec/arcsec', requires=('miss_x', 'miss_y'), source='camera')


@family
def _proportional(axis, driver, origin=0.0, scale=1.0, pattern='sky'):
    """Offset on the sky, or of an axis' angle, proportional to a driver."""
    sky = pattern == 'sky'

    def of(c):
        u = (c.get(driver) - origin) / scale
        return [(u, 0.0) if axis == 'az' and sky else _on(axis, u, c.trig.cos_el)]

    name = 'magnitude_equation' if driver == 'magnitude' else f'{driver}'
    cause = {'magnitude': 'bright and faint stars are centred differently',
             'pier_side': 'another offset on the other side of the pier, or past the zenith'
             }.get(driver, f'follows the column {driver} of the file')
    return make('proportional', {'axis': axis, 'driver': driver, 'origin': origin,
                                  'scale': scale, 'pattern': pattern},
                 f'{name}_{axis}' + ('' if sky or axis == 'el' else '_angle'),
                 f'{cause} ({AXES[axis]})', ('' if sky or axis == 'el' else 'cos E x ') + driver,
                 driver, axis, ('slope',), of,
                 unit=f'arcsec/({scale:.4g} {driver})' if scale != 1.0 else f'arcsec/{driver}',
                 source='a column of the file', requires=(driver,))


@family
def _subdivision(axis, graduation, order):
    """Interpolation error within a line of the grating or a bar of the disc."""
    k, period = int(order), PERIODS[graduation]

    def of(c):
        # the period divides the turn, so wraps of the cable do not matter
        phase = np.mod(c.get(f'reading_{axis}'), period) * (_TURN * k / period)
        return [_on(axis, f(phase), c.trig.cos_el) for f in (np.cos, np.sin)]

    words = {'grating': f'a line of the grating ({PERIODS["grating"] / ARCSEC:.4f}")',
             'bars': 'a bar of the disc (1200")'}[graduation]
    return make('subdivision', {'axis': axis, 'graduation': graduation, 'order': k},
                 f'{AXES[axis]}_subdivision_{graduation}_{k}',
                 f'{AXES[axis]} encoder divides {words} unevenly, {k} in each',
                 f'cos, sin of 2 pi {k} reading / period', f'reading_{axis}', axis,
                 ('cos', 'sin'), of, source='paper 000, 400-fold interpolation; paper 001, eq. 12',
                 requires=(f'reading_{axis}',))


@family
def _decode_slip(axis, rows, multiples, graduation):
    """Whole bars or lines too many in single rows: known amounts, nothing to predict."""
    step = PERIODS[graduation]

    def of(c):
        row = c.get('row')
        value = np.zeros(len(c)) if row is None else sum(
            (m * step / ARCSEC) * (row == r) for r, m in zip(rows, multiples))
        return [_on(axis, value, c.trig.cos_el)]

    return make('decode_slip', {'axis': axis, 'rows': list(rows), 'multiples': list(multiples),
                                 'graduation': graduation},
                 f'{AXES[axis]}_decode_slip_{graduation}',
                 f'{AXES[axis]} encoder decoded whole {graduation} beside the true place in '
                 f'{len(rows)} rows', f'multiples of {step / ARCSEC:.4f}"', 'row', axis,
                 ('part',), of, source='paper 001, eq. 12', requires=())


def of_document(row):
    """The effect of a JSON document's entry with ``family`` and ``parameters``."""
    return effect(row['family'], **row['parameters'])
