"""The observing plan: what the star observer does, step by step, as one line of text."""

from dataclasses import dataclass

#: verb -> what its number counts, '' for a verb without one
VERBS = {
    'home': '',
    'power_cycle': '',
    'stars': 'exposures',
    'polaris': 'exposures',
    'satellite': 'exposures',
    'check': 'exposures',
    'wait': 'hours',
    'calibrate_zero': '',
    'fit': '',
    'diagnose': '',
    'judge': '',
}


@dataclass(frozen=True)
class Step:
    """One step: its verb, and its count (0 for a verb without one)."""

    verb: str
    count: int = 0

    @property
    def exposures(self):
        """How many observations it makes."""
        return self.count if VERBS[self.verb] == 'exposures' else 0

    def __str__(self):
        return f'{self.verb} {self.count}' if self.count else self.verb


def parse_plan(text):
    """Read a plan such as ``home, stars 30, polaris 16, calibrate_zero, stars 30, fit``.

    Parameters
    ----------
    text : str
        Steps separated by commas; `stars`, `polaris`, `satellite` and `check` (fresh stars
        pointed at blind, to judge by) take the number of exposures, `wait` the hours from the
        begin of the night (or the last `wait`) on.

    Returns
    -------
    list of Step

    Raises
    ------
    ValueError
        Unknown verb, missing or bad count, or an empty plan.
    """
    steps = []
    for part in text.split(','):
        words = part.split()
        if not words:
            continue
        verb, rest = words[0], words[1:]
        if verb not in VERBS:
            raise ValueError(f'plan step {verb!r} is unknown; use {", ".join(VERBS)}')
        if not VERBS[verb] and rest:
            raise ValueError(f'plan step {verb} takes no count')
        if VERBS[verb] and (len(rest) != 1 or not rest[0].isdecimal()
                            or not 1 <= int(rest[0]) <= 100000):
            raise ValueError(f'plan step {part.strip()!r}: write {verb} and a count of 1 to 100000')
        steps.append(Step(verb, *map(int, rest)))
    if not steps:
        raise ValueError('the plan is empty')
    return steps


def night_plan(stars, polaris, reference=False):
    """The plan of a night.

    Without a reference the night has two power-ons, so that the drift between them shows: the
    first is the reference of the second. With a model of an earlier night it is the paper's
    night (paper 000, section 2): stars, Polaris, stars.

    Parameters
    ----------
    stars : int
        Stars in each of the two blocks.
    polaris : int
        Exposures of Polaris for each zero.
    reference : bool
        Whether a model of an earlier night is in force.

    Returns
    -------
    str
    """
    zero = f'polaris {polaris}, calibrate_zero'
    if reference:
        return f'home, stars {stars}, {zero}, stars {stars}, fit'
    return f'home, stars {stars}, {zero}, power_cycle, home, {zero}, stars {stars}, fit'
