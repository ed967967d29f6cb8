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

"""Is one model worse than another on the same rows? A paired comparison of any two models.

The rows must be held out from both the fit and the selection. The squared residuals of the two
models are subtracted row by row, so that errors common to both (the star, the seeing) cancel.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import sigma_of

from .step_scan import two_sided

#: fewest rows for a comparison
FEWEST = 8
#: significance level: a change is worse if a harmless one would look as bad with a lower p. In 1000
#: simulated changes each (30 rows, white noise) it refuses a fifth of the harmless ones, which
#: costs nothing; 67, 77, 91 and 96 % of those that point 5, 8, 15 and 22 % worse; and 3, 1, 0.1 and
#: 0.1 % of those that point as much better. Neighbours correlated by 0.8 change that little
CHANCE = 0.25
#: ... and if it is worse by more than this part of the RMS: less is invisible
LEAST = 0.01
#: robust sigmas at which residuals are clipped, so that no single row decides
_CLIP = 4.0
#: fewest blocks whose scatter is meaningful
_BLOCKS = 6


@dataclass(frozen=True)
class Comparison:
    """RMS of two models on the same rows, in arcsec.

    `chance` is the one-sided p that a harmless change looks as bad: 0.5 for one that changes
    nothing, small if the second model is worse, near 1 if it is better. It and `ratio`, RMS after
    over RMS before, are of clipped residuals, so that no single row decides.
    """

    before: float
    after: float
    chance: float
    ratio: float

    def worse(self, chance=CHANCE):
        """Whether the second is worse, at significance level `chance` and by more than `LEAST`."""
        return self.chance < chance and self.ratio > 1.0 + LEAST

    def to_dict(self):
        """JSON-ready."""
        return {'before_arcsec': self.before, 'after_arcsec': self.after, 'chance': self.chance}


@dataclass(frozen=True)
class PairedComparison:
    """Comparison of two models on held-out rows.

    Attributes
    ----------
    rows : int
    radial, az, el : Comparison
    axes : tuple of str
        Those of ``az`` and ``el`` where the second model differs: they are also tested by
        themselves.
    """

    rows: int
    radial: Comparison
    az: Comparison
    el: Comparison
    axes: tuple = ('az', 'el')

    @property
    def worse(self):
        """Where the second model is worse: some of ``az``, ``el``, ``radial``."""
        # two axes give twice as many false alarms
        found = [axis for axis in self.axes if getattr(self, axis).worse(CHANCE / 2.0)]
        return (*found, *(['radial'] if self.radial.worse() else []))

    @property
    def holds(self):
        """Whether the second model is nowhere worse."""
        return not self.worse

    def to_dict(self):
        """JSON-ready."""
        return {'rows': self.rows, 'worse': list(self.worse),
                **{name: getattr(self, name).to_dict() for name in ('radial', 'az', 'el')}}


def compare_residuals(before, after, axes=('az', 'el')):
    """Compare the residuals of two models on the same rows.

    Parameters
    ----------
    before, after : array_like, shape (2, n)
        Residuals on the sky, rad, rows in order of time: correlated neighbours count as fewer
        rows. Rows that are not finite in both are ignored.
    axes : sequence of str
        See `PairedComparison`.

    Returns
    -------
    PairedComparison

    Raises
    ------
    ValueError
        Fewer than `FEWEST` rows.
    """
    both = np.array([before, after], dtype=float) / ARCSEC
    both = both[:, :, np.isfinite(both).all(axis=(0, 1))]
    n = both.shape[2]
    if n < FEWEST:
        raise ValueError(f'{n} rows to judge by; observe at least {FEWEST} with the step check')
    # the clipping limit is from the model with the smaller scatter
    limit = _CLIP * np.maximum(sigma_of(both, axis=2).min(axis=0), 1e-12)[:, None]
    cut = np.square(np.clip(both, -limit, limit))
    whole = np.square(both)
    return PairedComparison(n, _compare(whole.sum(axis=1), cut.sum(axis=1)),
                     *(_compare(whole[:, axis], cut[:, axis]) for axis in (0, 1)), tuple(axes))


def _compare(whole, cut):
    """`Comparison` of squared residuals before and after, whole and clipped; shape (2, n) each."""
    before, after = np.sqrt(whole.mean(axis=1)).tolist()
    small = max(float(cut[0].mean()), 1e-30)
    return Comparison(before, after, _chance(cut[0] - cut[1]),
                      float(np.sqrt(cut[1].mean() / small)))


def _chance(gain):
    """One-sided p of a mean gain as small or smaller, if there is no difference.

    Student's t of block means, with the block length that gives the largest standard error, so
    that correlated rows count as fewer.
    """
    mean, n = gain.mean(), len(gain)
    widest, freedom, length = 0.0, n - 1, 1
    while n // length >= min(_BLOCKS, n):
        blocks = np.array([part.mean() for part in np.array_split(gain, n // length)])
        error = blocks.std(ddof=1) / np.sqrt(len(blocks))
        if error > widest:
            widest, freedom = error, len(blocks) - 1
        length += 1
    if widest == 0.0:
        return 0.5 if mean == 0.0 else float(mean > 0.0)
    below = 0.5 * float(two_sided(mean / widest, freedom))
    return below if mean < 0.0 else 1.0 - below
