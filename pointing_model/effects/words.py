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


def common_shape(shapes, driver):
    """What shapes have in common, up to where they differ; else that they follow the driver."""
    parts = []
    for same in zip(*(shape.split(', ') for shape in shapes)):
        if len(set(same)) > 1:
            break
        parts.append(same[0])
    return ', '.join(filter(None, parts)) or f'a curve of {the(driver)}'
