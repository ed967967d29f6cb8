"""Of which telescope, when and where a diagnosis is: for the title of its page."""

from datetime import datetime, timezone
from pathlib import PurePath

import numpy as np

from msg_tools.units import DEG


def about(obs, sources):
    """Name, date and site, as far as they are known.

    Parameters
    ----------
    obs : Observations
    sources : sequence of str
        Names of the files: the first stands for a telescope whose file has no caption.

    Returns
    -------
    str
        '' where nothing is known.
    """
    caption = str(obs.run.meta.get('caption') or '').strip()
    name = caption or (PurePath(sources[0]).stem if sources else '')
    return ', '.join(filter(None, [name, _date(obs), _site(obs.run.meta.get('site'))]))


def axes_note(context):
    """What the angles are where a telescope looks through the pole; '' where none does.

    Parameters
    ----------
    context : Context
    """
    names, through = context.mount.names, np.abs(context.el) > np.pi / 2.0
    if not through.any():
        return ''
    first, second = names.axes
    way = 'past the zenith' if context.mount.vertical else 'through the pole'
    text = (f'{first.capitalize()} and {second} are those of the axes, as their encoders count. '
            f'In {int(through.sum())} of {len(context)} rows the telescope looks {way}, '
            f'the {second} beyond 90°')
    if names.columns[0] == 'ha':
        way = 'on either side of the pier' if context.mount.two_sided else \
            'through the pole or not'
        text += (f': there the {first} of the axis is 12 h from that of the star. A value of the '
                 f'{first} is so one position of the {names.shafts[0]}, {way}')
    return f'{text}.'


def _date(obs):
    """First and last day, UTC."""
    times = obs.context.get('time')
    known = np.zeros(0) if times is None or not getattr(obs.context, 'time_is_utc', True) \
        else times[np.isfinite(times)]
    if not known.size:
        return str(obs.run.meta.get('date') or '')
    first, last = (f'{datetime.fromtimestamp(float(t), timezone.utc):%Y-%m-%d}'
                   for t in (known.min(), known.max()))
    return first if first == last else f'{first} to {last}'


def _site(site):
    """Latitude and longitude, degrees."""
    found = (site.get(key) if isinstance(site, dict) else getattr(site, key, None)
             for key in ('latitude', 'longitude'))
    return ' '.join(f'{abs(value / DEG):.2f}° {ways[value < 0.0]}'
                    for value, ways in zip(found, ('NS', 'EW')) if value is not None)
