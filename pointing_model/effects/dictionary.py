"""The candidate effects of a run: what its rows can show, and why the others cannot be tested."""

from .base import PROPOSALS

#: The dictionary's order, by form (and axis, where it is offered axis by axis); what is not here
#: follows. Of equal scores the first wins, so another order is another result.
ORDER = ('term', 'terms', 'encoder', 'bearing_wobble', 'nod', 'elevation_axis_wobble',
         'fork_cross_term', 'diurnal_aberration', 'latitude', 'clock', 'annual_aberration',
         'epoch_error', 'drift', 'hysteresis az', 'subdivision az', 'hysteresis el',
         'subdivision el', 'proper_motion', 'latency', 'camera', 'proportional',
         'run_zero')


def dictionary(context, lacking=(), own=()):
    """All effects that this project knows, with parameters from the run (origins, scales).

    Parameters
    ----------
    context : Context
        Of the run.
    lacking : sequence of str, optional
        Names in `terms.TERMS` of terms that the declared model does not have: candidates too.
    own : sequence of str, optional
        Terms that each run fits for itself.

    Returns
    -------
    effects : list of Effect
        What can be tested.
    untestable : list of (str, str)
        Effect (or its driver) and the reason why it cannot be tested in this run.
    """
    offers = [o for propose in PROPOSALS for o in propose(context, tuple(lacking), tuple(own))]
    offers.sort(key=_place)
    return ([e for o in offers for e in o.effects],
            [(o.what, o.reason) for o in offers if o.reason])


def _place(offer):
    key = f'{offer.form} {offer.axis}'.strip()
    return ORDER.index(key) if key in ORDER else len(ORDER)
