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

"""Messages as Python objects, by the definitions that a log carries, whatever those say."""

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO

from .mcap_records import short

#: a definition, or a line, longer than this is no message definition
MAX_DEFINITION, MAX_LINE = 256 * 1024, 1000


class Decoders:
    """Decoders by schema.

    Parameters
    ----------
    skipped : Counter
        Takes a line for what cannot be decoded, and how often.
    """

    def __init__(self, skipped):
        self._skipped = skipped
        self._decoders = {}

    def decode(self, topic, schema, encoding, data):
        """The message, or None if it does not fit its schema."""
        key = (schema.name, schema.data) if schema else None
        if key not in self._decoders:
            self._decoders[key] = self._make(topic, schema, encoding)
        decoder = self._decoders[key]
        if decoder is None:
            self._skipped[f'{topic}: messages that cannot be decoded left out'] += 1
            return None
        try:
            return decoder(_Bounded(data))
        except Exception:  # foreign bytes fail in any way
            self._skipped[f'{topic}: a message that does not fit its schema left out'] += 1
            return None

    def _make(self, topic, schema, encoding):
        from mcap_ros2.decoder import DecoderFactory
        try:
            text = schema.data.decode() if schema is not None else ''
            if len(text) > MAX_DEFINITION or max(map(len, text.splitlines()), default=0) > MAX_LINE:
                raise ValueError(f'a definition of {len(text)} characters')
            # the parser prints what it does not like
            with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
                return DecoderFactory().decoder_for(encoding, schema)
        except Exception as error:  # the schema is foreign text
            self._skipped[f'{topic}: schema not understood ({short(error)})'] = 1
            return None


class _Bounded(bytes):
    """Bytes that refuse to be cut beyond their end.

    The decoder cuts strings and arrays out of a message without looking at how much is left, and
    so may go on for ever with an array of which no element takes a byte.
    """

    def __getitem__(self, key):
        if type(key) is slice and key.stop is not None and key.stop > len(self):
            raise ValueError('the message ends before its content')
        return super().__getitem__(key)
