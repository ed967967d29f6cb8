"""Parameters that the nodes of the bridge share."""

from msg_tools.node import Param

from . import PORT

SERVER_PARAMS = (
    Param('host', 'localhost', 'where the Alpaca server runs', fixed=True),
    Param('port', PORT, 'its port', 1, 65535, fixed=True),
    Param('number', 0, 'of the telescope on the server', 0, 255, fixed=True),
)
