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

"""How coefficients go on from row to row: constant, random walk, exponential memory, jump.

A dynamics answers one question: what does a stretch of time do to the coefficients that have it
(`over`)? They are multiplied by a matrix, and a covariance is added to what is known of them. So a
new one is a class with that one method, and needs no change of the solver (`kalman`).
"""

from typing import NamedTuple

import numpy as np


class Transition(NamedTuple):
    """What a stretch of time does to s coefficients."""

    matrix: np.ndarray | None  # (s, s), by which they go on; None: they stay
    added: np.ndarray  # (..., s, s), to their covariance; for several hypotheses at once


class Constant:
    """Coefficients that stay."""

    def over(self, begin, end):
        """`Transition` from one time to a later one."""
        return Transition(None, np.zeros((1, 1)))


class RandomWalk(NamedTuple):
    """Coefficients that wander."""

    rate: np.ndarray  # (..., s, s), covariance added in a unit of time

    def over(self, begin, end):
        """`Transition` from one time to a later one."""
        return Transition(None, np.asarray(self.rate) * (end - begin))


class ExponentialMemory(NamedTuple):
    """Coefficients that wander and go back to zero meanwhile (Ornstein and Uhlenbeck)."""

    rate: np.ndarray  # (..., s, s), covariance added in a unit of time
    memory: np.ndarray  # (s,), time in which a coefficient goes back by a factor e; inf: never

    def over(self, begin, end):
        """`Transition` from one time to a later one."""
        decay, span = 1.0 / np.asarray(self.memory, float), end - begin
        both = decay[:, None] + decay
        length = np.where(both > 0.0, -np.expm1(-both * span) / np.where(both > 0.0, both, 1.0),
                          span)
        return Transition(np.diag(np.exp(-decay * span)), self.rate * length)


class Jump(NamedTuple):
    """Coefficients that are others from an epoch on."""

    epoch: float  # the first time that sees it
    covariance: np.ndarray  # (s, s), of its size

    def over(self, begin, end):
        """`Transition` from one time to a later one."""
        return Transition(None, np.asarray(self.covariance) * float(begin < self.epoch <= end))


class Together(NamedTuple):
    """Several dynamics of the same coefficients, which do all that these say."""

    parts: list

    def over(self, begin, end):
        """`Transition` from one time to a later one."""
        matrix, added = None, 0.0
        for dynamics in self.parts:
            step = dynamics.over(begin, end)
            added = added + step.added
            if step.matrix is not None:
                matrix = step.matrix if matrix is None else step.matrix @ matrix
                # what other parts add is added at the end of the stretch
        return Transition(matrix, added)
