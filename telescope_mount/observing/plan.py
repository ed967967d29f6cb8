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

"""The observing plan: what the star observer does, step by step, as one line of text."""

import re
import uuid
from dataclasses import dataclass, replace

from msg_tools.units import ARCSEC

#: default number of stars in a block of a night, and of exposures for a zero
BLOCK_STARS, ZERO_EXPOSURES = 30, 16
_UNIT = 'arcsec'
#: what `power_cycle` switches off and on -> services to call
POWER_CYCLES = {'incremental': ('power_cycle',), 'absolute': ('absolute/power_cycle',),
                'both': ('power_cycle', 'absolute/power_cycle')}


@dataclass(frozen=True)
class Verb:
    """Syntax of a kind of step.

    Attributes
    ----------
    counts : str
        What its number counts, '' without one; for `power_cycle` what it switches.
    form, how : str
        Regular expression for the text after the verb, and a hint how to write it.
    takes : tuple of str
        Fields of a typed step (PlanStep.msg) that it uses.
    pair : str
        Format of its argument if it is typed as two numbers.
    patient : bool
        It does not wait for an instrument: its duration is unknown.
    """

    counts: str = ''
    form: str = r'(?P<count>\d+)'
    how: str = ' and a count of 1 to 100000'
    takes: tuple = ('count',)
    pair: str = ''
    patient: bool = False


_ALONE, _EXPOSURES = Verb(form='', how='', takes=()), Verb('exposures')
_PATIENT = replace(_ALONE, patient=True)
#: all kinds of steps in a plan
VERBS = {
    'home': _ALONE,
    'power_cycle': Verb('encoders', f'(?P<what>{"|".join(POWER_CYCLES)})?',
                        f', alone or with one of {", ".join(POWER_CYCLES)}', ('names',)),
    'stars': _EXPOSURES,
    'polaris': _EXPOSURES,
    'zero_on_stars': _EXPOSURES,
    'zero': _EXPOSURES,
    'satellite': _EXPOSURES,
    'pass': Verb('', r'(?P<what>\S+ \S+)',
                 ', a satellite and a file of its orbit, such as pass L52 lageos2.sp3',
                 ('names',)),
    'check': _EXPOSURES,
    'clocks': Verb('images'),
    'track': Verb('minutes', rf'(?P<what>(\d+\.?\d*|\.\d+){_UNIT})( (?P<count>\d+)(min)?)?',
                  ', the error to hold and the minutes, such as track 1.5arcsec 90',
                  ('error', 'duration'), f'{{0:g}}{_UNIT} {{1:g}}'),
    'tell_apart': Verb('exposures', r'(?P<count>\d+)( (?P<what>\d+(\.\d*)?h))?',
                       ' and a count of 1 to 100000, and what may be waited, such as 2h',
                       ('count', 'duration'), '{0:g} {1:g}h'),
    'wait': Verb('hours', takes=('duration',), patient=True),
    'calibrate_zero': _PATIENT,
    'fit': _PATIENT,
    'diagnose': _PATIENT,
    'judge': _PATIENT,
}
#: default minutes of `track`
_MINUTES = 60


@dataclass(frozen=True)
class PlanStep:
    """One step: its verb, its count (0 for a verb without one), and its argument.

    `what` is '' for `power_cycle` alone, which means the incremental encoder; for `track` the
    error to hold, such as ``1.5arcsec``; for `tell_apart` the longest wait, such as ``2h``; for
    `pass` the satellite and the file of its orbit.
    """

    verb: str
    count: int = 0
    what: str = ''

    @property
    def goal(self):
        """For `track`: radial RMS to hold, rad."""
        return float(self.what.removesuffix(_UNIT)) * ARCSEC

    @property
    def hours(self):
        """For `tell_apart`: longest wait for stars, h."""
        return float(self.what.removesuffix('h') or 0.0)

    @property
    def exposures(self):
        """Number of observations that it makes."""
        return self.count if VERBS[self.verb].counts == 'exposures' else 0

    def __str__(self):
        words = [self.what, str(self.count or '')]
        if self.verb == 'tell_apart':
            words.reverse()
        return ' '.join([self.verb, *filter(None, words)])


def parse_plan(text):
    """Read a plan such as ``home, stars 30, polaris 16, calibrate_zero, stars 30, fit``.

    Parameters
    ----------
    text : str
        Steps separated by commas. `stars`, `polaris`, `zero_on_stars` (a few stars chosen to
        determine the zeros best), `zero` (Polaris if it is high enough, else such stars),
        `satellite` and `check` (new stars pointed at blind, for validation) have the number of
        exposures, and so has `clocks` (of one star past which the axes drift: it measures the
        offset of the clocks of camera and encoder). `wait` has hours since the begin of the night
        or the last `wait`. `track 1.5arcsec 90` observes for 90 minutes (default 60) the stars that
        keep the expected pointing error below 1.5 arcsec, with a calibration in mode ``track``.
        `tell_apart 15 2h` observes at most 15 stars that the calibration requests to separate
        the causes left by its diagnosis, and waits for them at most 2 h in all (default: not at
        all). `pass L52 lageos2.sp3` waits for the next pass of a satellite and observes it until
        it sets. `power_cycle` is that of the incremental encoder, unless `absolute` or `both`
        follows.

    Returns
    -------
    list of PlanStep

    Raises
    ------
    ValueError
        Unknown verb, missing or bad count, or an empty plan.
    """
    steps = [_step(part.strip()) for part in text.split(',') if part.strip()]
    if not steps:
        raise ValueError('the plan is empty')
    return steps


def check_verb(verb):
    """ValueError for an unknown verb."""
    if verb not in VERBS:
        raise ValueError(f'plan step {verb!r} is unknown; use {", ".join(VERBS)}')


def _step(text):
    verb, _, rest = text.partition(' ')
    check_verb(verb)
    of = VERBS[verb]
    found = re.fullmatch(of.form, ' '.join(rest.split()))
    if not (found or of.form):
        raise ValueError(f'plan step {verb} takes no count')
    given = found.groupdict() if found else {}
    count = int(given.get('count') or _MINUTES * (verb == 'track'))
    step = PlanStep(verb, count, (given.get('what') or '').replace('incremental', ''))
    if not found or ('count' in given and not 1 <= count <= 100000) or (
            verb == 'track' and not 0.0 < step.goal <= 3600.0):
        raise ValueError(f'plan step {text!r}: write {verb}{of.how}')
    return step


def goal_uuid(stamp, plan):
    """UUID of the goal of a plan that began at `stamp` (int, ns): equal for a repeated night."""
    return uuid.uuid5(uuid.NAMESPACE_OID, f'{stamp} {plan}')


def night_plan(stars, exposures, reference=False, cycle='incremental'):
    """The plan of a night.

    Without a reference the night has two power-ons, to show the drift between them: the first is
    the reference for the second. With a model of an earlier night it is the paper's night (paper
    000, section 2): stars, Polaris, stars. If Polaris is not high enough, stars are used for the
    zero.

    Parameters
    ----------
    stars : int
        Stars in each of the two blocks.
    exposures : int
        Number of exposures for each zero.
    reference : bool
        Whether a model of an earlier night is active.
    cycle : {'incremental', 'absolute', 'both'}
        The encoders that are power-cycled in the middle of the night.

    Returns
    -------
    str
    """
    zero = f'zero {exposures}, calibrate_zero'
    if reference:
        return f'home, stars {stars}, {zero}, stars {stars}, fit'
    again = {'incremental': 'power_cycle, home', 'absolute': 'power_cycle absolute',
             'both': 'power_cycle both, home'}[cycle]
    return f'home, stars {stars}, {zero}, {again}, {zero}, stars {stars}, fit'


def real_plan(stars):
    """The plan for a real mount: stars, a fit, and new stars pointed at blind for validation.

    No encoder is switched off, and the zero is that of the fit.
    """
    return f'home, stars {stars}, clocks 24, fit, check {max(stars // 4, 3)}'
