"""Bridge to mounts that an INDI server drives: protocol and numerics without ROS, thin nodes."""

#: of a server, as INDI has registered it
PORT = 7624


def parse_address(text, protocol='indi', usual=PORT):
    """Host and port of ``indi:HOST[:PORT]``, or of another protocol.

    Parameters
    ----------
    text : str
    protocol : str
    usual : int
        Port where none is given.

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
    port = port or str(usual)
    if kind != protocol or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        name = {'indi': 'INDI', 'alpaca': 'Alpaca'}[protocol]
        raise ValueError(f'{text!r} is no {name} server; write {protocol}:HOST or '
                         f'{protocol}:HOST:PORT, for instance {protocol}:localhost:{usual}')
    return host, int(port)
