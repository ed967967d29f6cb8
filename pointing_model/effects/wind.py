"""Wind and what else pulls to one direction of the horizon, wherever the tube looks."""

import numpy as np

from msg_tools.units import DEG

from .base import Effect, Offer, arcsec, effect, form

_EAST, _NORTH = np.eye(3)[:2, :, None]


@form
def _bent_to_one_side():
    def of(c):
        return [tuple(np.sum(axis * t, axis=0) for t in c.tangent()) for axis in (_EAST, _NORTH)]

    def wording(amount):
        east, north = amount.values
        toward = np.arctan2(east, north) / DEG % 360.0
        return (f'The tube is bent by up to {arcsec(float(np.hypot(east, north)))} toward azimuth '
                f'{toward:.0f}°, wherever it looks')

    return Effect('bent_to_one_side',
                  'the tube is bent toward one direction of the horizon',
                  'the part across the line of sight of a dipole fixed to the horizon', 'azimuth',
                  'both', ('east', 'north'), of, wording,
                  'steady wind on tube and dome slit, a cable that pulls',
                  'a pull toward one direction of the horizon')


def propose(context, lacking, own):
    """Of any mount."""
    yield Offer('bent_to_one_side', [effect('bent_to_one_side')])
