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

"""Programs whose models are read and written: one module each, which defines a `PROGRAM`.

It gives the program's terms, signs and units, what the program computes, and its file format.
``--to`` of `export` takes its name, which is that of the module.
"""

from importlib import import_module
from pkgutil import iter_modules

_MODULES = [import_module(f'.{module.name}', __name__) for module in iter_modules(__path__)]
#: name -> program, in the order in which a file is tested
PROGRAMS = {module.PROGRAM.name: module.PROGRAM for module in _MODULES
            if hasattr(module, 'PROGRAM')}
