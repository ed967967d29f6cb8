# Copyright 2026 telescope_mount developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Scenario files: errors of the simulated mount, as YAML.

Only the simulator reads them. Keys that a file does not contain have the value of the scenario it
is ``based_on``, or else the ideal value of `scenario`.
"""

import dataclasses
from difflib import get_close_matches
from importlib import resources
from pathlib import Path

import yaml

from msg_tools.units import DEG
from pointing_model.mount_kinds import KINDS, USUAL
from pointing_model.mounts import parse_mount

from .field_kinds import in_si
from .mount_geometry import MountErrors
from .scenario import Scenario

_ALTAZ = KINDS[USUAL]
_FOLDER = resources.files('encoder_sim') / 'scenarios'


def _key(item, names):
    """Key of a field in the file of a mount with `names`.

    Drifts are named after their cause, which follows from the unit; terms and axes have the
    mount's own names.
    """
    unit, name = item.metadata.get('unit'), item.name
    if 'term' in item.metadata:
        name = names.named(item.metadata['term']).lower() + name[len(item.metadata['term']):]
    for word, own in zip(_ALTAZ.keys, names.keys):
        name = name.replace(word, own)
    name = name.rpartition('_')[0] if unit and '_per_' in unit else name
    return f'{name}_{unit}' if unit else name


def _items(cls, names):
    """Key -> field of a section, for a mount with `names`."""
    return {_key(item, names): item for item in dataclasses.fields(cls) if item.metadata
            and not (item.metadata.get('pier_only') and not names.celestial)}


def _unknown(key, cls, names, where):
    """Error text for a key that a section does not have."""
    items = _items(cls, names)
    for other in KINDS.values():
        item = _items(cls, other).get(key)
        if item is not None:
            own = next((k for k, i in items.items() if i.name == item.name), None)
            return (f'{where}: {key!r} is of another mount than this one, whose axes are '
                    f'{" and ".join(names.axes)}' + (f'; write {own!r}' if own else ''))
    return f'{where}: unknown key {key!r}; allowed: {", ".join(items)}'


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


def _to_value(value, item, where, base, names):
    if 'choice' in item.metadata:
        if value not in item.metadata['choice']:
            names = ', '.join(item.metadata['choice'])
            raise ValueError(f'{where}: {value!r} is not one of {names}')
        return value
    if 'text' in item.metadata:
        return _to_text(value, item, where)
    if 'section' in item.metadata:
        if value is None and item.default is None:
            return None
        return _to_section(value, item.metadata['section'], where, base, names)
    if 'sections' in item.metadata:
        if not isinstance(value, list):
            raise ValueError(f'{where}: {value!r} is not a list')
        cls = item.metadata['sections']
        return tuple(
            _to_section(v, cls, f'{where}[{i}]', None, names) for i, v in enumerate(value))
    if item.metadata['kind'] is list:
        if not isinstance(value, list):
            raise ValueError(f'{where}: {value!r} is not a list of numbers')
        return tuple(_to_number(v, item, f'{where}[{i}]') for i, v in enumerate(value))
    value = _to_number(value, item, where)
    if 'term' in item.metadata:
        value *= names.terms[names.named(item.metadata['term'])][1]
    return value


def _to_text(value, item, where):
    if not isinstance(value, str):
        raise ValueError(f'{where}: {value!r} is not a text')
    try:
        item.metadata['text'](value)
    except ValueError as err:
        raise ValueError(f'{where}: {err}') from None
    return value


def _to_section(mapping, cls, where, base, names):
    """An instance of `cls`: `base` changed by a mapping of the file of a mount with `names`."""
    if not isinstance(mapping, dict):
        raise ValueError(f'{where}: {mapping!r} is not a mapping of keys to values')
    items = _items(cls, names)
    base = cls() if base is None else base
    changes = {}
    for key, value in mapping.items():
        if key not in items:
            raise ValueError(_unknown(key, cls, names, where))
        item = items[key]
        inside = f'{where}, {key}' if where.count(',') == 0 else f'{where}.{key}'
        changes[item.name] = _to_value(value, item, inside, getattr(base, item.name), names)
    return dataclasses.replace(base, **changes)


def _drop_description(mapping, file):
    """Remove ``undeclared``, a description of the scenario for people."""
    truth = mapping.pop('undeclared', {'what': ''})
    if not (isinstance(truth, dict) and isinstance(truth.get('what'), str)
            and set(truth) <= {'what', 'shows_as'}):
        raise ValueError(f'scenario {file}, undeclared: {truth!r} is not a mapping of what: a text '
                         'and shows_as: names of effects')


def scenario_names():
    """Names of the scenarios in the package."""
    return sorted(f.name[:-5] for f in _FOLDER.iterdir() if f.name.endswith('.yaml'))


def described_scenarios():
    """A sentence about each scenario of the package, by its name.

    Returns
    -------
    dict of str to str
    """
    out = {}
    for name in scenario_names():
        text = (_FOLDER / f'{name}.yaml').read_text(encoding='utf-8')
        what = (_parsed(text, own=True) or {}).get('undeclared', {}).get('what', '')
        if what in ('', 'nothing'):  # use the comment at the top
            lines = text.splitlines()
            count = next((i for i, line in enumerate(lines) if line[:1] != '#'), len(lines))
            what = ' '.join(line.strip('# ') for line in lines[:count]).partition('. ')[0]
        out[name] = ' '.join(what.split())
    return out


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
        No such scenario, invalid YAML, an unknown key, a wrong type, or a value out of range: one
        line with the file, the key and the allowed values.
    """
    scenario, chain = Scenario(), _chain(str(name_or_path))
    for _, file, _, mapping in reversed(chain):
        scenario = _on_its_mount(scenario, mapping, file)
        names = scenario.mount.names
        scenario = _to_section(mapping, Scenario, f'scenario {file}', scenario, names)
        for axis, own in zip(_ALTAZ.keys, names.keys):
            limits = getattr(scenario.axes, axis)
            if limits.travel_min >= limits.travel_max:
                raise ValueError(f'scenario {file}, axes.{own}: travel_min_deg must be below '
                                 'travel_max_deg')
    if not scenario.mount.at().vertical:
        _check_marks(scenario, chain[0][1])
    return dataclasses.replace(scenario, name=chain[0][0])


def _on_its_mount(scenario, mapping, file):
    """The scenario that a file is based on, converted to the file's kind of mount.

    The kind determines the names of the keys. From a scenario of another kind, instruments and
    weather are kept, but not the errors of the mount and its travel.
    """
    section = mapping.get('mount') if isinstance(mapping, dict) else None
    if not isinstance(section, dict) or 'kind' not in section:
        return scenario
    kind = _to_text(section['kind'], MountErrors.__dataclass_fields__['kind'],
                    f'scenario {file}, mount.kind')
    mount = parse_mount(kind, 0.0)
    section['kind'] = kind = kind.strip().lower() if ':' in kind else mount.kind
    return scenario if kind == scenario.mount.kind else scenario.on_mount(kind)


def _check_marks(scenario, file):
    """Refuse reference marks that homing cannot pass."""
    for axis, own in zip(_ALTAZ.keys, scenario.mount.names.keys):
        limits, encoder = getattr(scenario.axes, axis), getattr(scenario.incremental, axis)
        mark, reach = encoder.mark_angle, 2.0 * DEG
        if not limits.travel_min + reach <= mark <= limits.travel_max - reach:
            raise ValueError(
                f'scenario {file}, incremental.{own}: mark_angle_deg {mark / DEG:g} must lie in '
                f'the travel of the axis, {limits.travel_min / DEG:g} to '
                f'{limits.travel_max / DEG:g}, and 2 from its ends')


def scenario_files(name_or_path='default'):
    """Texts of a scenario's files, for later readers.

    Parameters
    ----------
    name_or_path : str or Path
        See `load_scenario`, also for errors.

    Returns
    -------
    list of dict
        ``name`` and ``text`` of the scenario, then of each one that it is based on.
    """
    return [{'name': name, 'text': text} for name, _, text, _ in _chain(str(name_or_path))]


def undeclared(text):
    """Undeclared effects of a scenario.

    Parameters
    ----------
    text : str
        Text of the scenario's file.

    Returns
    -------
    dict or None
        ``what`` (a text) and ``shows_as`` (beginnings of names of effects; empty: no effect, None:
        not specified); None if the scenario has no such section.
    """
    truth = (yaml.safe_load(text) or {}).get('undeclared')
    return {'what': truth['what'], 'shows_as': truth.get('shows_as')} if truth else None


def _is_name(text):
    """Whether the text is the name of a scenario in the package, not a file."""
    return Path(text).suffix not in ('.yaml', '.yml')


def _parsed(text, own):
    """YAML of a scenario. For the package's `own` files libyaml is used, which is ten times
    faster, but crashes on deeply nested files of users.
    """
    return yaml.load(text, getattr(yaml, 'CSafeLoader', yaml.SafeLoader) if own
                     else yaml.SafeLoader)


def _read(text):
    """Name, file name for people, and content of a scenario."""
    path = Path(text)
    if not _is_name(text):
        if not path.is_file():
            raise ValueError(f'scenario file {text} does not exist')
        return path.stem, text, path.read_text(encoding='utf-8')
    if text not in scenario_names():
        near = get_close_matches(text, scenario_names(), 1)
        hint = f'did you mean {near[0]}?' if near else 'give a .yaml file or a name'
        raise ValueError(f'no scenario {text!r}; {hint} (telescope-mount night --scenario list '
                         'prints all)')
    file = f'{text}.yaml'
    return text, file, (_FOLDER / file).read_text(encoding='utf-8')


def _chain(text):
    """(name, file, content, mapping) of a scenario, then of each one that it is based on."""

    out, visited = [], []
    while text is not None:
        if text in visited:
            raise ValueError(f'scenario {text}: based on itself')
        visited.append(text)
        name, file, content = _read(text)
        try:
            mapping = _parsed(content, own=_is_name(text))
        except (yaml.YAMLError, RecursionError) as error:
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
