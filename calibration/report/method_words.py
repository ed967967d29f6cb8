"""The way of a diagnosis, what would tell causes apart, words of the page."""

import numpy as np

from calibration.analysis.diagnosis.readings import MIRRORED, Reading, without_signs
from calibration.estimation.select import SET_WIDTH
from pointing_model.effects.base import arcsec, readable
from pointing_model.mount_kinds import KINDS, USUAL, kind_of

from .cause_words import counted, open_causes, short_cause, still_open
from .row_wording import columns_alike

#: what was taken for the catalogue and for the mount, by the format of the file
_AS_NAMED = 'the columns were taken as the file names them'
_TAKEN = {
    'tpoint': 'the columns were taken as this format has them, which does not name them: of each '
              'row first the catalogue (where it has no right ascensions the observed place, '
              'refraction in it), then the mount',
    'iram': 'the pointing offsets of the log were taken as what the mount reads too much',
    'gpoint': 'the columns were taken as this format has them',
    'mountwizzard4': 'the keys were taken as this format has them',
    'mmt': 'RAA, with the refraction in it, was taken for the catalogue and TAA for the mount',
    'unam': 'the columns were taken as this format has them',
    'images': 'the keywords were taken as the mapping names them'}
#: why hours are told with a place
WHY_LATER = ' (something in one of the explanations changes with time)'
_MOST_OTHERS = 3  # effects chosen instead that are named
_LEVEL = np.sin(np.radians(0.5))  # of a counterweight that is called up
#: the model stays as it was
STAYS = ('none', 'wanders', 'undecided', 'refused', 'withheld', 'taken_back')


#: on what a figure is judged
HELD, LEFT_OUT, FITTED = 'on rows held out', 'on rows left out', 'on the rows fitted'
STRETCHES = 'on stretches of rows left out'


def model_words(document, whose=True):
    """The declared terms: "the seven terms of an alt-azimuth mount".

    Parameters
    ----------
    document : dict
    whose : bool
        With the mount that they are of.
    """
    terms = list(document.get('base_terms') or ())
    kind = kind_of(document)
    of = f' of {kind.words}' if whose else ''
    if not terms:
        return 'no terms'
    if terms == list(kind.index):
        return f'the zeros{of}'
    usual = 'the usual ' if terms == list(kind.standard6) else 'the '
    if usual == 'the ' and terms != list(kind.physical):
        return f'the {counted(len(terms), "declared term")}'
    return f'{usual}{counted(len(terms), "term")}{of}'


def plain_name(name, kind):
    """`readable`, with what a kind of mount has: the first axis of a German one carries no fork."""
    return readable(name.replace('fork', 'saddle') if KINDS[kind].carrier == 'saddle' else name)


def way(document):
    """From what the encoders read, over the terms, to the effects: RMS on the sky.

    Parameters
    ----------
    document : dict
        `Diagnosis.to_dict()`.

    Returns
    -------
    str
        '' where it is not known what the encoders read.
    """
    read = document.get('as_read_rms_arcsec')
    if read is None or document['verdict'] == 'refused':
        return ''
    before, after, label = steps(document)
    if before is None:
        return ''
    effects = len(document['effects'])
    text = (f'RMS on the sky: {way_size(read)} as the encoders read, {way_size(before)} with '
            f'{model_words(document)}')
    if effects and document['verdict'] not in STAYS:
        text += f', {way_size(after)} with {counted(effects, "effect")} more'
    return f'{text}; the terms judged {label}.'


def best_pair(document, held=True):
    """The most honest pair of errors there is: held out, else cross-validated, else fitted.

    Where neighbouring rows err alike those left out at random have told of themselves by their
    neighbours: stretches of time left out have not, and are taken if they are missed by more.

    Parameters
    ----------
    document : dict
    held : bool
        Whether runs held out count.

    Returns
    -------
    label : str
    before, after : float or None
        Radial RMS on the sky, arcsec.
    """
    apart, wander = document.get('cv_contiguous') or {}, document.get('wander') or {}
    for key, label in (('holdout_rms_arcsec', HELD),
                       ('cv_rms_arcsec', LEFT_OUT),
                       ('rms_arcsec', FITTED)):
        pair = document['before'].get(key), document['after'].get(key)
        if None in pair or (label == HELD and not held):
            continue
        if label == LEFT_OUT and wander.get('slow') and apart.get('after', 0.0) > pair[1]:
            return STRETCHES, apart['before'], apart['after']
        return label, *pair
    return FITTED, None, None


def steps(document):
    """RMS with the terms and with the effects as `way` tells them, and on what: three values."""
    label, *pair = best_pair(document, held=False)
    return *pair, label


def way_size(value):
    """An RMS as `way` writes it."""
    return f'{value:.{0 if value >= 999.5 else 1}f}″' if value >= 9.995 else arcsec(value)


def causes_of(document):
    """Name of an effect -> the cause that it stands for, in words, dict."""
    return {name: one['cause'] for row in document['effects']
            for one in (*still_open(row), *(row.get('causes') or ())) for name in one['effects']}


def proposals(document):
    """Proposed observations that tell causes apart which people are told as two."""
    told = causes_of(document)
    return [item for item in document.get('next_observations') or []
            if len({told.get(name, name) for name in item['separates']}) > 1]


def serves_sentence(document):
    """Whom the proposals do not serve, where that is the largest effect; '' elsewhere."""
    rows = [row for row in document['effects'] if row.get('causes')]
    serves = {item['separates'][0] for item in proposals(document)}
    largest = max(rows, key=lambda row: row.get('removes_rms_arcsec') or 0.0, default=None)
    if not serves or largest is None or largest['name'] in serves:
        return ''
    kind = document.get('mount') or USUAL
    open_ = open_causes(largest) > 1
    return (f'These serve the smaller effects alone. Of the largest, '
            f'{plain_name(largest["name"], kind)} ({arcsec(largest["removes_rms_arcsec"])} RMS on '
            'the sky), they tell nothing: ' + (
                'no observation tells its causes apart, so look at the mount.' if open_ else
                'one cause was left for it, which only a look at the mount can test.'))


def repeat_sentence(document):
    """In how many of the choices repeated all of the effects were found and no other.

    Returns
    -------
    str
        '' where it is not known.
    """
    spread = document['after'].get('cv_spread') or {}
    folds, count = spread.get('folds'), len(document['effects'])
    if not folds or document['verdict'] in STAYS or not count or 'same_choice' not in spread:
        return ''
    what = 'this effect' if count == 1 else f'these {counted(count, "effect")}'
    same, chosen = spread['same_choice'], spread.get('chosen') or {}
    any_ = spread.get('chosen_set') or chosen
    if spread.get('same_set', same) > same or sum(any_.values()) > sum(chosen.values()):
        what, same, chosen = f'{what}, by one or another of the causes,', spread['same_set'], any_
    often = f'{same} of {folds} times' if same else f'in none of {folds} times'
    text = (f'With a part of the rows left out, {what} and no other '
            f'{"were" if count > 1 else "was"} found {often}')
    if count > 1 and chosen:
        largest = max(document['effects'], key=lambda row: row.get('removes_rms_arcsec') or 0.0)
        if largest['name'] in chosen:
            text += f', the largest {chosen[largest["name"]]} times'
    return f'{text}.'


def no_star_sentences(document, but=None):
    """A sentence for each effect, but for one, of which no observation tells the causes apart."""
    told = causes_of(document)
    return [_no_star(told.get(one, one), _either(others, told))
            for one, *others in document.get('no_star') or [] if one != but]


def _no_star(one, others):
    return (f'No star tells {one} from {others}: on the whole sky they look alike, so look at the '
            'mount.')


def _either(names, told):
    """Causes, each once: a; b or c."""
    causes = list(dict.fromkeys(told.get(name, name) for name in names))
    return ' or '.join(filter(None, ['; '.join(causes[:-1]), causes[-1]]))


def next_sentence(document, row):
    """Which observation would tell the causes of an effect apart, or that none would.

    Parameters
    ----------
    document : dict
    row : dict
        Of its effects.

    Returns
    -------
    str
        '' where it has one cause.
    """
    if open_causes(row) < 2:
        return ''
    told = {name: one['cause'] for one in (*row['causes'], *still_open(row))
            for name in one['effects']}
    mine = [item for item in proposals(document) if item['separates'][0] == row['name']]
    if mine:
        kind = document.get('mount') or USUAL
        both = [told[row['name']], told.get(mine[0]['separates'][1], 'the next')]
        if len({short_cause(one) for one in both}) > 1:
            both = [short_cause(one) for one in both]
        return (f'To tell {" from ".join(both)}, observe first '
                f'{place_words(mine[0], kind)}{WHY_LATER * bool(mine[0].get("after_hours"))}; '
                f'{enough(mine)}.')
    for one, *others in document.get('no_star') or []:
        if one == row['name']:
            rest = {told.get(name) for name in others} >= set(told.values()) - {told[one]}
            # each was tried against the best, not against each other
            last = ('the other' + 's' * (open_causes(row) > 2)) if rest else _either(others, told)
            return _no_star(told[one], last)
    return ''


def enough(items):
    """What some observations for one pair would bring, and whether that is enough."""
    before, after = items[0]['separation_before'], items[-1]['separation_after']
    text = f'the evidence between them (ΔBIC), {before:.1f} now, would be {after:.1f} with ' + (
        'it' if len(items) == 1 else f'{len(items)} such observations')
    return text + ('' if after >= SET_WIDTH else
                   f', still below {SET_WIDTH:g}: more of them are needed')


def _degrees(value):
    return f'{int(round(value))}°'.replace('-', '−')


def counterweight_up(item, kind):
    """Whether the counterweight of a German mount is above level at a proposed observation."""
    return bool(KINDS[kind].two_sided and 'ha_deg' in item
                and np.sin(np.radians(item['ha_deg'])) < -_LEVEL)


def spread_sentence(document):
    """How far the figure of rows left out depends on which are; '' where that is not known."""
    spread = document['after'].get('cv_spread') or {}
    if spread.get('partitions', 0) < 2:
        return ''
    return (f'Rows left out: the mean of {spread["partitions"]} ways to leave them out, after from '
            f'{arcsec(spread["min_arcsec"])} to {arcsec(spread["max_arcsec"])}.')


def choice_sentence(document):
    """How often the same effects were chosen where rows were left out; '' where it is not known.

    Parameters
    ----------
    document : dict

    Returns
    -------
    str
    """
    spread = document['after'].get('cv_spread') or {}
    folds = spread.get('folds')
    if not folds or document['verdict'] in STAYS or not document['effects']:
        return ''
    kind = document.get('mount') or USUAL
    own, others = ([f'{plain_name(name, kind)} {_times(count, folds)}' for name, count in
                    sorted(spread.get(key, {}).items(), key=lambda one: -one[1])]
                   for key in ('chosen', 'others'))
    text = (f'With a part of the rows left out the choice was repeated {folds} times. Of what was '
            f'found it had {"; ".join(own)}')
    if len(own) > 1:
        text += f'; all of it and nothing else {_times(spread["same_choice"], folds)}'
    if others:
        more = f'; and {len(others) - _MOST_OTHERS} more' if len(others) > _MOST_OTHERS else ''
        text += f'. Of other effects it had {"; ".join(others[:_MOST_OTHERS])}{more}'
    if spread.get('no_choice'):
        text += f'. It had no effect at all {_times(spread["no_choice"], folds)}'
    return f'{text}.'


def _times(number, of):
    return 'each time' if number == of else {0: 'never', 1: 'once', 2: 'twice'}.get(
        number, f'{number} times')


def place_words(item, kind=USUAL):
    """A proposed observation in words.

    Parameters
    ----------
    item : dict
        As of `calibration.analysis.diagnosis.next_observations.propose`.
    kind : str
        Of `pointing_model.mounts.KINDS`.

    Returns
    -------
    str
    """
    names = KINDS[kind]
    place = f'azimuth {_degrees(item["az_deg"])}, elevation {_degrees(item["el_deg"])}'
    keys = [f'{column}_deg' for column in names.columns]
    if keys[0] != 'az_deg' and keys[0] in item:
        own = (f'{axis} {_degrees(item[key])}' for axis, key in zip(names.axes, keys))
        place = f'{", ".join(own)} ({place})'
    sides = [{-1: f'{axis} falling', 1: f'{axis} rising'}[item[key]]
             for key, axis in zip(('approach_az', 'approach_el'), names.axes) if item.get(key)]
    if item.get('through_pole'):
        place += ', through the pole'
    if counterweight_up(item, kind):
        place += ', counterweight up (only if your mount may)'
    if sides:
        place += ', approached with ' + ' and '.join(sides)
    if item.get('last_move_deg'):
        place += f' by a last move back of {item["last_move_deg"]:g}°'
    if item.get('after_hours'):
        place += f', {item["after_hours"]:g} h after the last row'
        if item.get('utc'):
            place += f' ({"next night, " * item["next_night"]}{item["utc"]} UTC)'
    return place


#: words of pages and tables, and what they mean; docs/glossary.md has them too
WORDS = {
    'sawtooth': 'it grows evenly, falls back at once, and begins again, a period apart',
    'memory': 'after a reversal the new side is reached little by little: 63 % of the way after '
              'so many degrees of motion',
    'RMS': 'root of the mean of the squares: about two of three stars are nearer than this',
    'RMS on the sky': 'of an effect: what it adds to the error of the stars beyond what the terms '
                      'could take up, which is the residual that it leaves if it is not in the '
                      'model. Several add up as squares do',
    'equally well': 'their evidence differs by less than 6 in ΔBIC, so the rows do not rank them',
    'smooth curve': 'a line without corners through what is left, where no cause is known',
    'wave': 'a sine, which rises and falls once a period',
    'bump': 'it is off at one place and little elsewhere',
    'wanders': 'the error moves slowly, so that neighbouring rows err alike, and nothing that was '
               'recorded moves with it',
    'from lowest to highest': 'of an effect: over the rows of this run, beyond what the terms '
                              'could take up, on the axis where that is larger',
    'stretches of rows left out': 'neighbours in time are left out together, so that none of them '
                                  'tells of the others',
    'ΔBIC': 'how much better an effect explains the rows than its coefficients cost; 6 is strong '
            'evidence',
    'noise floor': 'what is left on the rows fitted, made larger for the coefficients that were '
                   'fitted: seeing, and all that nothing here describes',
    'rows held out': 'runs that were kept aside altogether, such as other nights',
    'rows left out': 'rows that neither the fit nor the choice of effects has seen: '
                     'cross-validation',
    'line of sight': 'where the tube looks: it swings where what holds the tube bends or turns, '
                     'and no encoder is wrong then',
    'nods': 'the tube goes up and down as the mount turns, and no encoder is wrong',
    'hysteresis': 'the reading depends on the side from which the star was reached',
}


def explained(text):
    """Of `WORDS` those that are in a text: list of (word, what it means)."""
    low = text.lower()
    return [(word, meaning) for word, meaning in WORDS.items() if word.lower() in low]


def signs_sentences(alike, names, written=None):
    """What no fit can see of the columns, in words of what it means.

    Parameters
    ----------
    alike : sequence of str
        `Diagnosis.columns_alike`.
    names : mount_kinds.MountKind
    written : str, optional
        Format of the file, as ``meta['format']`` of its run.

    Returns
    -------
    list of str
    """
    said, mirrored = [], MIRRORED.text(names=names)
    mirror = f', or {mirrored}' if mirrored in alike else ''
    if Reading(exchanged=True).text() in alike or mirror:
        said.append(f'signs: {_TAKEN.get(written, _AS_NAMED)}, and fit so; positive is '
                    'an encoder that reads too much. Signs alone no run can confirm: they are '
                    f'right unless mount and catalogue are exchanged in the file{mirror}')
    rest = without_signs(alike, names)
    return said + [columns_alike(rest)] * bool(rest)
