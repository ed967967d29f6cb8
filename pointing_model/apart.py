"""What a calibration asks for to tell causes apart, as the observer reads it."""

import json
from dataclasses import dataclass

FORMAT = 'telescope_mount/apart'
VERSION = 1
#: states: a star is wanted; each set is one cause; a set is not
ASKS, ONE_CAUSE, CANNOT = 'asks', 'one cause', 'cannot be told from here'


@dataclass(frozen=True)
class Asked:
    """How causes stand, and the star that is wanted.

    Attributes
    ----------
    stamp : int
        Of the newest row that it is said of, ns.
    state, says : str
    request : dict or None
        As of `calibration.analysis.diagnosis.discrimination.Judgement`.
    """

    stamp: int
    state: str
    says: str
    request: dict | None

    @classmethod
    def read(cls, text):
        """From the document on `apart`.

        Raises
        ------
        ValueError
            It is none, or damaged.
        """
        try:
            told = json.loads(text)
            if told['format'] != FORMAT or told['version'] != VERSION:
                raise ValueError(f'{told["format"]!r} {told["version"]!r}')
            request = told['request']
            for name in ('az_deg', 'el_deg') if request else ():
                float(request[name])
            return cls(int(told['last_stamp_ns']), str(told['state']), str(told['says']), request)
        except (ValueError, KeyError, TypeError) as err:
            raise ValueError(f'no document of causes to tell apart: {err}') from None
