"""What a person should know of a fit: of the values of its terms, of what its rows leave open."""

import numpy as np

from msg_tools.units import ARCSEC, DEG

#: in the place of a standard error
UNDETERMINED = 'undetermined'
#: standard errors from where a value is no zero
_SURE = 3.0
#: BIC, from where the rows prefer one to the other
_CLEAR = 6.0
#: arcsec of cot E: a refraction of 58" at sea level that is wrong by a third. Pressure and
#: temperature make a tenth of it
_WRONG_AIR = 20.0
#: arcsec: axes and tubes are built square, and stiff, to minutes of arc
_SQUARE = DEG / ARCSEC
_OF_SHAPE = ('TF', 'CA', 'NPAE', 'CH', 'NP', 'C1', 'N12')


def suspicious(terms):
    """Terms with a sign or a size that no mount should have.

    Parameters
    ----------
    terms : iterable of dict
        ``name``, ``value_arcsec``, ``sigma_arcsec``.

    Returns
    -------
    list of dict
        Of each the same, and ``what``: ``sign``, or ``size``.
    """
    out = []
    for row in terms:
        name, value, sigma = row['name'], row['value_arcsec'], row.get('sigma_arcsec')
        if not sigma:
            continue
        what = ''
        if name == 'TF' and value < -_SURE * sigma:
            what = 'sign'
        elif abs(value) > _SURE * sigma + {
                'TX': _WRONG_AIR, **dict.fromkeys(_OF_SHAPE, _SQUARE)}.get(name, np.inf):
            what = 'size'
        if what:
            out.append({'name': name, 'value_arcsec': float(value), 'sigma_arcsec': float(sigma),
                        'what': what})
    return out


def notes_of_terms(terms):
    """Notes on values that no mount should have.

    Parameters
    ----------
    terms : iterable of dict
        ``name``, ``value_arcsec``, ``sigma_arcsec``.

    Returns
    -------
    list of str
    """
    return [said_of_term(row) for row in suspicious(terms)]


def said_of_term(row):
    """An entry of `suspicious` (or of a diagnosis' ``unphysical``) in words."""
    name, value = row['name'], _signed(row['value_arcsec'])
    figure = f'{value} ± {row["sigma_arcsec"]:.1f}″'
    if row.get('alone_arcsec') is not None:
        figure += f'; {_signed(row["alone_arcsec"])}″ before the effects were added'
    if row.get('beside_effects_arcsec') is not None:
        figure += (f' before the effects were added; {_signed(row["beside_effects_arcsec"])}″ '
                   'beside them, which take up the same curve')
    if row['what'] == 'sign' and row.get('sound_with'):
        return _with_others(row, figure)
    if row['what'] == 'sign':
        return (f'{name}, the bending of the tube, is negative ({figure}), and weight bends no '
                f'tube upward. {_of_air(row.get("refraction"), bool(row.get("altaz")))}')
    if name == 'TX':
        return (f'{name}, what is wrong with the refraction, is {figure} of cot E, where the whole '
                'refraction has 40 to 60″: most likely it was '
                + ('left out of the star places' if row['value_arcsec'] > 0
                   else 'put into the star places twice') + f'. {_DESK}?')
    return (f'{name} is {figure}, more than a degree: mounts are not built so. Check first, at the '
            'desk, what the columns of the file mean, and where their zeros are.')


def _with_others(row, figure):
    """Of a bending of the tube that is negative with the cause that fits best, not with others."""
    told = '; '.join(f'{_signed(one["value_arcsec"])} ± {one["sigma_arcsec"]:.1f}″ with '
                     f'{one["cause"]}' for one in row['sound_with'])
    return (f'{row["name"]}, the bending of the tube, is negative with the cause that fits best '
            f'({figure}), and not with others that fit as well ({told}). Weight bends no tube '
            'upward, which speaks for these; or look at the refraction: '
            + _DESK[0].lower() + _DESK[1:] + '?')


_DESK = ('Check first, at the desk: have star places and readings both the refraction, once, or '
         'both not')
_OTHERS = ('a mirror that tilts in its cell, {}or mount and catalogue exchanged in the file, which '
           'turns every sign')
#: of an alt-azimuth mount: its cosine is the same curve
_DISC = 'an elevation encoder whose disc is off centre, '


def _of_air(fitted, altaz):
    """What a refraction that is wrong would do in place of a negative TF, and what else does it."""
    others = _OTHERS.format(_DISC * altaz)
    if fitted is None:
        return ('Usual reasons: the refraction is in the star places twice or too much (TX or TX3 '
                f'fits better then), {others}. {_DESK}?')
    gain = fitted['delta_bic']
    size = f'{_signed(fitted["value_arcsec"])}″ of cot E; the whole refraction has 40 to 60″'
    if gain >= _CLEAR:
        return ('Most likely the refraction is in the star places twice or too much: in the place '
                f'of TF it fits these rows better ({size}). {_DESK}?')
    if gain > -_CLEAR:
        return ('Refraction that is in the star places twice or too much explains it as well '
                f'({size}); so does {others}. {_DESK}? That is the cheapest check.')
    return ('Refraction that is in the star places twice or too much bears on the same curve, but '
            f'is not the whole of it: in the place of TF it fits these rows worse ({size}), and '
            f'beside it TF is {_signed(fitted["beside_arcsec"])}″. What does this too: {others}. '
            f'{_DESK}, and which column is the mount? Then look at the {"disc and the " * altaz}'
            'mirror cell.')


def _signed(value):
    return f'{value:+.1f}'.replace('-', '−')


def undetermined_lines(result):
    """What people must know of terms that the stars do not determine; nothing of other fits.

    Parameters
    ----------
    result : FitResult

    Returns
    -------
    list of str
    """
    return undetermined_notes(result.undetermined, dict(zip(result.names, result.coefficients)))


def undetermined_notes(names, values):
    """The same of the names of the undetermined and the values of all."""
    if not names:
        return []
    held = [name for name in names if values[name] == 0.0]
    carry = [name for name in names if values[name] != 0.0]
    text = f'undetermined by these stars: {", ".join(names)}'
    if held and carry:
        text += (f'. {", ".join(held)} {_are(held)} held at zero, and {", ".join(carry)} '
                 f'{"stands" if len(carry) == 1 else "stand"} for the sum of all of them here')
    elif held:
        text += '; held at zero'
    return [text + '. The model holds near these stars alone: observe other parts of the sky']


def _are(names):
    return 'is' if len(names) == 1 else 'are'


def raised_lines(result, run=None):
    """What people must know of sigmas that were not taken as they are given.

    Parameters
    ----------
    result : FitResult
    run : PointingRun, optional
        With the lines of its file.
    """
    return [f'{_place(run, one["row"])}: sigma {one["axis"]} {one["given"] / ARCSEC:.3g}″ is far '
            f'below the others\'; taken as {one["taken"] / ARCSEC:.3g}″, a fifth of their median'
            for one in result.raised]


def _place(run, row):
    if run is None or run.meta.get('lines') is None:
        return f'row {row}'
    return f'line {run.lines[row]}'


def few_lines(result):
    """What people must know of a fit of few rows, in words; nothing of others.

    Parameters
    ----------
    result : FitResult

    Returns
    -------
    list of str
    """
    if not result.few:
        return []
    dof = result.degrees_of_freedom
    out = [f'{dof} degree{"s" * (dof != 1)} of freedom: 95 of 100 terms are within the 95 % told '
           "(Student's t), fewer within two sigmas"]
    if not result.robust:
        out.append('no row was judged by the others: a wrong one may be among them; observe more')
    return out
