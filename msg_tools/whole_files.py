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

"""Files that are written completely or not at all: to a temporary file, then renamed."""

import errno
import os
import shutil
from contextlib import contextmanager, suppress
from pathlib import Path

#: advice for the user on errors of a disk or a file system
_ADVICE = {
    errno.ENOSPC: 'No space left on device; free some, or write elsewhere',
    errno.EDQUOT: 'Disk quota exceeded; free some, or write elsewhere',
    errno.EFBIG: 'File too large; the limit is that of this shell (ulimit -f) or of the disk',
    errno.EACCES: 'Permission denied; have its rights changed, or take another',
    errno.EROFS: 'Read-only file system; write elsewhere',
}


def reason(error):
    """Why a file cannot be read or written, and what to do, for an OSError."""
    return _ADVICE.get(error.errno, error.strerror) or ' '.join(str(error).split())


@contextmanager
def beside(path):
    """A temporary path to write to, which replaces `path` at the end.

    If writing fails, an old file at `path` stays, and the temporary file is removed. Anything but
    a regular file (``/dev/stdout``, a pipe) is written directly.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    OSError
        It cannot be written; `path` is its file name.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        yield path
        return
    place = Path(os.path.realpath(path))  # a link remains a link
    part = place.with_name(f'.{place.name}.{os.getpid()}.part')
    try:
        yield part
        with open(part, 'rb+') as file:
            os.fsync(file.fileno())  # some disks report errors only here
        if place.exists():
            shutil.copymode(place, part)
        os.replace(part, place)
    except BaseException as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename in (None, str(part)):
            error.filename = str(path)
        raise


def write_text(path, text):
    """Write a text file (UTF-8) completely or not at all; OSError as in `beside`."""
    with beside(path) as part:
        part.write_text(text, encoding='utf-8')


def tried(incomplete, path, write):
    """Write one of several outputs; continue without it if it cannot be written.

    Parameters
    ----------
    incomplete : list of str
        Gets a line with the path and the reason on failure.
    path : Path
    write : callable
        ``write(path)``.
    """
    try:
        write(path)
    except OSError as error:
        incomplete.append(f'{path}: {reason(error)}')
