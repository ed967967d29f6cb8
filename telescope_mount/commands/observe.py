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

"""The command ``observe``."""

from pathlib import Path

from . import options

#: see `telescope_mount.missing_ros`
NEEDS_ROS = True


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'observe', help='observe with the drivers of a real mount',
        description='Start the nodes beside drivers (docs/real_mount.md), observe stars, fit the '
        'pointing model, check it on fresh stars, log everything. Print the error before and '
        'after. It runs in real time.')
    options.add_out(parser, 'observed', 'log, model, observations and page')
    parser.add_argument('--driver', type=Path, action='append', default=[], metavar='FILE',
                        help='a driver in Python to start as well, again for each; those that run '
                        'already are found')
    parser.add_argument('--stars', type=options.whole(4, 5000),
                        default=options.Default('telescope_mount.observing.plan.BLOCK_STARS'),
                        help='to fit the model to; a quarter as many check it '
                        '(default: %(default)s)')
    parser.add_argument('--plan', default='', help="steps in place of 'home, stars N, clocks 24, "
                        "fit, check N/4'")
    options.add(parser, 'mount', default='altaz', help=options.MOUNT_OF_DRIVERS)
    options.add(parser, 'latitude', 'longitude', 'height')
    parser.add_argument('--absolute-encoder', action='store_true',
                        help='a driver publishes absolute/joint_states')
    parser.add_argument('--inclinometer', action='store_true',
                        help='a driver publishes inclinometer, a sensor of the adaptive model')
    parser.add_argument('--exposure', type=options.real(0.0, 3600.0, 's'), default=0.0, metavar='S',
                        help='exposure time of the camera, during which the mount must track '
                        'steadily (default 0: checked at mid-exposure)')
    parser.add_argument('--anew', action='store_true', help='restart the interrupted night in '
                        '--out (default: resume it where it stopped)')
    options.add(parser, 'reference', help='model.json to begin with')
    options.add(parser, 'params', help='ROS parameter file, read by every node and driver')
    options.add(parser, 'domain', help=options.RUNNING_DOMAIN)
    options.add_verbose(parser, 'tables and notes')
    options.add_json(parser, 'the report')


def run(args):
    """Observe, print, write."""
    from ..nights.real_night import run_real_night
    from ..observing.plan import BLOCK_STARS
    from .console import ProgressLine, end_of_night, hold_up_lines, new_console, print_calibration
    if args.plan:
        options.refuse(args, 'applies without --plan; leave it out', stars=BLOCK_STARS)
    console = new_console()
    with ProgressLine(console, every=30.0) as progress:
        report = run_real_night(
            args.out, plan=args.plan, stars=args.stars, drivers=args.driver, mount=args.mount,
            sky=options.sky_of(args), absolute_encoder=args.absolute_encoder,
            inclinometer=args.inclinometer, exposure=args.exposure, anew=args.anew,
            reference=args.reference, domain_number=args.domain, params_file=args.params,
            progress=progress, hold_up=hold_up_lines(console),
            note=console.print)
    print_calibration(console, report, args.verbose, len(report['files']))
    return end_of_night(console, args.json, report)
