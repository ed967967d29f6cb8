"""Parameters that the nodes of the bridge share."""

from msg_tools.node import Param

from . import PORT

SERVER_PARAMS = (
    Param('host', 'localhost', 'where the INDI server runs', fixed=True),
    Param('port', PORT, 'its port', 1, 65535, fixed=True),
    Param('device', '', 'name of the telescope there; empty: the only one', fixed=True),
    Param('axes', '', 'property of the driver with the axis angles and its two elements, in '
          'degrees, NAME:FIRST,SECOND; empty: MOUNT_AXES', fixed=True),
)
