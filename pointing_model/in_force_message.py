"""The pair in force as one JSON text, on ``in_force``: a model and the zero that goes with it.

Who reads ``zero`` alone knows half of where the mount points; here are both halves.
"""

import json

import numpy as np

from .model import PointingModel
from .model_document import NO_MODEL, identity
from .plausible import check_model, check_zero
from .zero import BY_POLARIS, RunZero

FORMAT = 'telescope_mount/in_force'
VERSION = 1


def pair_to_text(model_text, stamp, zero):
    """The document.

    Parameters
    ----------
    model_text : str
        Of `PointingModel.to_json`; '' for none.
    stamp : int
        Of the newest observation that the zero rests on, ns.
    zero : RunZero

    Returns
    -------
    str
        JSON: ``model`` (the document of a pointing model, or null) and ``zero`` with
        ``stamp_ns``, ``run``, ``encoder_start`` (UTC s), ``model`` (its name), ``az_rad``,
        ``el_rad``, ``sigma_rad`` (null where unknown), and ``by`` where it is not by Polaris.
    """
    known = bool(np.isfinite(zero.sigma).all())
    return json.dumps({
        'format': FORMAT, 'version': VERSION,
        'model': json.loads(model_text) if model_text else None,
        'zero': {'stamp_ns': stamp, 'run': None if zero.run is None else int(zero.run),
                 'encoder_start': zero.started, 'model': zero.model, 'az_rad': float(zero.az),
                 'el_rad': float(zero.el),
                 'sigma_rad': zero.sigma.tolist() if known else None,
                 **({} if zero.by in (None, BY_POLARIS) else {'by': zero.by})}})


def text_to_pair(text):
    """The way back from `pair_to_text`.

    Returns
    -------
    model_text : str
        '' for none.
    stamp : int
    zero : RunZero

    Raises
    ------
    ValueError
        It is no such document, its halves do not go together, or no mount has them.
    """
    try:
        document = json.loads(text)
        if document['format'] != FORMAT or document['version'] != VERSION:
            raise ValueError(f'not {FORMAT} of version {VERSION}')
        model, told = document['model'], document['zero']
        sigma = told['sigma_rad']
        zero = RunZero(
            float(told['az_rad']), float(told['el_rad']),
            None if sigma is None else np.diag(np.square(np.array(sigma, float))),
            told['run'], told['encoder_start'], told['model'], told.get('by'))
        stamp = int(told['stamp_ns'])
        model_text = json.dumps(model, indent=1) if model else ''
        if model_text:
            check_model(PointingModel.from_json(model_text))
        check_zero(zero)
    except (KeyError, TypeError, AttributeError, OverflowError) as error:
        raise ValueError(f'not a pair in force: {error}') from None
    if (zero.model or NO_MODEL) != identity(model_text):
        raise ValueError(f'a zero of model {zero.model} beside model {identity(model_text)}')
    return model_text, stamp, zero
