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

"""Messages of a calibration, both ways: the active pair of model and zero, a zero, causes.

A model and its zero are one JSON text on ``in_force``: ``zero`` alone is only half of the
pointing. A model or a zero is refused here if its size is impossible for any mount; these limits
do not say what a good one looks like. The zero of an incremental encoder may be any angle of a
turn, and so may the index terms, which are equivalent to it.

A zero alone is a JointState on ``zero``. Its power-on and model are on ``zero/identity``
(`zero_identity`). Older logs have them in the zero message: `msg_tools.older_frames`.
"""

import json
from dataclasses import dataclass

import numpy as np

from msg_tools.convert import (
    AXES,
    MOUNT_FRAME,
    joint_state,
    read_joints,
    values_message,
    values_of,
)
from msg_tools.older_frames import zero_in
from msg_tools.units import ARCSEC, DEG

from .model import PointingModel
from .model_document import NO_MODEL, identity
from .zero import BY_POLARIS, BY_STARS, PowerOnZero

FORMAT = 'telescope_mount/in_force'
VERSION = 1


def pair_to_text(model_text, stamp, zero):
    """The JSON document of the active pair.

    Parameters
    ----------
    model_text : str
        Document of `PointingModel.to_json`; '' for none.
    stamp : int
        Stamp of the newest observation used for the zero, ns.
    zero : PowerOnZero

    Returns
    -------
    str
        JSON: ``model`` (the document of a pointing model, or null) and ``zero`` with
        ``stamp_ns``, ``run``, ``encoder_start`` (UTC s), ``model`` (its name), ``az_rad``,
        ``el_rad``, ``sigma_rad`` (null if unknown), and ``by`` unless it is from Polaris.
    """
    known = bool(np.isfinite(zero.sigma).all())
    return json.dumps({
        'format': FORMAT, 'version': VERSION,
        'model': json.loads(model_text) if model_text else None,
        'zero': {'stamp_ns': stamp, 'run': None if zero.run is None else int(zero.run),
                 'encoder_start': zero.started, 'model': zero.model, 'az_rad': float(zero.az),
                 'el_rad': float(zero.el),
                 'sigma_rad': zero.sigma.tolist() if known else None,
                 **({} if zero.by in (None, BY_POLARIS) else {'by': zero.by})}})


def text_to_pair(text):
    """The inverse of `pair_to_text`.

    Returns
    -------
    model_text : str
        '' for none.
    stamp : int
    zero : PowerOnZero

    Raises
    ------
    ValueError
        Not such a document, the zero is of another model, or a size impossible for any mount.
    """
    try:
        document = json.loads(text)
        if document['format'] != FORMAT or document['version'] != VERSION:
            raise ValueError(f'not {FORMAT} of version {VERSION}')
        model, entry = document['model'], document['zero']
        sigma = entry['sigma_rad']
        zero = PowerOnZero(
            float(entry['az_rad']), float(entry['el_rad']),
            None if sigma is None else np.diag(np.square(np.array(sigma, float))),
            entry['run'], entry['encoder_start'], entry['model'], entry.get('by'))
        stamp = int(entry['stamp_ns'])
        model_text = json.dumps(model, indent=1) if model else ''
        if model_text:
            check_model(PointingModel.from_json(model_text))
        check_zero(zero)
    except (KeyError, TypeError, AttributeError, OverflowError) as error:
        raise ValueError(f'not an active pair: {error}') from None
    if (zero.model or NO_MODEL) != identity(model_text):
        raise ValueError(f'a zero of model {zero.model} beside model {identity(model_text)}')
    return model_text, stamp, zero


#: index terms of the axes, equivalent to zeros
_INDEX = ('IA', 'IE', 'IH', 'ID')
#: a turn; a right angle: a term beyond it would swap axis, tube or camera with another; rad
_TURN, _RIGHT = 360.0 * DEG, 90.0 * DEG
#: relative excess of a covariance over its variances that rounding may cause
_ROUNDING = 1e-3


def check_model(model):
    """Refuse a model that is impossible for any mount.

    Parameters
    ----------
    model : PointingModel

    Raises
    ------
    ValueError
        A term beyond a right angle (index terms and coefficients of harmonics or effects: beyond
        a turn), an invalid covariance, or a sigma beyond a turn. The message is one line with
        its name.
    """
    for name, value in model.terms.items():
        most = _TURN if name in _INDEX else _RIGHT
        if not abs(value) <= most:
            raise ValueError(f'a model with {name} = {value / ARCSEC:.4g} arcsec, which no mount '
                             f'has (at most {most / DEG:.0f} deg)')
    _check_covariance('a model', model.covariance, list(model.terms))
    series = model.harmonics
    if series is not None:
        _check_largest('harmonics', np.concatenate([np.ravel(series.coef_x),
                                                    np.ravel(series.coef_y)]))
        if not np.isfinite(series.covariance).all():
            raise ValueError('a model with harmonics whose covariance is not finite')
    for fitted in model.effects:
        _check_largest(fitted.effect.name, np.ravel(fitted.coefficients))


def check_zero(zero):
    """Refuse a zero that is impossible for any encoder.

    Parameters
    ----------
    zero : PowerOnZero

    Raises
    ------
    ValueError
        An angle or a sigma beyond a turn, or not a number. One line that says which.
    """
    for axis, value in zip(('first', 'second'), zero.angles):
        if not abs(value) <= _TURN:
            raise ValueError(f'a zero of {value:.4g} rad on the {axis} axis: no angle of an axis '
                             '(at most one turn)')
    if zero.covariance is not None:
        _check_covariance('a zero', np.asarray(zero.covariance), ['the first axis',
                                                                  'the second axis'])


def _check_largest(what, values):
    if not (np.abs(values) <= _TURN).all():
        raise ValueError(f'a model with {what} of up to {np.abs(values).max() / ARCSEC:.4g} '
                         'arcsec, which no mount has')


def _check_covariance(what, covariance, names):
    if len(covariance) == 0:
        return
    variance = np.diag(covariance)
    bad = np.flatnonzero(~(np.abs(variance) <= _TURN**2))
    if len(bad):
        sigma = np.sqrt(np.abs(variance[bad[0]])) / ARCSEC
        raise ValueError(f'{what} with a sigma of {sigma:.4g} arcsec of {names[bad[0]]}: more '
                         'than a turn')
    slack = _ROUNDING * variance.max()
    most = np.sqrt(np.outer(np.maximum(variance, 0.0), np.maximum(variance, 0.0)))
    if variance.min() < -slack or not (np.abs(covariance) <= most + slack).all():
        raise ValueError(f'{what} with a covariance that is none: it is larger than its own '
                         'variances allow')


IDENTITY_VERSION = 1


def zero_to_joints(zero, ns, names=AXES):
    """A JointState: ``position`` is the zero, ``effort`` its sigma (rad).

    Parameters
    ----------
    zero : PowerOnZero
    ns : int
        Stamp of the newest observation used.
    names : sequence of str
        Names of the axes (`msg_tools.convert.JOINTS`).
    """
    return joint_state(ns, zero.angles, effort=zero.sigma, names=names)


def zero_identity(zero, ns):
    """A DiagnosticArray that names the zero, its power-on and its model.

    Parameters
    ----------
    zero : PowerOnZero
    ns : int
        Stamp of its JointState.
    """
    first, second = (repr(float(angle)) for angle in zero.angles)
    values = {'version': IDENTITY_VERSION, 'stamp_ns': ns, 'first_rad': first,
              'second_rad': second}
    if zero.run is not None:
        values |= {name: value for name, value in (
            ('power_on', int(zero.run)), ('model', zero.model),
            ('started_s', None if zero.started is None else f'{zero.started:.3f}'),
            ('by', None if zero.by in (None, BY_POLARIS) else BY_STARS)) if value is not None}
    return values_message(ns, {'zero': values})


class ZeroPairs:
    """Matches zeros with their identities, in whatever order they arrive."""

    def __init__(self):
        self._zero = self._identity = self._given = None

    def take(self, message, run=None):
        """Take a message of ``zero`` or ``zero/identity``.

        Returns
        -------
        ns : int
            Stamp.
        zero : PowerOnZero
            None instead of both while the other half is missing.

        Raises
        ------
        ValueError
            See `joints_to_zero`; or the identity is invalid.
        """
        if hasattr(message, 'status'):
            self._identity = values_of(message, 'zero', IDENTITY_VERSION)
        else:
            ns, zero = joints_to_zero(message, run)
            if message.header.frame_id != MOUNT_FRAME:
                return ns, zero  # an older one
            self._zero, self._given = (ns, zero), None
        if self._zero is None or not self._identity or self._given == self._identity:
            return None
        (ns, zero), identity = self._zero, self._identity
        try:
            of = (int(identity['stamp_ns']), float(identity['first_rad']),
                  float(identity['second_rad']))
            if of != (ns, *zero.angles):
                return None  # of another zero
            self._given = identity
            run, started = identity.get('power_on'), identity.get('started_s')
            return ns, PowerOnZero(
                *zero.angles, zero.covariance, None if run is None else int(run),
                None if started is None else float(started), identity.get('model'),
                identity.get('by'))
        except (KeyError, ValueError, OverflowError) as error:
            raise ValueError(f'no identity of a zero: {error}') from None


def joints_to_zero(message, run=None):
    """The inverse of `zero_to_joints`; only older messages have the identity, too.

    Parameters
    ----------
    message : sensor_msgs.msg.JointState
    run : int or float, optional
        Run number if the message has none: that of the last observation before it.

    Returns
    -------
    ns : int
        Stamp.
    zero : PowerOnZero
        Without a covariance if the message gives no sigma; without ``started`` and ``model`` if
        it has none.

    Raises
    ------
    ValueError
        An axis is missing or not a number.
    """
    ns, angles, _, sigma = read_joints(message)
    if not np.isfinite(angles).all():
        raise ValueError('zero is not a number')
    with np.errstate(over='ignore'):  # the user checks the size
        covariance = np.diag(np.square(sigma)) if np.isfinite(sigma).all() else None
    return ns, PowerOnZero(*angles, covariance, *(zero_in(message.header.frame_id) or (run,)))


CAUSES_FORMAT = 'telescope_mount/apart'
CAUSES_VERSION = 1
#: states: a star is requested; each set has one cause; a set cannot be resolved
ASKS, ONE_CAUSE, CANNOT = 'asks', 'one cause', 'cannot be distinguished from here'


@dataclass(frozen=True)
class StarRequest:
    """State of the search for causes, and the star to observe next.

    Attributes
    ----------
    stamp : int
        Stamp of the newest row that was used, ns.
    state, sentence : str
    request : dict or None
        See `calibration.analysis.diagnosis.discrimination.Judgement`.
    """

    stamp: int
    state: str
    sentence: str
    request: dict | None

    @classmethod
    def read(cls, text):
        """Read the document of the topic ``apart``.

        Raises
        ------
        ValueError
            Not such a document, or damaged.
        """
        try:
            found = json.loads(text)
            if found['format'] != CAUSES_FORMAT or found['version'] != CAUSES_VERSION:
                raise ValueError(f'{found["format"]!r} {found["version"]!r}')
            request = found['request']
            for name in ('az_deg', 'el_deg') if request else ():
                float(request[name])
            return cls(
                int(found['last_stamp_ns']), str(found['state']), str(found['says']), request)
        except (ValueError, KeyError, TypeError) as err:
            raise ValueError(f'no document of causes to distinguish: {err}') from None
