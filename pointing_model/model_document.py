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

"""The file of a pointing model: a versioned JSON (or YAML) document, exact to the last bit."""

import hashlib
import json
from pathlib import Path

import numpy as np

from msg_tools.units import ARCSEC
from msg_tools.whole_files import write_text

from .fitted_effects import FittedEffect
from .harmonics import Harmonics
from .model import PointingModel
from .mounts import ALTAZ, OF_MOUNT, Mount, mount_wording
from .zero_drift import KEY as FOLLOWS

FORMAT = 'telescope_mount/pointing_model'
VERSION = 2
_PLAIN_VERSION = 1  # without effects: unchanged, so older programs read it
_MOUNT_VERSION = 3  # other mounts than alt-azimuth ones: programs without them refuse it
_SKY_VERSION = 4  # errors that act on the sky: programs that would apply them to the axes refuse it
#: `identity` of no model: nothing is corrected
NO_MODEL = 'none'
_INTERPRETATION = 'reading'  # historical key of `Harmonics.interpretation` in files
_NAMED = 'coefficients'  # A0 .. B12
_JOINT = 'joint_covariance_arcsec2'

_CONVENTION = (
    'offset = encoder - catalogue; azimuth from north through east, elevation from the horizon; '
    'on the sky x = dA cos E, y = dE; terms in TPOINT names (IE has the opposite sign there)'
)
_CONVENTION_OF_AXES = (
    'offset = encoder - catalogue in the angles a, b of the axes ({}); a grows clockwise seen from '
    'the pole of the first axis, b from the equator to the pole and beyond it on the other side of '
    'the pier; on the sky x = da cos b, y = db; frame: the axes x, y, z as east, north, up; terms '
    'in TPOINT names (the index terms and those of the axes have the opposite sign there)'
)
_CONVENTION_ON_SKY = (
    '; errors: sky, the terms act on angles folded back to the sky (beyond the pole a + 180 deg, '
    '180 deg - b), before the side of the pier is worked out; harmonics and effects act on the axes'
)


def coefficient_row(name, value, sigma, undetermined):
    """Document entry of a term or harmonic coefficient; value and sigma in radians."""
    row = {'name': name, 'value_arcsec': value / ARCSEC, 'sigma_arcsec': sigma / ARCSEC}
    return {**row, 'sigma_arcsec': None, 'undetermined': True} if undetermined else row


def to_json(model):
    """A model as a versioned JSON document.

    Parameters
    ----------
    model : PointingModel

    Returns
    -------
    str
        Angles in arcsec. `from_json` restores the same model, exact to the last bit.
    """
    h = model.harmonics
    document = {
        'format': FORMAT,
        'version': VERSION if model.effects else _PLAIN_VERSION,
        'convention': _CONVENTION,
        **_mount_document(model.mount),
        'geometry': model.geometry,
        'terms': [coefficient_row(name, value, float(sigma), name in model.undetermined)
                  for (name, value), sigma in zip(model.terms.items(), model.sigmas)],
        'covariance_arcsec2': (model.covariance / ARCSEC**2).tolist(),
        'harmonics': None if h is None else {
            _INTERPRETATION: h.interpretation,
            'azimuth_arcsec': (h.coef_x / ARCSEC).tolist(),
            'elevation_arcsec': (h.coef_y / ARCSEC).tolist(),
            'covariance_arcsec2': (h.covariance / ARCSEC**2).tolist(),
            # the same for people, by the names of paper 000
            'degree': h.degree,
            _NAMED: [coefficient_row(name, *of, name in model.undetermined_harmonics)
                     for name, of in h.coefficients.items()],
        },
        'provenance': model.provenance,
    }
    if model.directions:
        document['undetermined'] = [dict(one) for one in model.directions]
    if model.sides is not None:
        document['rows_by_side'] = list(model.sides)
    if model.effects:
        document['effects'] = [e.document() for e in model.effects]
    if model.joint is not None:
        # lower triangle: rows of the terms, then of the effects' coefficients
        document[_JOINT] = [row[:i + 1].tolist()
                            for i, row in enumerate(model.joint / ARCSEC**2)]
    return json.dumps(document, indent=1)


def _mount_document(mount):
    """Entries of the document that only mounts other than alt-azimuth ones need."""
    if mount.vertical:
        return {}
    convention = _CONVENTION_OF_AXES.format(', '.join(mount.names.axes))
    return {'version': _SKY_VERSION if mount.on_sky else _MOUNT_VERSION,
            'convention': convention + _CONVENTION_ON_SKY * mount.on_sky,
            'mount': {'kind': mount.kind, 'frame': [list(axis) for axis in mount.frame],
                      **({'errors': mount.errors} if mount.on_sky else {})}}


def from_json(text):
    """Read `to_json`'s document.

    Parameters
    ----------
    text : str

    Returns
    -------
    PointingModel

    Raises
    ------
    ValueError
        Not JSON, not a pointing model, of a later version, or inconsistent.
    """
    try:
        document = json.loads(text)
    except ValueError as error:
        raise ValueError(f'pointing model is not JSON: {error}') from None
    return from_document(document)


def identity(text):
    """Short name of a model; a zero uses it to name the model that it belongs to.

    Parameters
    ----------
    text : str
        Document of `to_json`; '' for no model.

    Returns
    -------
    str
        Twelve hexadecimal digits; ``none`` without any term, harmonic or effect. Provenance does
        not change it, except for how the zero tracks the absolute encoder.
    """
    document = json.loads(text) if text else {}
    acting = {key: document.get(key) for key in ('geometry', 'terms', 'harmonics', 'effects')}
    if 'mount' in document:
        acting['mount'] = document['mount']
    if acting['harmonics']:
        acting['harmonics'] = {key: value for key, value in acting['harmonics'].items()
                               if key not in ('degree', _NAMED)}
    follows = (document.get('provenance') or {}).get(FOLLOWS)
    if follows:
        acting[FOLLOWS] = follows
    if not any(acting[key] for key in ('terms', 'harmonics', 'effects')):
        return NO_MODEL
    return hashlib.sha256(json.dumps(acting, sort_keys=True).encode()).hexdigest()[:12]


def from_document(document):
    """Read the parsed document (see `from_json`)."""
    if not isinstance(document, dict) or document.get('format') != FORMAT:
        raise ValueError(f'not a pointing model: the document has no format {FORMAT!r}')
    if document.get('version') not in (_PLAIN_VERSION, VERSION, _MOUNT_VERSION,
                                       _SKY_VERSION):
        raise ValueError(
            f'pointing model of version {document.get("version")!r}, this program reads '
            f'version {_PLAIN_VERSION} to {_SKY_VERSION}; update the program or fit the run '
            'again')
    try:
        rows = document['terms']
        terms = {row['name']: float(row['value_arcsec']) * ARCSEC for row in rows}
        if len(terms) < len(rows):
            raise ValueError('a term is named twice')
        k = len(terms)
        covariance = np.array(document['covariance_arcsec2'], float).reshape(k, k) * ARCSEC**2
        harmonics = document.get('harmonics')
        if harmonics is not None:
            harmonics_named = harmonics.get(_NAMED, ())  # older files have none
            harmonics = Harmonics(
                harmonics[_INTERPRETATION],
                np.array(harmonics['azimuth_arcsec'], float) * ARCSEC,
                np.array(harmonics['elevation_arcsec'], float) * ARCSEC,
                np.array(harmonics['covariance_arcsec2'], float) * ARCSEC**2,
            )
            _check_named(harmonics_named, harmonics)
        provenance = document.get('provenance') or {}
        if not isinstance(provenance, dict):
            raise ValueError('provenance is not an object')
        geometry = document['geometry']
        entry = document.get('mount')
        mount = ALTAZ if entry is None else Mount(entry['kind'], entry['frame'],
                                                  entry.get('errors', OF_MOUNT))
        effects = [FittedEffect.from_document(row) for row in document.get('effects') or ()]
        joint = _symmetric(document.get(_JOINT))
        undetermined = [row['name'] for row in rows if row.get('undetermined')]
        directions = [{name: float(value) for name, value in one.items()}
                      for one in document.get('undetermined') or ()]
        sides = document.get('rows_by_side')
        sides = None if sides is None else (int(sides[0]), int(sides[1]))
    except KeyError as error:
        raise ValueError(f'pointing model document without {error}') from None
    except (TypeError, ValueError, AttributeError, IndexError) as error:
        raise ValueError(f'pointing model document is damaged: {error}') from None
    return PointingModel(terms, covariance, harmonics, provenance, geometry, effects, mount,
                         undetermined, directions, sides, joint)


def _symmetric(rows):
    """Covariance, radians^2, from the rows of its lower triangle, arcsec^2; None gives None."""
    if rows is None:
        return None
    out = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        out[i, :i + 1] = out[:i + 1, i] = np.array(row, float) * ARCSEC**2
    return out


def _check_named(rows, harmonics):
    """ValueError if the named coefficients disagree with the two series."""
    values = harmonics.coefficients
    for row in rows:
        if float(row['value_arcsec']) * ARCSEC != values.get(row['name'], (None,))[0]:
            raise ValueError(f'{row["name"]} is not what the series of its axis says; change both')


def save(model, path):
    """Write a model to a .json, .yaml or .yml file.

    Parameters
    ----------
    model : PointingModel
    path : str or Path

    Raises
    ------
    ValueError
        Another suffix.
    OSError
        The file cannot be written.
    """
    path = Path(path)
    text = to_json(model) + '\n'
    if _is_yaml(path):
        import yaml

        text = yaml.safe_dump(json.loads(text), sort_keys=False)
    write_text(path, text)


def load(path, mount=None):
    """Read a model that `save` wrote.

    Parameters
    ----------
    path : str or Path
    mount : Mount, optional
        The mount that the model must have.

    Returns
    -------
    PointingModel

    Raises
    ------
    ValueError
        Another suffix, not a pointing model, or another mount; the message names the file.
    OSError
        The file cannot be read.
    """
    path = Path(path)
    is_yaml = _is_yaml(path)
    try:
        text = path.read_text(encoding='utf-8')
        model = from_document(_parsed_yaml(text)) if is_yaml else from_json(text)
        if mount is not None and not mount.agrees(model.mount):
            raise ValueError(f'a model of another mount ({mount_wording(model.mount)}) than this '
                             f'one ({mount_wording(mount)})')
        return model
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None


def _parsed_yaml(text):
    import yaml

    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError(f'pointing model is not YAML: {" ".join(str(error).split())}') from None


def _is_yaml(path):
    suffix = path.suffix.lower()
    if suffix not in ('.json', '.yaml', '.yml'):
        raise ValueError(f'{path}: a model file ends in .json, .yaml or .yml; rename it')
    return suffix != '.json'


#: key of a tracked model's provenance
KEY = 'tracked'


def walks_of(model):
    """Random-walk rate of each term of a tracked model, rad per root hour.

    Parameters
    ----------
    model : PointingModel or None

    Returns
    -------
    ndarray, shape (k,), or None
        None for a model that was not tracked.

    Raises
    ------
    ValueError
        That part of the model is damaged.
    """
    entry = None if model is None else model.provenance.get(KEY)
    if not isinstance(entry, dict):
        return None
    try:
        walks = entry['walk_arcsec_per_root_hour']
        return np.array([float(walks[name]) for name in model.terms]) * ARCSEC
    except (KeyError, TypeError, ValueError):
        raise ValueError(f'drift rates of the model are damaged: {entry!r:.60}') from None
