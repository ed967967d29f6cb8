"""Whether the filter is as good as it says: a test of its innovations, and what follows.

The normalised innovation squared (NIS) of a star has the mean 2 where the filter is honest. Over
the last stars its sum is chi squared (Bar-Shalom, Li and Kirubarajan 2001, section 5.4). Stars
count once it is decided that nothing jumped before them and that they were no wrong ones.
"""

from functools import cache

import numpy as np

#: stars of a test: from, and the last so many
FEWEST, WINDOW = 12, 24
#: chance that an honest filter is called over- or under-confident at one star. The sums of
#: neighbouring stars are much alike: in a night of 48 stars it happens to 1 % (docs/tracking.md)
LEVEL = 5e-4
#: correlation of neighbouring innovations below which they turn back
TURNS = -0.2
#: the noise is taken no more than so many times as large
MOST = 5.0
HONEST, OVER, UNDER = 'honest', 'over-confident', 'under-confident'


@cache
def _bounds(count):
    """Sums of so many NIS beyond which a filter is not honest."""
    from scipy.special import chdtri, gammaincinv
    return 2.0 * gammaincinv(count, LEVEL), chdtri(2 * count, LEVEL)


class Confidence:
    """The last innovations, and by how much noise or drift are taken larger for them.

    Attributes
    ----------
    noise, walk : float
        Factors of the noise of stars and of all walks (as lengths); 1 as given.
    verdict : str
        `HONEST`, `OVER` (errors are larger than predicted) or `UNDER` (smaller).
    tested : tuple of (int, float) or None
        Of the test that gave a verdict other than `HONEST`: stars, and their errors as a part of
        the predicted ones (RMS): above 1 where it is `OVER`, below where it is `UNDER`.
    """

    def __init__(self):
        self.noise, self.walk, self.verdict, self.tested = 1.0, 1.0, HONEST, None
        self._last = []  # [x, y] of each star, in sigmas, decided

    def add(self, off, fastest=0.0):
        """Take the innovation of a star of which it is decided that nothing happened.

        Parameters
        ----------
        off : sequence of float, length 2
            Normalised: its squares add up to the NIS.
        fastest : float
            How likely the fastest walk of all that are thought of is by now. Where it is, the
            mount drifts still faster, unless innovations turn back from star to star: a filter
            that runs after noise overshoots.

        Returns
        -------
        str
            One line where the verdict is another one now, else ''.
        """
        self._last = [*self._last[1 - WINDOW:], [float(v) for v in off]]
        count = len(self._last)
        if count < FEWEST:
            return ''
        last = np.array(self._last)
        total = float(np.sum(last * last))
        low, high = _bounds(count)
        size = float(np.sqrt(total / (2.0 * count)))
        if total > high:
            self.verdict, self.tested, self._last = OVER, (count, size), []
            drifts = fastest > 0.5 and np.sum(last[1:] * last[:-1]) > TURNS * total
            what = 'walk' if drifts else 'noise'
            setattr(self, what, min(getattr(self, what) * size, MOST))
            return f'{self.sentence()}; ' + (
                f'drifts are thought {self.walk:.2f} times as fast from now on'
                if what == 'walk' else
                f'the noise of stars is taken {self.noise:.2f} times as large from now on')
        if total < low:
            said, widened = self.verdict == UNDER, self.noise * self.walk > 1.0
            self.verdict, self.tested, self._last = UNDER, (count, size), []
            self.noise, self.walk = max(1.0, self.noise * size), max(1.0, self.walk * size)
            if widened:
                return (f'{self.sentence()}; from now on the noise of stars is taken '
                        f'{self.noise:.2f} times as large, drifts {self.walk:.2f} times as fast')
            return '' if said else (f'{self.sentence()}; the noise of stars or the drift that is '
                                    'expected is too large')
        if count == WINDOW and self.noise * self.walk == 1.0:
            self.verdict, self.tested = HONEST, None
        return ''

    def sentence(self):
        """The verdict, and the ratio that it rests on, for people."""
        if self.tested is None:
            return self.verdict
        count, ratio = self.tested
        return (f'{self.verdict}: errors of {count} stars were {ratio:.2f} times the predicted '
                'ones (RMS)')

    @property
    def mean(self):
        """Mean of NIS / 2 over the stars that are tested; NaN of none."""
        return float(np.mean(np.square(self._last))) if self._last else float('nan')

    def state(self):
        """JSON-ready."""
        return {'noise': self.noise, 'walk': self.walk, 'verdict': self.verdict,
                'tested': self.tested, 'last': self._last}

    @classmethod
    def of_state(cls, state):
        """That of which `state` was taken."""
        out = cls()
        out.noise, out.walk = float(state['noise']), float(state['walk'])
        out.verdict, out._last = state['verdict'], state['last']
        tested = state.get('tested')  # logs of before do not have it
        out.tested = tested and tuple(tested)
        return out
