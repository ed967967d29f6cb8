"""Words for what effects have: their coefficients, and the shape that several share."""

from .base import the

#: names of coefficients in words, where they are no words
_COEFFICIENTS = {'half_difference': 'half the difference',
                 'hour_angle': 'hour angle', 'el_cos': 'up and down, cos',
                 'el_sin': 'up and down, sin', 'az_cos': 'left and right, cos',
                 'az_sin': 'left and right, sin'}


def coefficient_word(effect, name):
    """A coefficient of an effect for people."""
    if effect.kind != 'smooth':
        return _COEFFICIENTS.get(name, name)
    shape, number = effect.parameters.get('shape'), int(name[1:])
    if shape != 'fourier':
        return {'sawtooth': 'height of a tooth', 'bump': 'height'}.get(shape, f'part {number}')
    order = effect.parameters['orders'][(number - 1) // 2]
    return f'{("sin", "cos")[number % 2]}, {order:g} per period'


def common_shape(shapes, drivers):
    """What shapes have in common, up to where they differ; else that they follow their drivers.

    Parameters
    ----------
    shapes : sequence of str
    drivers : sequence of str
        What each follows, the best first.

    Returns
    -------
    str
    """
    parts = []
    for same in zip(*(shape.split(', ') for shape in shapes)):
        if len(set(same)) > 1:
            break
        parts.append(same[0])
    followed = [f'of {the(driver)}' for driver in dict.fromkeys(drivers)]
    return ', '.join(filter(None, parts)) or 'a curve ' + ', '.join(
        [', '.join(followed[:-1])] * (len(followed) > 1)) + ' or ' * (
            len(followed) > 1) + followed[-1]
