"""Tracking beside the calibration of a night: from which model it begins, and what it gives."""

from msg_tools.units import ARCSEC
from pointing_model.model_document import identity
from pointing_model.zero import RunZero

from .history import PAST, RATES
from .tracked_night import KEY, TrackedNight, difference_of, lean_of

#: a model of a file that does not tell when it held is of another night, ns
_A_DAY = 86_400_000_000_000
#: of a model that tells of the nights before: just before the first star, ns
_BEFORE = 10**9


class LiveTracking:
    """Follows the mount of a `CalibrationState` from a model on.

    Attributes
    ----------
    night : TrackedNight or None
        None: there is no model to begin with.
    """

    def __init__(self):
        self.night = None

    def begin(self, state):
        """Begin anew from the active model, which was fitted to all rows so far."""
        report = state.report or {}
        noise = report.get('noise_arcsec')
        self.night = TrackedNight(
            state.model, state.active_zeros.newest, state.last_stamp,
            noise and tuple(float(v) * ARCSEC for v in noise),
            difference_of(state.observations()), lean_of(state.observations()),
            state.reference and state.reference.provenance.get(RATES))

    def take_up(self, state, model):
        """Go on with the night of a tracked model, with the rows that are here.

        Whether it is one; ValueError where what it tells is damaged.
        """
        if KEY not in model.provenance:
            return False
        self.night = TrackedNight.of_model(model)
        self.again(state)
        return True

    def again(self, state):
        """Take the rows that are here: all of them, after a start in the middle of a night."""
        if self.night is not None and len(state.rows):
            self.night.take(state.observations())

    def observed(self, state, rows):
        """Take rows that have come.

        Parameters
        ----------
        state : CalibrationState
        rows : PointingRun

        Returns
        -------
        bool
            Whether there is another model.
        """
        if self.night is None:
            reference = state.reference
            if reference is None:
                return False
            first = int(rows['time'][0] * 1e9)
            held = reference.provenance.get('last_stamp_ns')
            held = held if isinstance(held, int) else first
            # one that tells of nights is of this one: how far nights differ is in it
            held = first - _BEFORE if PAST in reference.provenance else min(held, first - _A_DAY)
            self.night = TrackedNight(reference, RunZero(0.0, 0.0), held)
        return any(one.taken for one in self.night.take(rows))

    def pair(self, state):
        """The model by now, and the zero that goes with it."""
        model = self.night.model(state.last_stamp)
        return model, self.night.bound_zero(identity(model.to_json()))
