"""What a mount is pointed with now: the model, the zero, and the thermometer's readings."""

import numpy as np

from msg_tools.units import ARCSEC

from .drivers import Thermometer, demand_angles
from .model import PointingModel
from .zero import NO_ZERO, zeros_in_force


class InForce:
    """Model, zero and thermometer, as they came last.

    Parameters
    ----------
    model : PointingModel, optional
        In force at the start.

    Attributes
    ----------
    model : PointingModel or None
    models : int
        How many came.
    model_stamp : int
        Of the last observation that the model rests on, ns; 0 where it does not say.
    zero : RunZero
    zero_stamp : int
        Of the last observation that the zero rests on, ns.
    thermometer : Thermometer
    """

    def __init__(self, model=None):
        self.model = model
        self.models = self.model_stamp = 0
        self.zero, self.zero_stamp = NO_ZERO, 0
        self.thermometer = Thermometer()

    def take_model(self, text):
        """Take a model as its JSON text; ValueError where it is none."""
        self.model = PointingModel.from_json(text)
        self.models += 1
        stamp = self.model.provenance.get('last_stamp_ns')
        self.model_stamp = stamp if isinstance(stamp, int) else 0

    def take_zero(self, stamp, zero):
        """Take a RunZero."""
        self.zero, self.zero_stamp = zero, stamp

    def zero_is_of_model(self):
        """Whether the zero is the one that the model tells of, if it tells.

        They come on two topics, and one without the other points elsewhere.
        """
        told = zeros_in_force(self.model)
        return not told or bool(np.all(
            np.abs(self.zero.angles - told.newest.angles) < 1e-6 * ARCSEC))

    def encoder(self, az, el, context=None):
        """Encoder angles that point at a place: model and zero, each once.

        Parameters
        ----------
        az, el : ndarray, shape (n,)
            Catalogue place, rad.
        context : Context, optional
            What the effects of the model ask for.

        Returns
        -------
        ndarray, shape (n, 2)
            rad.
        """
        if self.model is not None:
            az, el = demand_angles(self.model, az, el, context, self.zero.angles)
        return np.column_stack([az, el]) + self.zero.angles
