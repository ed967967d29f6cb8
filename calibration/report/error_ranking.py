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

"""The largest errors of a mount, ranked, in the same columns on each page."""

from dataclasses import dataclass, field

import numpy as np

from pointing_model.effects.base import arcsec
from pointing_model.pointing_terms import stacked_design, term_cause, terms_of

from . import page_parts as page
from .number_wording import value_and_error

#: number of errors not folded away; smallest significance of a listed term, standard errors
MOST_ERRORS, _CLEAR = 3, 3.0


@dataclass
class ErrorLine:
    """One error, for the ranked table.

    Attributes
    ----------
    name : str
    reach_arcsec, removes_arcsec : float or None
        Peak to peak, and RMS removed, on the sky.
    causes : list of str
        Quickest to check first.
    check : str
        What to check.
    stability : str
        In how many resamples it was found; '' if unknown.
    """

    name: str
    reach_arcsec: float | None
    removes_arcsec: float | None
    causes: list = field(default_factory=list)
    check: str = ''
    stability: str = ''

    @property
    def size(self):
        """Both sizes in words."""
        return ', '.join(f'{arcsec(value)} {word}' for value, word in (
            (self.reach_arcsec, 'peak to peak'), (self.removes_arcsec, 'RMS')) if value)

    def named_causes(self, most):
        """At most `most` causes in words; the others are counted."""
        named, more = self.causes[:most], len(self.causes) - most
        return '; '.join(named) + (f'; or {more} more' if more > 0 else '')


def error_table(lines, first=0):
    """The ranked table of `ErrorLine`s, starting at index `first`."""
    rows = list(enumerate(lines, 1))[first:]
    sizes = [(head, name) for head, name in (
        ('peak to peak', 'reach_arcsec'), ('RMS removed', 'removes_arcsec'))
        if any(getattr(one, name) is not None for one in lines)]
    return page.table(
        ('', 'error', *(head for head, _ in sizes), 'likely causes', 'check first'),
        [(str(i), one.name, *(_size(getattr(one, name)) for _, name in sizes),
          one.named_causes(1 + (i == 1 and len(lines) < MOST_ERRORS)), one.check or None)
         for i, one in rows],
        'folding stack')


def errors_section(lines, more=None, title='Largest errors', note=''):
    """The section of the largest errors: the first ones, the others folded, then `more`."""
    return page.section(title, [
        error_table(lines[:MOST_ERRORS]),
        page.folded(f'And {len(lines) - MOST_ERRORS} smaller', error_table(lines, MOST_ERRORS)),
        more], note)


def term_lines(terms, run):
    """The terms of a fit as errors on the sky of a run, largest first.

    Parameters
    ----------
    terms : list of dict
        ``name``, ``value_arcsec``, ``sigma_arcsec``; terms below 3 sigma are omitted.
    run : PointingRun

    Returns
    -------
    list of ErrorLine
    """
    known, mount, out = terms_of(run.mount), run.mount, []
    for row in terms or ():
        value, sigma = row['value_arcsec'], row.get('sigma_arcsec')
        if row['name'] not in known or sigma is None or abs(value) < _CLEAR * sigma:
            continue
        columns = stacked_design([row['name']], run['az'], run['el'], mount)
        size = abs(value) * float(np.sqrt(2.0 * np.mean(columns**2)))
        shown, error = value_and_error(value, sigma)
        cause, check = term_cause(row['name'], mount)
        name = f'{known[row["name"]].doc.partition(",")[0]}, {row["name"]} {shown} ± {error}″'
        out.append(ErrorLine(name[0].upper() + name[1:], None, size, [cause], check))
    return sorted(out, key=lambda one: -one.removes_arcsec)


def _size(value):
    return None if value is None else page.size(value)
