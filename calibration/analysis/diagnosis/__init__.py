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

"""What a declared model lacks: candidates, their scores, chance, cross-validation, the verdict."""

from importlib import import_module

_PLACES = {'Base': 'base_terms', 'DiagnosedEffect': 'effect_causes',
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
