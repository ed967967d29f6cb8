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

"""How coefficients change with time: constant, random walk, exponential memory, jump.

A dynamics model has one method, `over`: the transition of the state over a stretch of time. The
coefficients are multiplied by a matrix, and a covariance (process noise) is added to theirs. A new
model is a class with this method, and needs no change of the solver (`kalman`).
"""

from typing import NamedTuple

import numpy as np


class Transition(NamedTuple):
    """Transition of s coefficients over a stretch of time."""

    matrix: np.ndarray | None  # (s, s), transition matrix; None: the identity
    added: np.ndarray  # (..., s, s), process noise; for several hypotheses at once


class Constant:
    """Coefficients that do not change."""

    def over(self, begin, end):
        """`Transition` from one time to a later one."""
        return Transition(None, np.zeros((1, 1)))


class RandomWalk(NamedTuple):
    """Coefficients that follow a random walk."""

    rate: np.ndarray  # (..., s, s), covariance added per unit of time

    def over(self, begin, end):
        """`Transition` from one time to a later one."""
        return Transition(None, np.asarray(self.rate) * (end - begin))


class ExponentialMemory(NamedTuple):
    """Coefficients that drift and return to zero (Ornstein and Uhlenbeck)."""

    rate: np.ndarray  # (..., s, s), covariance added per unit of time
    memory: np.ndarray  # (s,), time in which a coefficient decays by a factor e; inf: never

    def over(self, begin, end):
        """`Transition` from one time to a later one."""
        decay, span = 1.0 / np.asarray(self.memory, float), end - begin
        both = decay[:, None] + decay
        length = np.where(both > 0.0, -np.expm1(-both * span) / np.where(both > 0.0, both, 1.0),
                          span)
        return Transition(np.diag(np.exp(-decay * span)), self.rate * length)


class Jump(NamedTuple):
    """Coefficients that jump at an epoch."""

    epoch: float  # the first time after the jump
    covariance: np.ndarray  # (s, s), of the size of the jump

    def over(self, begin, end):
        """`Transition` from one time to a later one."""
        return Transition(None, np.asarray(self.covariance) * float(begin < self.epoch <= end))


class Together(NamedTuple):
    """Several dynamics acting on the same coefficients."""

    parts: list

    def over(self, begin, end):
        """`Transition` from one time to a later one."""
        matrix, added = None, 0.0
        for dynamics in self.parts:
            step = dynamics.over(begin, end)
            added = added + step.added
            if step.matrix is not None:
                matrix = step.matrix if matrix is None else step.matrix @ matrix
                # process noise of the other parts is added at the end of the stretch
        return Transition(matrix, added)
