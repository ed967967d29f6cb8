"""Candidate effects: what a mount may do beyond its declared terms, and how it would show."""

from .base import PERIODS, Effect, effect, of_document
from .curves import smooths
from .dictionary import dictionary, steps

__all__ = ['PERIODS', 'Effect', 'dictionary', 'effect', 'of_document', 'smooths', 'steps']
