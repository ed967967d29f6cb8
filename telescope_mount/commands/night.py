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

"""The command ``night``."""

from pathlib import Path

from . import options

#: see `telescope_mount.missing_ros`
NEEDS_ROS = True
SERVER_OF_NIGHT = ('; or indi:HOST[:PORT[:KIND]] or alpaca:HOST[:PORT[:KIND]]: a mount of an INDI '
                   'or Alpaca server in place of the simulated one, on the clock of this machine')


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'night', help='observe a simulated night through the whole node graph',
        description='Start every node as a process, observe stars, set the zero on Polaris (where '
        'it is low, on a few other stars). Fit the pointing model, log everything, '
        'print the error before and after.')
    options.add_out(parser, 'night', 'log, model, observations and page')
    options.add(parser, 'seed')
    parser.add_argument('--stars', type=options.whole(4, 5000),
                        default=options.Default('telescope_mount.observing.plan.BLOCK_STARS'),
                        help='in each of the two blocks (default: %(default)s)')
    options.add(parser, 'polaris')
    options.add_scenario(parser, default='default',
                        help='what is wrong with the simulated mount: a name or a YAML file; '
                        'list: print the names')
    options.add(parser, 'reference', help='model.json of an earlier night: the zero is the change '
                'since then, and tonight is one power-on: stars, zero, stars')
    parser.add_argument('--power-cycle', choices=('incremental', 'absolute', 'both'),
                        default='incremental', help='encoders that are power-cycled in the '
                        'middle of a night without --reference (default: incremental)')
    parser.add_argument('--track', default='', metavar='ERROR[,MINUTES]', help='after the fit, '
                        'observe the stars that keep the expected pointing error below ERROR, '
                        'such as 1.5arcsec,90; the model is adaptive')
    parser.add_argument('--pass', dest='satellite_pass', default='', metavar='ID,FILE',
                        help='after the fit, follow a satellite through its next pass, by '
                        f'its name in a file of its orbit ({options.ORBITS})')
    parser.add_argument('--tell-apart', default='', metavar='STARS[,HOURS]', help='after the fit, '
                        'diagnose, and observe at most so many stars that distinguish open '
                        'causes, such as 15,2h (default: none)')
    options.add(parser, 'harmonics', 'harmonics-alone', 'harmonics-degree')
    options.add(parser, 'date', 'latitude', 'longitude', 'height')
    options.add(parser, 'mount', help=options.MOUNT_OF_NIGHT + SERVER_OF_NIGHT)
    _add_server(parser)
    options.add(parser, 'params', help='ROS parameter file, read by every node after the values '
                'above')
    parser.add_argument('--absolute', choices=('angles', 'frames'), default='angles',
                        help='what the simulated absolute encoder publishes: angles, or images '
                        'that the node frame_reader reads (default: angles)')
    parser.add_argument('--time-scale', type=options.real(0.0, 1000.0), default=0.0, metavar='X',
                        help='simulated seconds a second; 0 (default): as fast as the graph '
                        'answers')
    options.add(parser, 'domain')
    options.add_verbose(parser, 'tables and notes')
    options.add_json(parser, 'the report')


def _add_server(parser):
    """Add the options for a mount of a server."""
    parser.add_argument('--camera', default='', metavar='indi:HOST:PORT:NAME',
                        help='with a server mount: INDI camera whose images are plate-solved '
                        '(default: the position of a simulator)')
    parser.add_argument('--driver', type=Path, action='append', default=[], metavar='FILE',
                        help='with a server mount: Python driver of your own camera')
    parser.add_argument('--exposure', type=options.real(1e-3, 600.0, 's'), metavar='S',
                        default=options.Default('telescope_mount.nights.server_night.EXPOSURE'),
                        help='with a server mount: exposure time, during which the mount must '
                        'track steadily (default: %(default)s)')
    parser.add_argument('--anew', action='store_true', help='with a server mount: restart the '
                        'interrupted night in --out (default: resume it where it stopped)')


def run(args):
    """Observe, print, write."""
    from ..bridges.connection import PORTS
    from ..nights.server_night import EXPOSURE
    from ..nights.whole_night import run_night
    from ..observing.plan import ZERO_EXPOSURES
    from .console import ProgressLine, end_of_night, hold_up_lines, new_console, print_calibration
    if options.is_list(args):
        return options.list_scenarios(args)
    if args.reference is not None and args.power_cycle != 'incremental':
        raise ValueError(f'--power-cycle {args.power_cycle}: with --reference a night is one '
                         'power-on; leave one of them out')
    by_server = (args.mount or '').partition(':')[0] in PORTS
    if by_server:
        options.refuse(args, 'applies to the simulated mount; leave it out with --mount '
                       f'{args.mount.partition(":")[0]}:...', scenario='default',
                       absolute='angles', time_scale=0.0, power_cycle='incremental', date='',
                       polaris=ZERO_EXPOSURES)
    else:
        options.refuse(args, 'needs a mount of a server: give --mount indi:HOST:PORT or '
                       'alpaca:HOST:PORT', camera='', driver=[], exposure=EXPOSURE, anew=False)
    calibration = options.harmonics_of(args)
    track = ', '.join(f'{verb} {text.replace(",", " ", 1)}' for verb, text in (
        ('track', args.track), ('pass', args.satellite_pass)) if text)
    discrimination = f'tell_apart {args.tell_apart.replace(",", " ")}' if args.tell_apart else ''
    console = new_console()
    common = {
        'seed': args.seed, 'stars': args.stars, 'reference': args.reference,
        'domain_number': args.domain, 'params_file': args.params, 'sky': options.sky_of(args),
        'calibration': calibration, 'track': track, 'discrimination': discrimination}
    with ProgressLine(console) as progress:
        if by_server:
            from ..nights.real_night import run_server_night
            report = run_server_night(
                args.out, args.mount, camera=args.camera, drivers=args.driver, anew=args.anew,
                exposure=args.exposure, progress=progress, hold_up=hold_up_lines(console),
                note=console.print, **common)
        else:
            report = run_night(
                args.out, polaris=args.polaris, scenario=args.scenario, start_time=args.date,
                mount=args.mount or '', cycle=args.power_cycle, time_scale=args.time_scale,
                absolute=args.absolute, progress=progress, **common)
    print_calibration(console, report, args.verbose, len(report['files']))
    return end_of_night(console, args.json, report)
