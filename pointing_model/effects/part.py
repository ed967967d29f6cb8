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

"""Single coefficients of an effect, as in stored models that were selected for prediction."""

from .base import Effect, effect_from_document, form


@form
def _part(of, keep):
    """An effect (its document) with the coefficients at the indices `keep` only."""
    whole = effect_from_document(of)
    names = tuple(whole.coefficient_names[i] for i in keep)
    tpoint = (whole.tpoint or '').split()
    tpoint = ' '.join(tpoint[i] for i in keep) if len(tpoint) == len(whole.coefficient_names) \
        else None

    return Effect(f'{whole.name}_{"_".join(names)}', f'{whole.cause} ({", ".join(names)} only)',
                  whole.formula, whole.driver, whole.axes, names,
                  lambda c: [tuple(column) for column in whole.columns(c)[list(keep)]],
                  look_at=whole.look_at, shape=whole.shape, unit=whole.unit, tpoint=tpoint,
                  requires=whole.requires, kind=whole.kind, effort=whole.effort)
