"""Causes told apart by stars that are asked for."""


from diagnosis_simulated import FAST  # noqa: F401
