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

"""Names of columns: those that are read, their misspellings, and those that are causes."""

import difflib
import re

from pointing_model.mount_kinds import KINDS, MountKind
from pointing_model.runs.run import COLUMNS, column_name

from . import run_table
from .solve_columns import PARITY, SCALE, SIGMA

#: name in a header -> name in memory
CSV_NAMES = {csv_name: name for name, (csv_name, _, _) in COLUMNS.items()}
CSV_NAMES.update({name: name for name in run_table.SPECIAL if name != 'lst_given'})
#: names of azimuth and elevation in a header -> names in memory
HORIZON_NAMES = {'az_deg': 'az', 'el_deg': 'el'}
#: mounts that are not alt-azimuth: names of the axes, and name in a header -> name in memory
OTHER_NAMES = [(names, {**{name: name for name in run_table.SPECIAL if name != 'lst_given'},
                        **{column_name(name, names): name for name in COLUMNS},
                        'pier_side': 'pier_side'})
               for names in KINDS.values() if not (names.vertical or names.two_sided)]

#: least `difflib` ratio: sigma_az passes as sigma_az_arcsec (without units), az_err_deg does not
_ALIKE = 0.84
_UNIT = re.compile('_(?:deg|arcsec|c|hpa|s|h)$')
_SHORT = 4  # letters: shorter names resemble too many others
_COUNTED = re.compile(r'\d')
#: columns of solved images, besides right ascension and declination
_SOLVE_COLUMNS = (SIGMA, SCALE, PARITY)
#: words in names of columns that are causes: they act on a mount, and no fit or image yields them
_CAUSES = set(re.split(r'\s+', """ambient amb air dome truss tube mirror pier side humidity hum rh
    dew wind gust hpa mbar baro filter colour color magnitude mag exposure load balance cable sun
    moon heater fan voltage supply"""))
_CAUSE_BEGINS = ('temp', 'tamb', 'tair', 'ttube', 'tmirror', 'ttruss', 'tdome', 'press', 'humid',
                 'wind', 'foc', 'rot', 'derot')
#: words in names of columns that are results of a fit or an image, whatever else the name has
_OUTCOMES = set(re.split(r'\s+', """rms error errors err chi chi2 sigma sig std stdev rmse fwhm
    fitted model offset offsets delta asym asymmetry weight quality score correction corr peak
    flux snr dx dy daz del"""))
_OUTCOME_BEGINS = ('resid', 'asym')


def is_cause(name):
    """Whether a column is, by its name, a cause of errors and not the result of a measurement.

    ``Tamb``, ``wind_speed`` and ``foc.dZ`` are; ``src.dFWHM``, ``temp_residual`` and ``column7``
    are not.
    """
    words = [w.lower() for w in re.findall(r'[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+', name)]
    if any(w in _OUTCOMES or w.startswith(_OUTCOME_BEGINS) for w in words):
        return False
    return any(w in _CAUSES or w.startswith(_CAUSE_BEGINS) for w in words)


def near_column(name, header, by_header, names):
    """The known column whose name is most similar, None if none is similar enough.

    Parameters
    ----------
    name : str
        An unknown column, kept as a user's column or ignored.
    header : sequence of str
        All columns of the file. A known column that the file has is no candidate.
    by_header : collection of str
        Names of known columns.
    names : MountKind
        Names of the axes: x or az in `name` mean the first axis, y or el the second.

    Returns
    -------
    str or None
    """
    known = [one for one in (*by_header, *(_SOLVE_COLUMNS if 'ra_deg' in header else ()))
             if one not in header]
    if len(name) < _SHORT or name in _SOLVE_COLUMNS and 'ra_deg' in header or _COUNTED.search(name):
        return None
    wanted = _in_axes(name.lower(), names)
    alike = {one: max(difflib.SequenceMatcher(None, form(wanted), form(one)).ratio()
                      for form in (str, _without_unit, _in_order)) for one in known}
    best = max(alike, key=alike.get, default=None)
    return best if best is not None and alike[best] >= _ALIKE else None


def _without_unit(name):
    return _UNIT.sub('', name)


def _in_order(name):
    return '_'.join(sorted(name.split('_')))


def _in_axes(name, names: MountKind):
    """A name with its axes (x, az, el ...) replaced by those of the mount."""
    first, second = names.columns
    own = {'x': first, 'y': second, 'az': first, 'el': second, 'alt': second, 'ra': first}
    parts = name.split('_')
    return name if len(parts) < 2 else '_'.join(own.get(part, part) for part in parts)
