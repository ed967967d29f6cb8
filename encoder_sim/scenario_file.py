"""Scenario files: what is wrong with the simulated mount, as YAML.

Only the simulator reads them. What a file does not name stays at the value of the scenario it is
``based_on``, or else at the ideal of `scenario`.
"""

import dataclasses
from importlib import resources
from pathlib import Path

from .scenario import Scenario
from .scenario_fields import in_si

_FOLDER = resources.files('encoder_sim') / 'scenarios'


def _key(item):
    """Key of a field in the file: a drift is named by what it drifts with, which the unit says."""
    unit = item.metadata.get('unit')
    name = item.name.rpartition('_')[0] if unit and '_per_' in unit else item.name
    return f'{name}_{unit}' if unit else name


def _to_number(value, item, where):
    low, high = item.metadata['range']
    kind = item.metadata['kind']
    what = 'a whole number' if kind is int else 'a number'
    wrong = f'{where}: {value!r} is not {what} from {low:g} to {high:g}'
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        hint = ' (write 1.0e-3, not 1e-3)' if isinstance(value, str) and 'e' in value else ''
        raise ValueError(wrong + hint)
    if not low <= value <= high or (kind is int and value != int(value)):
        raise ValueError(wrong)
    return int(value) if kind is int else value * in_si(item.metadata['unit'])


def _to_value(value, item, where, base):
    if 'choice' in item.metadata:
        if value not in item.metadata['choice']:
            names = ', '.join(item.metadata['choice'])
            raise ValueError(f'{where}: {value!r} is not one of {names}')
        return value
    if 'section' in item.metadata:
        if value is None and item.default is None:
            return None
        return _to_section(value, item.metadata['section'], where, base)
    if 'sections' in item.metadata:
        if not isinstance(value, list):
            raise ValueError(f'{where}: {value!r} is not a list')
        cls = item.metadata['sections']
        return tuple(_to_section(v, cls, f'{where}[{i}]', None) for i, v in enumerate(value))
    if item.metadata['kind'] is list:
        if not isinstance(value, list):
            raise ValueError(f'{where}: {value!r} is not a list of numbers')
        return tuple(_to_number(v, item, f'{where}[{i}]') for i, v in enumerate(value))
    return _to_number(value, item, where)


def _to_section(mapping, cls, where, base):
    """An instance of `cls` from a mapping of the file, upon `base`."""
    if not isinstance(mapping, dict):
        raise ValueError(f'{where}: {mapping!r} is not a mapping of keys to values')
    items = {_key(f): f for f in dataclasses.fields(cls) if f.metadata}
    base = cls() if base is None else base
    changes = {}
    for key, value in mapping.items():
        if key not in items:
            allowed = ', '.join(items)
            raise ValueError(f'{where}: unknown key {key!r}; allowed: {allowed}')
        item = items[key]
        inside = f'{where}, {key}' if where.count(',') == 0 else f'{where}.{key}'
        changes[item.name] = _to_value(value, item, inside, getattr(base, item.name))
    return dataclasses.replace(base, **changes)


def _drop_description(mapping, file):
    """Take out ``undeclared``, which says to people what the scenario does."""
    said = mapping.pop('undeclared', {'what': ''})
    if not (isinstance(said, dict) and isinstance(said.get('what'), str)
            and set(said) <= {'what', 'shows_as'}):
        raise ValueError(f'scenario {file}, undeclared: {said!r} is not a mapping of what: a text '
                         'and shows_as: names of effects')


def scenario_names():
    """Names of the scenarios that come with the package."""
    return sorted(f.name[:-5] for f in _FOLDER.iterdir() if f.name.endswith('.yaml'))


def load_scenario(name_or_path='default'):
    """Read a scenario.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a scenario of the package, such as ``default`` or ``ideal``, or a YAML file.

    Returns
    -------
    Scenario
        In SI.

    Raises
    ------
    ValueError
        No such scenario, no YAML, an unknown key, a wrong type, or a value out of its range: one
        line with the file, the key and what is allowed.
    """
    scenario, chain = Scenario(), _chain(str(name_or_path))
    for _, file, _, mapping in reversed(chain):
        scenario = _to_section(mapping, Scenario, f'scenario {file}', scenario)
        for axis in ('azimuth', 'elevation'):
            limits = getattr(scenario.axes, axis)
            if limits.travel_min >= limits.travel_max:
                raise ValueError(f'scenario {file}, axes.{axis}: travel_min_deg must be below '
                                 'travel_max_deg')
    return dataclasses.replace(scenario, name=chain[0][0])


def scenario_files(name_or_path='default'):
    """What a scenario says in its own words, for those who read it when all is over.

    Parameters
    ----------
    name_or_path : str or Path
        As for `load_scenario`, which says what is raised.

    Returns
    -------
    list of dict
        ``name`` and ``text`` of the scenario, then of each that it is based on.
    """
    return [{'name': name, 'text': text} for name, _, text, _ in _chain(str(name_or_path))]


def undeclared(text):
    """What a scenario does that nobody was told.

    Parameters
    ----------
    text : str
        Of the scenario's file.

    Returns
    -------
    dict or None
        ``what`` (a text) and ``shows_as`` (beginnings of names of effects; empty: of none, None:
        not said); None where the scenario says nothing.
    """
    import yaml
    said = (yaml.safe_load(text) or {}).get('undeclared')
    return {'what': said['what'], 'shows_as': said.get('shows_as')} if said else None


def _read(text):
    """Name, name of the file for people, and content of a scenario."""
    path = Path(text)
    if path.suffix in ('.yaml', '.yml'):
        if not path.is_file():
            raise ValueError(f'scenario file {text} does not exist')
        return path.stem, text, path.read_text(encoding='utf-8')
    if text not in scenario_names():
        raise ValueError(f'no scenario {text!r}: give a .yaml file or one of '
                         + ', '.join(scenario_names()))
    file = f'{text}.yaml'
    return text, file, (_FOLDER / file).read_text(encoding='utf-8')


def _chain(text):
    """(name, file, content, mapping) of a scenario, then of each that it is based on."""
    import yaml

    out, seen = [], []
    while text is not None:
        if text in seen:
            raise ValueError(f'scenario {text}: based on itself')
        seen.append(text)
        name, file, content = _read(text)
        try:
            mapping = yaml.safe_load(content)
        except yaml.YAMLError as error:
            line = ' '.join(str(error).split())
            raise ValueError(f'scenario {file}: no valid YAML: {line}') from None
        mapping = {} if mapping is None else mapping
        parent = None
        if isinstance(mapping, dict):
            _drop_description(mapping, file)
            if 'based_on' in mapping:
                parent = str(mapping.pop('based_on'))
                if parent.endswith(('.yaml', '.yml')):
                    parent = str(Path(text).parent / parent)
        out.append((name, file, content, mapping))
        text = parent
    return out
