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

"""Is one model worse than another on the same rows? A paired comparison that knows no model.

Rows that neither a fit nor a choice has seen are the judges. Of each row the squares of its two
residuals are subtracted, so that what both models miss alike (the star, the seeing) cancels.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import sigma_of

from .step_scan import two_sided

#: rows without which nothing is judged
FEWEST = 8
#: a change is held to be worse where a harmless one would look as bad with less than this chance.
#: Of 1000 changes each, 30 judges, white noise: of harmless ones a fifth is refused, which costs
#: nothing; of those that point 5, 8, 15 and 22 % worse 67, 77, 91 and 96 %; of those that would
#: have gained as much 3, 1, 0.1 and 0.1 %. Noise of neighbours alike by 0.8 changes that little
CHANCE = 0.25
#: ... and where it is worse by more than this share of the RMS: less nobody sees
LEAST = 0.01
#: robust sigmas to which residuals are cut, so that no single row decides
_CLIP = 4.0
#: blocks from which their scatter says something
_BLOCKS = 6


@dataclass(frozen=True)
class Comparison:
    """RMS of two models on the same rows, in arcsec.

    `chance` is that of a harmless change to look as bad: 0.5 for one that changes nothing, small
    where the second is worse, near 1 where it is better. It and `ratio`, of the RMS after to that
    before, are of residuals of which the wild ones are cut, so that no single row decides.
    """

    before: float
    after: float
    chance: float
    ratio: float

    def worse(self, chance=CHANCE):
        """Whether the second is worse, beyond that chance and by more than `LEAST`."""
        return self.chance < chance and self.ratio > 1.0 + LEAST

    def to_dict(self):
        """JSON-ready."""
        return {'before_arcsec': self.before, 'after_arcsec': self.after, 'chance': self.chance}


@dataclass(frozen=True)
class PairedComparison:
    """Two models on rows that nothing has seen.

    Attributes
    ----------
    rows : int
    radial, az, el : Comparison
    axes : tuple of str
        Of ``az`` and ``el``, on which the second does something of its own: there it is judged
        by itself too.
    """

    rows: int
    radial: Comparison
    az: Comparison
    el: Comparison
    axes: tuple = ('az', 'el')

    @property
    def worse(self):
        """Names of what the second model makes worse: of ``az``, ``el``, ``radial``."""
        # of two axes one looks as bad twice as often
        found = [axis for axis in self.axes if getattr(self, axis).worse(CHANCE / 2.0)]
        return (*found, *(['radial'] if self.radial.worse() else []))

    @property
    def holds(self):
        """Whether nothing is made worse."""
        return not self.worse

    def to_dict(self):
        """JSON-ready."""
        return {'rows': self.rows, 'worse': list(self.worse),
                **{name: getattr(self, name).to_dict() for name in ('radial', 'az', 'el')}}


def compare_residuals(before, after, axes=('az', 'el')):
    """Compare what two models leave of the same rows.

    Parameters
    ----------
    before, after : array_like, shape (2, n)
        Residuals on the sky, rad, rows in order of time: neighbours may resemble each other, and
        then count as fewer. Rows that are not finite in both are left out.
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
    # the better of the two says what is wild
    limit = _CLIP * np.maximum(sigma_of(both, axis=2).min(axis=0), 1e-12)[:, None]
    cut = np.square(np.clip(both, -limit, limit))
    whole = np.square(both)
    return PairedComparison(n, _compare(whole.sum(axis=1), cut.sum(axis=1)),
                     *(_compare(whole[:, axis], cut[:, axis]) for axis in (0, 1)), tuple(axes))


def _compare(whole, cut):
    """`Comparison` of squares before and after, and of those that are cut; shape (2, n) each."""
    before, after = np.sqrt(whole.mean(axis=1)).tolist()
    small = max(float(cut[0].mean()), 1e-30)
    return Comparison(before, after, _chance(cut[0] - cut[1]),
                      float(np.sqrt(cut[1].mean() / small)))


def _chance(gain):
    """That a mean gain as small or smaller comes of nothing.

    Student's t of the means of blocks: of all lengths that leave enough of them the one with
    the widest error, so that rows that resemble each other count as fewer.
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
