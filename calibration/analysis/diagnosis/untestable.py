"""Something is significant, but these observations cannot test it: neither found nor absent.

What is dropped because rows or runs that are left out are predicted worse is, as a rule, no effect
of the mount. Where it carries most of the error, or where the declared model itself fails on what
is left out, the runs are too few or too unequal to say so: without one of them the rest does not
determine it.
"""

import numpy as np

#: RMS of rows left out over the noise floor, times what the fit's freedom makes of it (see
#: `_expected`), from where the model fails there; where something was dropped besides, and where
#: nothing was. On 150 clean nights each of 12, 16, 30 and 60 stars it was 1.5, 1.4, 1.1 and 1.0 at
#: most.
_FAILS, _FAILS_ALONE = 1.3, 1.6


def judge_undecided(result, dropped, delta_bic):
    """Take back a verdict of ``none`` that the observations cannot support, in place.

    Parameters
    ----------
    result : Diagnosis
        With its cross-validated RMS.
    dropped : list of str
        Names of what was beyond chance and given up on rows or runs left out.
    delta_bic : float
        Of the best candidate on what the base leaves: from n ln 2 on it takes away half of the
        variance of an axis.
    """
    cv, floor = result.before['cv_rms_arcsec'], result.noise_floor_arcsec
    if result.verdict != 'none' or cv is None:
        return
    limit = (_FAILS if dropped else _FAILS_ALONE) * _expected(result.before['rms_arcsec'], floor)
    most = bool(dropped) and delta_bic > len(result.observations) * np.log(2.0)
    if cv <= limit * floor and not most:
        return
    result.verdict = 'undecided'
    text = ''
    if dropped:
        text = (f'Beyond chance, but not added, for it does not hold where a part of the '
                f'observations is left out: {"; ".join(dropped)}. ')
    text += (f'Where a part is left out the model misses it by {cv:.1f}\u2033 beside a noise of '
             f'{floor:.1f}\u2033' if cv > limit * floor else 'It would take away most of the error')
    several = len(np.unique(result.observations.label)) > 1
    result.caution = f'{text}: the observations are too few or too unequal to ' + (
        'distinguish an effect from what one session has of its own. Observe the whole sky in one '
        'session more.' if several else 'judge an effect. Observe more stars, over the whole sky.')


def _expected(left, floor):
    """What cross-validation adds to the noise of a fit that leaves `left` of it, generously."""
    return float(np.sqrt(1.0 + 4.0 * ((floor / left)**2 - 1.0))) if left > 0.0 else 1.0
