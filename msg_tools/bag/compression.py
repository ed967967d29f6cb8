"""How the chunks of a log are compressed, and unpacked, whatever a damaged or hostile file says."""

import lz4.frame
import zstandard

#: by the name that a parameter gives; 'none' is '' in the file
COMPRESSORS = {'zstd': zstandard.ZstdCompressor(level=1).compress, 'lz4': lz4.frame.compress,
               'none': bytes}
DEFAULT_COMPRESSION = 'zstd'
#: a chunk that claims more than this is not believed (the usual size is 1 MiB)
MAX_CHUNK = 128 * 2**20


def decompress(data, compression, size):
    """At most `size` bytes of `data`; fewer where it was cut."""
    if size > MAX_CHUNK:
        raise ValueError(f'a chunk claims {size} bytes, more than {MAX_CHUNK}')
    if compression == '':
        return bytes(data[:size])
    try:
        if compression == 'zstd':
            decompressor = zstandard.ZstdDecompressor(max_window_size=2**27)
            with decompressor.stream_reader(data) as stream:
                return stream.read(size)
        if compression == 'lz4':
            return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise ValueError(f'{compression} data damaged: {error}') from None
    raise ValueError(f'chunk compression {compression!r} is unknown')
