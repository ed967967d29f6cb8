"""Words that the sentences of effects share."""

import re

import numpy as np

#: drivers in words, where their name is not the word
DRIVER_WORDS = {'order': 'order of the rows', 'run_hours': 'time since the start of the run'}
#: last motion of an axis in words
SIDES = {'approach_az': {-1: 'anticlockwise', 1: 'clockwise'},
         'approach_el': {-1: 'downward', 1: 'upward'}}
_TIMES = {1: 'once', 2: 'twice'}


def arcsec(value, sign=False):
    """A value for a sentence, e.g. ``2.70″``."""
    if value is None or not np.isfinite(value):
        return '?'
    digits = 0 if abs(value) >= 99.95 else 1 if abs(value) >= 9.995 else 2
    return f'{value:{"+" if sign else ""}.{digits}f}″'.replace('-', '−')


def times(order):
    """How often a turn, e.g. ``twice per turn``."""
    return f'{_TIMES.get(order, f"{order} times")} per turn'


def driver_word(name):
    """A driver in words."""
    return DRIVER_WORDS.get(name, name)


def readable(name):
    """Name of an effect for people: ``azimuth_encoder_2`` is "azimuth encoder, 2 per turn"."""
    name = re.sub(r'(encoder|wobble|nod)_(\d+)$', r'\1, \2 per turn', str(name))
    return re.sub(r'_memory_([\d.]+)deg', r', memory \1°', name).replace('_', ' ')
