"""Bridge to mounts of an ASCOM Alpaca server, on the same base as that to INDI."""

#: of a server, by custom
PORT = 11111
