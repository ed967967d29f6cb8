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

"""Writes the output of commands into the pages as tables, between marks, and finds outdated ones.

    .venv/bin/python docs/make/tables.py [NAME ...]   # all, some forty minutes
    .venv/bin/python docs/make/tables.py --check      # lists outdated tables; code 1 if any
    .venv/bin/python docs/make/tables.py --update     # regenerates outdated tables

A mark contains a hash of the table's dependencies (code and data that its command reads), and the
commit, machine and date of its generation:

    <!-- made: NAME; rests on 0123abcd; commit 0123abcd, 2 x Xeon, 2026-01-15 -->
    <!-- end: NAME -->
"""

import argparse
import ast
import datetime
import hashlib
import json
import os
import platform
import re
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / 'docs'
MARK = re.compile(r'<!-- made: (?P<name>\w+); rests on (?P<rests>[0-9a-f]{8}); (?P<when>[^>]*) -->'
                  r'\n(?P<text>.*?)<!-- end: (?P=name) -->\n', re.S)
#: dependencies of a simulated night, and of a fit and diagnosis of a file
MODEL = ('msg_tools/units.py', 'pointing_model/*.py', 'pointing_model/effects',
         'pointing_model/runs/*.py', 'pointing_model/runs/columns', 'pointing_model/runs/formats',
         'pointing_model/sky/*.py',
         'calibration/estimation', 'calibration/analysis/*.py', 'calibration/analysis/diagnosis')
FIT = (*MODEL, 'calibration/data/*.csv')
NIGHT = (*MODEL, 'calibration/*.py', 'calibration/analysis/zero', 'calibration/analysis/encoders',
         'encoder_sim', 'encoder_reading', 'telescope_mount/observing', 'telescope_mount/guard')
TUTORIAL = (*MODEL, 'calibration/report', 'examples/tutorial/*.csv')
MMT = 'calibration/data/mmt_2021-08-21.csv'


@dataclass(frozen=True)
class Table:
    """A table of a page.

    Attributes
    ----------
    page : str
        Path below docs.
    command : str
        Command as typed by a user; `{out}` is a temporary folder.
    rests : tuple of str
        Dependencies: folders and file patterns.
    begin, end : str
        Patterns of the first line used, and of the first line after the table.
    keep, cut : str
        Patterns of the lines to keep, and of the ends to remove from them.
    rows : callable
        Instead of these: converts the command's folder and output to Markdown.
    """

    page: str
    command: str
    rests: tuple
    begin: str = ''
    end: str = '$.^'
    keep: str = ''
    cut: str = '$'
    rows: object = None


def markdown(*rows):
    """A Markdown table; the first row is its header."""
    head, *body = ['| ' + ' | '.join(row) + ' |' for row in rows]
    return '\n'.join([head, '|' + ' --- |' * len(rows[0]), *body])


def loop_rows(folder, _):
    """Rows of all scenarios of the loop."""
    sys.path.insert(0, str(ROOT))
    from telescope_mount.closed_loop.loop_tables import added
    report = json.loads((folder / 'report.json').read_text(encoding='utf-8'))
    head = 'scenario', 'verdict', 'effects added', 'found', 'before', 'after', 'floor'
    return markdown(head, *(
        (row['scenario'], row['verdict'], '; '.join(added(row)) or '–', row['found'] or '',
         *(f'{row["paired"][when]["rms_arcsec"]:.2f}' for when in ('before', 'after')),
         f'{row["noise_floor_arcsec"]:.2f}') for row in report['scenarios']))


#: third-party modules that the table of speeds compares with
PEERS = 'astropy', 'katpoint', 'skyfield', 'skyfield_data'


def speed_rows(folder, _):
    """Rows of benchmarks with a peer."""
    sys.path.insert(0, str(ROOT / 'benchmarks'))
    from race import peer, seconds
    absent = [name for name in PEERS if peer(name) is None]
    if absent:
        raise SystemExit(f'speed: not without its peers: .venv/bin/pip install {" ".join(absent)}')
    rows = json.loads(folder.with_suffix('.json').read_text(encoding='utf-8'))['rows']
    return markdown(('what', 'size', 'ours', 'peer', 'ratio'), *(
        (row['what'], f'{row["size"]}', seconds(row['ours']), row['peer'], f'{row["ratio"]:.2g}')
        for row in rows if row['ratio'] is not None))


def measured_rows(_, printed):
    """The columns of the table of measured runs that are shown."""
    wanted = ('data', 'rows', 'verdict', 'radial, fitted', 'cross-validated',
              'stretches of time left out', 'held out', 'published')
    head, _, *rows = [[cell.strip() for cell in line.strip().strip('|').split('|')]
                      for line in printed.splitlines() if line.startswith('|')]
    return markdown(*([dict(zip(head, row))[name].replace('->', '→').replace('"', '″')
                       for name in wanted] for row in (head, *rows)))


def league_rows(_, printed):
    """The league's table, and the line after it."""
    *_, last = filter(None, printed.splitlines())
    return '\n'.join([line for line in printed.splitlines() if line.startswith('|')]
                     + ['', last[:1].upper() + last[1:] + '.'])


def printed_rows(_, printed):
    """A table as printed."""
    return printed.strip()


#: lines after the tables of a command
NOTES = r'note|sigma from|\d+ more|lines? \d'

TABLES = {
    'fit_mmt': Table('your_own_file.md', f'telescope-mount fit {MMT}', FIT, '80 of 80',
                     NOTES),
    'diagnose_mmt': Table('your_own_file.md', f'telescope-mount diagnose {MMT}',
                          (*FIT, 'calibration/report')),
    'harmonics': Table('harmonics.md', f'telescope-mount fit {MMT} --harmonics zenith --verbose',
                       FIT,
                       ' model  ', NOTES),
    'first_night': Table('first_night.md', 'telescope-mount night --out {out} --verbose',
                         NIGHT, 'Zero on Polaris', 'log '),
    'watch': Table('watch.md', 'telescope-mount watch examples/night',
                   ('examples/night/bag/*', 'telescope_mount/dashboard')),
    'encoder_test': Table('absolute_encoder.md', 'telescope-mount encoder-test --out {out}',
                          ('encoder_reading', 'encoder_sim/*.py', 'telescope_mount/papers'),
                          ' arcsec  ', NOTES),
    'experiment': Table('zero_drift.md', 'telescope-mount experiment --out {out} --verbose',
                        (*NIGHT, 'telescope_mount/papers'), ' night  ', 'The same stars'),
    'loop': Table('closing_the_loop.md', 'telescope-mount close-the-loop --scenario all '
                  '--out {out}', NIGHT, rows=loop_rows),
    'loop_mmt': Table('closing_the_loop.md', f'telescope-mount close-the-loop {MMT} --latitude '
                      '31.6888 --longitude=-110.8846 --out {out}', (*FIT, 'calibration/*.py'),
                      '60 of 60', 'note: '),
    'tutorial_altaz_fit': Table('tutorial_altaz.md', 'telescope-mount fit '
                                'examples/tutorial/altaz_night1.csv', TUTORIAL, '60 of 60',
                                NOTES),
    'tutorial_altaz_diagnosis': Table(
        'tutorial_altaz.md', 'telescope-mount diagnose examples/tutorial/altaz_night1.csv '
        '--holdout examples/tutorial/altaz_night2.csv', TUTORIAL),
    'tutorial_german_fit': Table('tutorial_german.md', 'telescope-mount fit '
                                 'examples/tutorial/german_solved.csv', TUTORIAL, '80 of 80'),
    'tutorial_german_diagnosis': Table(
        'tutorial_german.md', 'telescope-mount diagnose examples/tutorial/german_solved.csv',
        TUTORIAL),
    'bolts': Table('bolts.md', 'benchmarks/bolts.py --mounts 20',
                   ('pointing_model/bolts_and_feet.py', 'pointing_model/image_alignment.py',
                    'pointing_model/geometry.py', 'calibration/analysis/term_fit.py',
                    'calibration/estimation/gauss_newton.py', 'benchmarks/bolts.py'),
                   keep='latitude|^ +(-33|48|70)', cut=r'beyond.*| +\d+ of \d+'),
    'model_files': Table('models_of_others.md', 'benchmarks/model_files.py',
                         ('pointing_model/runs/model_files', 'pointing_model/runs/programs',
                          'pointing_model/geometry.py',
                          'pointing_model/model.py', 'telescope_mount/model_export.py',
                          'benchmarks/model_files.py'), end='Our file read'),
    'zero_faults': Table('zero_drift.md', 'benchmarks/zero_drift.py --nights 150 --faults 20',
                         ('calibration/analysis/encoders', 'calibration/analysis/zero',
                          'encoder_sim/incremental.py', 'benchmarks/zero_drift.py'), 'fault',
                         cut=r'(agree 3s| +[\d.]+% +\d+  \{).*'),
    'tracking': Table('tracking.md', 'benchmarks/tracking.py',
                      ('calibration/analysis/tracking', 'calibration/estimation/kalman.py',
                       'calibration/estimation/gaussian_sum.py',
                       'calibration/estimation/dynamics.py', 'benchmarks/tracking.py'),
                      keep=r'mean radial|^  of \(|called by the second|false jumps'),
    'guard': Table('guard.md', 'benchmarks/guard.py --commands 6000',
                   ('telescope_mount/guard', 'benchmarks/guard*.py'), 'commands',
                   keep='^[^:]*$|judgement', cut=r'\s*$'),
    'season': Table('season.md', 'benchmarks/season.py --seasons 20',
                    ('calibration/analysis/season', 'calibration/estimation/kalman.py',
                     'benchmarks/season.py'), 'season ', '#'),
    'revisits': Table('revisits.md', 'benchmarks/revisits.py --only steps white outliers',
                      ('calibration/estimation/revisits.py',
                       'calibration/estimation/outlier_clusters.py',
                       'calibration/analysis/diagnosis/residual_patterns.py',
                       'benchmarks/revisits.py'),
                      keep='passes|no step|outliers|: white|a direction'),
    'mounts': Table('mounts.md', 'benchmarks/simulated_mounts.py',
                    ('pointing_model/*.py', 'pointing_model/effects', 'calibration/estimation',
                     'calibration/analysis/diagnosis', 'encoder_sim/mount_geometry.py',
                     'encoder_sim/azimuth_track.py', 'benchmarks/simulated_mounts.py')),
    'encoder': Table('absolute_encoder.md', 'benchmarks/absolute_encoder.py --only bound total',
                     ('encoder_reading', 'encoder_sim/ccd.py', 'benchmarks/absolute_encoder.py'),
                     keep='px a bar|bound, scale|sigma,|total RMS|paper',
                     cut=r'<= 0\.5   reached (largest [\d.]+", )?|, (bar|corrected).*'),
    'errata': Table('papers.md', 'benchmarks/papers.py',
                    ('pointing_model/harmonics.py', 'pointing_model/pointing_terms.py',
                     'calibration/analysis/harmonic_fit.py', 'benchmarks/papers.py'),
                    keep='percent of a term', cut=r'^ +1 +| +$'),
    'diagnosis': Table('diagnosis.md', 'benchmarks/diagnosis.py --nights 60 --trials 48 '
                       '--only clean one two', (*MODEL, 'benchmarks/diagnosis*.py'), 'what',
                       cut=r'  (ok|MISSED).*|   +(as an|plain|by name|median) .*'),
    'measured': Table('measured_data.md', 'benchmarks/measured_data.py --only MMT "8 m" 2012-04B '
                      '2014-04 paper', (*FIT, 'benchmarks/measured_data.py'), rows=measured_rows),
    'league': Table('prediction.md', 'benchmarks/league.py --methods terms greedy ours',
                    (*MODEL, 'benchmarks/league.py'), rows=league_rows),
    'orbits': Table('satellites.md', 'benchmarks/orbits.py --rounds 1',
                    ('pointing_model/sky', 'benchmarks/orbits.py'), 'every second', 'SGP4'),
    'satellite_tracks': Table(  # some 25 minutes
        'satellites.md', 'benchmarks/satellite_tracks.py',
        ('calibration/analysis/satellites', 'calibration/estimation/noise_by_group.py',
         'calibration/estimation/prior_fit.py', 'calibration/estimation/correlated_noise.py',
         'calibration/analysis/term_fit.py', 'pointing_model/runs/satellite_tracks.py',
         'pointing_model/sky/satellite_place.py', 'pointing_model/sky/orbits',
         'benchmarks/satellite_tracks.py'), rows=printed_rows),
    'speed': Table('measurements.md', 'benchmarks/all.py --part fit,model,sky,encoder,log '
                   '--json {out}.json',
                   (*MODEL, 'encoder_reading', 'msg_tools', 'benchmarks/compared.py'),
                   rows=speed_rows),
}


# --- what a table rests on ------------------------------------------------------------------------


def code_of(text):
    """A module's syntax tree without comments, layout and docstrings, as text."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        body = getattr(node, 'body', None)
        if isinstance(body, list) and body and isinstance(body[0], ast.Expr) and isinstance(
                getattr(body[0], 'value', None), ast.Constant):
            node.body = body[1:] or [ast.Pass()]
    return ast.dump(tree)


@cache
def hash_of(path):
    """Hash of a file's content, or of a module's code."""
    content = path.read_bytes()
    if path.suffix == '.py':
        content = code_of(content.decode()).encode()
    return hashlib.sha256(content).hexdigest()


def rests_on(rests):
    """Hash of all dependencies, 8 hex digits."""
    files = {path for part in rests for path in (
        [p for end in ('py', 'yaml') for p in (ROOT / part).rglob(f'*.{end}')]
        if (ROOT / part).is_dir() else ROOT.glob(part)) if path.is_file()}
    if not files:
        raise ValueError(f'nothing there: {", ".join(rests)}')
    lines = [f'{path.relative_to(ROOT)} {hash_of(path)}' for path in sorted(files)]
    return hashlib.sha256('\n'.join(lines).encode()).hexdigest()[:8]


def stale():
    """Names of tables that are outdated or missing."""
    found = {match['name']: match['rests'] for page in DOCS.rglob('*.md')
             for match in MARK.finditer(page.read_text(encoding='utf-8'))}
    return [name for name, table in TABLES.items() if found.get(name) != rests_on(table.rests)]


# --- making them ----------------------------------------------------------------------------------


def taken(text, table):
    """The lines of a command's output that the page shows, as a block."""
    lines = [line.rstrip() for line in text.splitlines()]
    first = next((i for i, line in enumerate(lines) if re.match(table.begin, line)), None)
    if first is None:
        raise ValueError(f'no line {table.begin!r}')
    lines = lines[first:]
    last = next((i for i, line in enumerate(lines[1:], 1) if re.match(table.end, line)), len(lines))
    lines = [re.sub(table.cut, '', line).rstrip() for line in lines[:last]
             if re.search(table.keep, line)]
    return '```\n' + '\n'.join(lines).strip('\n') + '\n```'


def output_of(table):
    """What the page shows of the command's results."""
    command = table.command
    words = shlex.split(command)
    if words[0] == 'telescope-mount':
        words[:1] = [sys.executable, '-m', 'telescope_mount']
    else:
        words[:1] = [sys.executable, str(ROOT / words[0])]
    with tempfile.TemporaryDirectory() as folder:
        words = [word.replace('{out}', f'{folder}/out') for word in words]
        done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, env={
            **os.environ, 'COLUMNS': '100', 'OPENBLAS_NUM_THREADS': '1'})
        if done.returncode:
            raise SystemExit(f'{command}: code {done.returncode}\n{done.stderr[-2000:]}')
        return table.rows(Path(folder) / 'out', done.stdout) if table.rows else taken(
            done.stdout, table)


def machine():
    """Processor and number of cores, in a few words."""
    model = platform.machine()
    try:
        cpu = re.search(r'^model name\s*: (.*)', Path('/proc/cpuinfo').read_text(), re.M)
        model = re.sub(r'\(R\)|CPU|Processor|@.*', '', cpu[1]).strip() if cpu else model
    except OSError:
        pass
    return f'{os.cpu_count()} x {" ".join(model.split())}'


def made(name, text, rests):
    """The table between its marks."""
    commit = subprocess.run(['git', 'rev-parse', '--short=8', 'HEAD'], cwd=ROOT, check=True,
                            capture_output=True, text=True).stdout.strip()
    when = f'commit {commit}, {machine()}, {datetime.date.today().isoformat()}'
    return (f'<!-- made: {name}; rests on {rests}; {when} -->\n'
            f'{text}\n<!-- end: {name} -->\n')


def write(name):
    """Run the command and insert its table into the page."""
    table = TABLES[name]
    rests = rests_on(table.rests)  # at the start of the command
    text = made(name, output_of(table), rests)
    path = DOCS / table.page
    page = path.read_text(encoding='utf-8')
    if f'<!-- table: {name} -->\n' in page:  # a new table
        page = page.replace(f'<!-- table: {name} -->\n', text)
    else:
        page, count = re.subn(rf'<!-- made: {name};.*?<!-- end: {name} -->\n', lambda _: text, page,
                              flags=re.S)
        if count != 1:
            raise SystemExit(f'{table.page}: no marks of {name}')
    path.write_text(page, encoding='utf-8')


def main():
    """Run; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('names', nargs='*', metavar='NAME', help=', '.join(TABLES))
    parser.add_argument('--check', action='store_true', help='list those that are stale')
    parser.add_argument('--update', action='store_true', help='make again those that are stale')
    args = parser.parse_args()
    if wrong := [name for name in args.names if name not in TABLES]:
        parser.error(f'no table {wrong[0]!r}: it is some of {", ".join(TABLES)}')
    if args.check:
        names = [name for name in stale() if not args.names or name in args.names]
        for name in names:
            print(f'{TABLES[name].page}: {name} is older than what it rests on; make it again: '
                  f'docs/make/tables.py {name}')
        return int(bool(names))
    for name in stale() if args.update else args.names or TABLES:
        write(name)
        print(f'{TABLES[name].page}: {name}', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
