"""Bridge to mounts that an INDI server drives: protocol and numerics without ROS, thin nodes."""

#: of a server, as INDI has registered it
PORT = 7624


def parse_address(text):
    """Host and port of ``indi:HOST[:PORT]``.

    Parameters
    ----------
    text : str

    Returns
    -------
    host : str
    port : int

    Raises
    ------
    ValueError
        It is no such address.
    """
    kind, _, rest = text.partition(':')
    host, _, port = rest.partition(':')
    port = port or str(PORT)
    if kind != 'indi' or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ValueError(f'{text!r} is no INDI server; write indi:HOST or indi:HOST:PORT, for '
                         f'instance indi:localhost:{PORT}')
    return host, int(port)
