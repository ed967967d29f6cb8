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

"""Terms held fixed while a zero is set, with their covariance as columns of unit variance."""

import numpy as np

from msg_tools.units import ARCSEC

from . import harmonics
from .mounts import ALTAZ
from .pointing_terms import design

#: prior 1 sigma of a term without a model: the mount is only known to be set up with care (five
#: minutes of arc)
BROAD = 300.0 * ARCSEC


def is_a_model(model):
    """Whether a PointingModel (or None) has any offsets."""
    return model is not None and bool(model.terms or model.harmonics is not None)


class Held:
    """The terms held fixed while the zeros of the axes are determined, and their covariance.

    Parameters
    ----------
    model : PointingModel, optional
        Its terms and harmonics, with their covariance. Without one (or if it is empty): the
        physical terms of the mount except its zeros, each zero within `BROAD`.
    mount : Mount, optional
        Used if no model gives it.

    Attributes
    ----------
    names : tuple of str
        Names of the terms.
    root : ndarray, shape (k, j)
        Root of their covariance C = root root', radians.
    mount : Mount
    """

    def __init__(self, model=None, mount=ALTAZ):
        self.mount = model.mount if is_a_model(model) else mount
        self._series = None
        if is_a_model(model):
            self.names = tuple(model.terms)
            self.root = _root(model.covariance)
            self._series = model.harmonics
        else:
            self.names = tuple(name for name in self.mount.names.physical
                               if name not in self.mount.names.index)
            self.root = BROAD * np.eye(len(self.names))
        if self._series is not None:
            self._series_root = _root(self._series.covariance_of_coefficients)

    @classmethod
    def certain(cls, mount=ALTAZ):
        """Nothing uncertain is held: only the noise of the exposures counts."""
        out = cls(None, mount)
        out.names, out.root = (), np.zeros((0, 0))
        return out

    def columns(self, az, el):
        """On-sky effect of a one-sigma error along each direction of the covariance.

        Parameters
        ----------
        az, el : ndarray, shape (n,)
            Catalogue place by the axes of the mount, radians.

        Returns
        -------
        ndarray, shape (2, n, j)
            x and y, radians.
        """
        parts = [np.stack(design(self.names, az, el, self.mount)) @ self.root
                 if self.names else np.zeros((2, len(az), 0))]
        if self._series is not None:
            own = harmonics.columns_of(self._series.degree, az, el, self._series.interpretation)
            own = own.reshape(len(own), 2, len(az))
            parts.append(np.einsum('kcn,kj->cnj', own, self._series_root))
        return np.concatenate(parts, axis=2)


def zero_columns(az, el, mount=ALTAZ):
    """On-sky effect of the zeros of both axes, shape (2, n, 2), for unit coefficients."""
    return np.stack(design(mount.names.index, az, el, mount))


def _root(covariance):
    """Square root of a possibly singular covariance, without the directions known exactly."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    keep = values > 1e-12 * max(values.max(initial=0.0), 0.0)
    return vectors[:, keep] * np.sqrt(values[keep])
