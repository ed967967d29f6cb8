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

"""Words for a term with an implausible sign or size: in full, and as a caution."""

#: BIC difference from which the data prefer one to the other
_CLEAR = 6.0
_DESK = ('Check first, at the desk: is refraction in both the star places and the readings, once, '
         'or in neither')
_OTHERS = 'a mirror that tilts in its cell, {}or mount and catalogue exchanged in the file'
#: for an alt-azimuth mount: its cosine is the curve of TF
_DISC = 'an elevation encoder whose disc is off centre, '


def implausible_term(row):
    """An entry of `implausible_terms` (of a document: ``unphysical``) in words."""
    name, value = row['name'], _signed(row['value_arcsec'])
    figure = f'{value} ± {row["sigma_arcsec"]:.1f}″'
    if row.get('alone_arcsec') is not None:
        figure += f'; {_signed(row["alone_arcsec"])}″ before the effects were added'
    if row.get('beside_effects_arcsec') is not None:
        figure += (f' before the effects were added; {_signed(row["beside_effects_arcsec"])}″ '
                   'with them, because they have the same curve')
    if row['what'] == 'sign' and row.get('sound_with'):
        return _with_others(row, figure)
    if row['what'] == 'sign':
        return (f'{name}, tube flexure, is negative ({figure}). Weight cannot lift a tube. '
                f'{_of_air(row.get("refraction"), bool(row.get("altaz")))}')
    if name == 'TX':
        return (f'{name}, error of the refraction, is {figure} of cot E; the whole refraction is '
                '40 to 60″. Most likely it was ' + ('left out of the star places' if
                   row['value_arcsec'] > 0 else 'applied twice to the star places') + f'. {_DESK}?')
    return (f'{name} is {figure}, more than a degree: too large for a mount. Check first, at the '
            'desk, what the columns of the file mean, and where their zeros are.')


def implausible_caution(row):
    """The same in one short sentence, for the cautions above a diagnosis."""
    return (f'{row["name"]} is {_signed(row["value_arcsec"])} ± {row["sigma_arcsec"]:.1f}″, '
            f'{"of the wrong sign" if row["what"] == "sign" else "too large"} for a mount: check '
            'refraction, columns and signs.')


def _with_others(row, figure):
    """For a tube flexure that is negative with the best cause, but not with others."""
    values = '; '.join(f'{_signed(one["value_arcsec"])} ± {one["sigma_arcsec"]:.1f}″ with '
                       f'{one["cause"]}' for one in row['sound_with'])
    return (f'{row["name"]}, tube flexure, is negative with the cause that fits best ({figure}). '
            f'With others that fit as well it is not ({values}). Weight cannot lift a tube, which '
            f'favours these; or check the refraction. {_DESK}?')


def _of_air(fitted, altaz):
    """Whether a refraction error explains a negative TF, and other reasons for it."""
    others = _OTHERS.format(_DISC * altaz)
    if fitted is None:
        return ('Usual reason: refraction was applied twice or too much to the star places (TX or '
                f'TX3 then fits better). Others: {others}. {_DESK}?')
    gain = fitted['delta_bic']
    size = f'{_signed(fitted["value_arcsec"])}″ of cot E; the whole refraction is 40 to 60″'
    if gain >= _CLEAR:
        return ('Most likely refraction was applied twice or too much to the star places: in place '
                f'of TF it fits these rows better ({size}). {_DESK}?')
    if gain > -_CLEAR:
        return (f'Refraction applied twice or too much explains it as well ({size}). So does '
                f'{others}. {_DESK}? That is the cheapest check.')
    return (f'Refraction applied twice or too much explains only a part: in place of TF it fits '
            f'worse ({size}). With it TF is {_signed(fitted["beside_arcsec"])}″. Other reasons: '
            f'{others}. {_DESK}, and which column is the mount? Then check the '
            f'{"disc and the " * altaz}mirror cell.')


def _signed(value):
    return f'{value:+.1f}'.replace('-', '−')
