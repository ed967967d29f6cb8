"""Polaris zero, fit of the pointing model, and the check on data the fit did not see."""
