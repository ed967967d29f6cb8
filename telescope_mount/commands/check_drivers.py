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

"""The command ``check-drivers``."""

from . import options

#: see `telescope_mount.missing_ros`
NEEDS_ROS = True


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'check-drivers', help='listen to the drivers of a mount and say what is wrong with them',
        description='Listen to a running graph and judge its drivers by the contract '
        '(docs/real_mount.md), line by line. Exit code 0 where nothing is wrong, else 1.')
    parser.add_argument('--seconds', type=options.real(2.0, 3600.0, 's'), default=60.0,
                        metavar='S', help='how long to listen (default: 60)')
    parser.add_argument('--nudge', type=options.real(0.01, 2.0, 'degrees'), nargs='?', default=0.0,
                        const=options.Default('telescope_mount.drivers.nudge.STEP_DEG'),
                        metavar='DEG', help='MOVES the mount: each axis by so much '
                        '(%(const)s if left out) and back, to check motion and camera. Only if '
                        'nothing else is wrong and nobody else commands it')
    parser.add_argument('--star', action='store_true',
                        help='with --nudge: SLEWS to a bright star first (--latitude, --longitude) '
                        'and nudges beside it, to judge the camera')
    parser.add_argument('--home', action='store_true',
                        help='MOVES the mount: call its service home first')
    options.add(parser, 'mount', default='altaz', help=options.MOUNT_OF_DRIVERS)
    options.add(parser, 'latitude', 'longitude', 'height')
    options.add(parser, 'params', help='ROS parameter file with the limits of the mount, for '
                'the guard that --nudge starts if none is running')
    options.add_json(parser, 'the findings')
    options.add_graph(parser)


def run(args):
    """Listen, print, write."""
    from msg_tools.units import DEG
    from pointing_model.mounts import parse_mount

    from ..drivers.listener import check_drivers
    from ..drivers.samples import WRONG
    from ..graph import NODES, NodeSpec
    from ..input_files import parameter_file
    from ..processes import domain
    from .console import new_console, print_all, write_json
    if args.star and not args.nudge:
        raise ValueError('--star needs --nudge: give both')
    sky = options.sky_of(args)
    mount = parse_mount(args.mount, sky.get('latitude_deg', 0.0) * DEG)
    console = new_console()
    guard = NodeSpec('mount_guard', NODES['mount_guard'], sky)
    print_all(console, parameter_file.check([guard], args.params, namespace=args.namespace))
    number = domain.join(args.domain).number
    findings = check_drivers(mount, number, args.namespace, args.seconds, args.nudge * DEG,
                             args.home, sky, args.params, args.star)
    print_all(console, (f'{level:<6} {of}: {text}' for level, of, text in findings))
    wrong = sum(finding.level == WRONG for finding in findings)
    console.print(f'{wrong} wrong' if wrong else 'nothing wrong')
    if args.json is not None:
        write_json(args.json, [finding._asdict() for finding in findings])
    return int(wrong > 0)
