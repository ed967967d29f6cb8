"""What a declared model lacks: candidates, their scores, chance, cross-validation, the verdict."""

from importlib import import_module

_PLACES = {'Base': 'diagnosis_base', 'DiagnosedEffect': 'diagnosis_result',
           'Diagnosis': 'diagnosis_result',
           'MistakenColumns': 'input_check', 'ColumnCheck': 'input_check',
           'check_columns': 'input_check', 'diagnose': 'diagnosis'}
__all__ = list(_PLACES)


def __getattr__(name):
    """What the package offers, when it is asked for: to count rows needs nothing of the search."""
    if name not in _PLACES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    found = getattr(import_module(f'.{_PLACES[name]}', __name__), name)
    globals()[name] = found
    return found
