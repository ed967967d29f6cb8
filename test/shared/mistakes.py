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

"""Mistakes that a newcomer makes: what is typed, and what the one line must say.

`FILES` are what lies in the folder; each of `MISTAKES` is the name, the words of the command line,
and parts of the answer: what is wrong, and where or what to do next.
"""

import json
import shutil

import numpy as np
from places import LOG

from pointing_model.model import PointingModel

HEADER = 'az_deg,el_deg,az_enc_deg,el_enc_deg'


def rows(n=40):
    """Catalogue and encoder angles of a mount with terms, degrees, shape (n, 4)."""
    az, el = (np.arange(n) * 137.5) % 360.0, 20.0 + (np.arange(n) * 23.7) % 60.0
    x = 0.01 + 0.003 / np.cos(np.radians(el))
    noise = np.random.default_rng(1).normal(size=(2, n)) * 2.0 / 3600.0
    return np.stack([az, el, az + x + noise[0], el - 0.012 + noise[1]], 1)


def text(values, header=HEADER, cell='{:.6f}', comma=','):
    """A CSV."""
    lines = [comma.join(cell.format(v) for v in row) for row in values]
    return '\n'.join([*([header.replace(',', comma)] if header else []), *lines]) + '\n'


def changed(column, of, n=40):
    """A CSV with one column changed by a function of the rows."""
    values = rows(n)
    values[:, column] = of(values)
    return text(values)


def broken(line, what, instead):
    """A CSV with one cell changed."""
    lines = text(rows()).splitlines()
    cells = lines[line].split(',')
    cells[what] = instead
    lines[line] = ','.join(cells)
    return '\n'.join(lines) + '\n'


def with_column(name, cells):
    """A CSV with a further column."""
    lines = text(rows()).splitlines()
    return '\n'.join([f'{lines[0]},{name}', *(f'{line},{cell}' for line, cell in zip(
        lines[1:], [*cells, *[cells[-1]] * 40]))]) + '\n'


def make(folder):
    """Fill a folder with files of a newcomer."""
    good = rows()
    files = {
        'run.csv': text(good),
        'empty.csv': '',
        'header_only.csv': HEADER + '\n',
        'h.csv': text(good, ''),
        'three.csv': text(good[:3]),
        'short_names.csv': text(good, 'az,el,az_enc,el_enc'),
        'wrong_name.csv': text(good, 'az_deg,el_deg,az_enc_deg,elenc_deg'),
        'i.csv': text(good, 'az_deg,az_deg,az_enc_deg,el_enc_deg'),
        'missing.csv': text(good[:, :3], 'az_deg,el_deg,az_enc_deg'),
        'f.csv': text(np.radians(good)),
        'a.csv': text(good[:, [1, 0, 3, 2]]),
        'b.csv': text(good[:, [0, 1, 3, 2]]),
        'c.csv': changed(1, lambda r: 90.0 - r[:, 1]),
        'd.csv': text(good / [15.0, 1.0, 1.0, 1.0]),
        'e.csv': text(np.column_stack([good[:, :2], (good[:, 2:] - good[:, :2]) * 3600.0])),
        'g.csv': text(good).replace('.', ','),
        'unit.csv': broken(4, 1, '45.0 deg'),
        'sexagesimal.csv': broken(4, 1, '45:30:00'),
        'letter.csv': broken(4, 2, 'n/a'),
        'cells.csv': text(good) + '1,2,3\n',
        'sigma.csv': with_column('sigma_az_arcsec', ['-1.0']),
        'date.csv': with_column('time', ['21/08/2021 04:36']),
        'milliseconds.csv': with_column('time', [str(1629520561555 + 1000 * i) for i in range(40)]),
        'ra.csv': text(good, 'ra_deg,dec_deg,az_enc_deg,el_enc_deg'),
        'model.json': json.dumps({'format': 'other'}),
        'broken.json': '{"format": "telescope_mount/model", ',
        'notes.txt': 'Observed until two, then clouds.\nThe dome was slow.\n',
        'words.mcap': 'this is no log',
        'empty.mcap': '',
        'broken.yaml': 'a: [1,\n b: }',
        'zeros.csv': 'a,b\n1,2\n',
    }
    for name, content in files.items():
        (folder / name).write_text(content)
    (folder / 'utf16.csv').write_bytes(text(good).encode('utf-16')[:-1])
    PointingModel({'IA': 1e-3, 'IE': 2e-4}).save(folder / 'good.json')
    (folder / 'excel.xlsx').write_bytes(b'PK\x03\x04' + bytes(range(256)) * 4)
    (folder / 'picture.png').write_bytes(b'\x89PNG\r\n\x1a\n' + bytes(range(256)) * 4)
    (folder / 'old.db3').write_bytes(b'SQLite format 3\x00' + bytes(200))
    for name in ('nothing', 'used', 'images'):
        (folder / name).mkdir()
    (folder / 'used' / 'x').write_text('x')
    (folder / 'images' / 'a.fits').write_bytes(b'SIMPLE  =                    T')
    whole = next(LOG.glob('*.mcap')).read_bytes()
    (folder / 'cut.mcap').write_bytes(whole[:300])
    (folder / 'full.json').symlink_to('/dev/full')
    shutil.copytree(LOG, folder / 'bag')


#: files of which one row has a fault, its line, and what is said of it
FAULTS_OF_A_ROW = [
    ('cells.csv', 42, '3 cells, but the header has 4'),
    ('unit.csv', 5, "el_deg '45.0 deg' is not a number; leave the unit out"),
    ('sexagesimal.csv', 5, "el_deg '45:30:00' is not a number; write decimal degrees"),
    ('letter.csv', 5, 'az_enc_deg is not a number'),
]

MISTAKES = [
    # --- files
    ('a file that is not there', 'fit nowhere.csv', 'nowhere.csv', 'No such file', 'look at'),
    ('a name with a slip', 'fit rum.csv', 'rum.csv', 'did you mean run.csv'),
    ('an empty file', 'fit empty.csv', 'empty.csv is empty'),
    ('a header and no row', 'fit header_only.csv', 'header_only.csv', 'no observations'),
    ('an empty folder', 'fit nothing', 'nothing', 'no .mcap file'),
    ('a folder of images', 'fit images', 'mount.yaml'),
    ('a workbook', 'fit excel.xlsx', 'excel.xlsx is a workbook', 'save its table as CSV'),
    ('a picture', 'fit picture.png', 'picture.png', 'is a binary file'),
    ('a model for a run', 'fit model.json', 'model.json is not a pointing run', 'export --to'),
    ('notes', 'fit notes.txt', 'notes.txt is not a pointing run', 'az_deg, el_deg'),
    ('a CSV in UTF-16', 'diagnose utf16.csv', 'utf16.csv', 'UTF-16', 'save it as CSV in UTF-8'),
    ('a model for a run', 'fit model.json', 'model.json', 'not a pointing run'),
    ('a log that is text', 'fit words.mcap', 'words.mcap is not an MCAP file'),
    ('an empty log', 'info empty.mcap', 'empty.mcap is empty'),
    ('a log cut short', 'fit cut.mcap', 'cut.mcap', 'observation'),
    ('a run for a log', 'info run.csv', 'run.csv', 'a log is the folder'),
    ('a run to verify', 'verify run.csv', 'run.csv', 'a log is the folder'),
    ('a broken log of rosbag2', 'info old.db3', 'old.db3'),
    ('a log that is not there', 'verify nowhere', 'nowhere does not exist',
     'give the folder of a log'),
    ('a run for a model', 'apply run.csv run.csv', 'run.csv', 'model'),
    ('a model of another program', 'apply model.json run.csv', 'model.json'),
    ('half a model', 'apply broken.json run.csv', 'broken.json'),
    ('a base that is not there', 'fit run.csv --base nowhere.json', 'nowhere.json'),
    # --- columns
    ('no header', 'fit h.csv', 'no header row', 'az_deg,el_deg'),
    ('names without units', 'fit short_names.csv', 'short_names.csv', 'az_deg'),
    ('a slip in a name', 'fit wrong_name.csv', 'el_enc_deg', 'elenc_deg'),
    ('a name twice', 'fit i.csv', 'az_deg', 'twice'),
    ('a column that is missing', 'fit missing.csv', 'missing.csv', 'el_enc_deg'),
    ('azimuth for elevation', 'fit a.csv', 'exchanged'),
    ('encoders exchanged', 'fit b.csv', 'exchanged'),
    ('places without a site', 'fit ra.csv', 'ra.csv', 'time'),
    ('a CSV for zeros', 'zeros zeros.csv', 'zeros.csv', 'zero_az_arcsec'),
    ('a run to follow without times', 'track run.csv', 'time'),
    ('a season of one night', 'season run.csv', 'run.csv'),
    # --- units
    ('radians', 'fit f.csv', 'radians', 'degrees'),
    ('hours', 'fit d.csv', 'hours'),
    ('zenith distances', 'diagnose c.csv', 'zenith'),
    ('offsets for readings', 'fit e.csv', 'offset'),
    ('decimal commas', 'fit g.csv', 'g.csv, row 2', 'decimal commas?'),
    ('a negative sigma', 'fit sigma.csv', 'row 2', 'sigma_az_arcsec is not positive'),
    ('a date of the country', 'fit date.csv', 'row 2, column time', '21/08/2021', 'ISO 8601'),
    ('milliseconds', 'fit milliseconds.csv', 'column time', 'seconds'),
    ('three stars', 'fit three.csv', 'observe'),
    # --- options
    ('no command', '', 'COMMAND'),
    ('a slip in a command', 'diagnoze run.csv', 'did you mean diagnose'),
    ('a slip in an option', 'fit run.csv --tems IA', 'did you mean --terms'),
    ('an option without its value', 'fit run.csv --save', '--save', 'argument'),
    ('no file', 'fit', 'RUN'),
    ('two files', 'fit run.csv run.csv', 'unrecognized arguments: run.csv'),
    ('a term that nobody knows', 'fit run.csv --terms IA,CX', 'CX', 'CA'),
    ('terms with blanks', 'fit run.csv --terms IA IE', 'unrecognized arguments: IE'),
    ('no second encoder', 'fit run.csv --encoder abs', 'no second encoder', '--encoder'),
    ('a choice that is none', 'fit run.csv --encoder encoder', 'encoder', 'abs'),
    ('a run that is not there', 'fit run.csv --run 7', 'no run 7'),
    ('a latitude beyond the pole', 'fit run.csv --latitude 95', '-90 to 90 degrees'),
    ('a latitude with a comma', 'fit run.csv --latitude 34,3', "'34,3'", 'decimal number, -90 to'),
    ('a latitude with a letter', 'fit run.csv --latitude 34.3N', '--latitude', '34.3N'),
    ('pascal', 'fit run.csv --pressure 101325', '0 to 1200 hPa'),
    ('kelvin', 'fit run.csv --temperature 283', '-90 to 60 degrees Celsius'),
    ('a mount of no kind', 'fit run.csv --mount dobson', 'dobson', 'equatorial'),
    ('a chance above one half', 'diagnose run.csv --alpha 5', '--alpha'),
    ('a skyline of one number', 'diagnose run.csv --horizon 95', '95',
     'give azimuth and elevation in degrees'),
    ('sessions in words', 'diagnose run.csv --sessions soon', '--sessions', 'soon'),
    ('a graduation in words', 'diagnose run.csv --graduation grating=many', 'grating', 'many'),
    ('a cause that is no column', 'diagnose run.csv --cause wind', 'no column wind'),
    ('a base of nothing', 'diagnose run.csv --base magic', 'magic', 'choose from IA'),
    ('a date for --since', 'season run.csv --since yesterday', 'yesterday'),
    ('a driver without a value', 'apply good.json run.csv --set wind', '--set wind',
     'COLUMN=VALUE'),
    ('a zero of no kind', 'apply model.json run.csv --zero last', "--zero: 'last'", 'newest'),
    ('a topic that is not there', 'export bag out --topics speed', 'speed', 'it has'),
    ('a time in words', 'export bag out.csv --start dusk', "'dusk'", '2026-01-15T13:00:00'),
    ('a program that is none', 'export model.json out.dat --to tpiont', 'did you mean tpoint'),
    ('a verb that is none', 'guard stop', 'stop', 'abort'),
    ('a shell that is none', 'completion tcsh', 'tcsh', 'bash'),
    ('too few stars', 'night --out n --stars 3', 'whole number, 4 to 5000'),
    ('a date of the country for a night', 'night --out n --date 15/01/2026', '15/01/2026'),
    ('a scenario of no name', 'night --out n --scenario nope', 'list prints all'),
    ('a scenario with a slip', 'night --out n --scenario defualt', 'did you mean default'),
    ('a reference that is no model', 'night --out n --reference run.csv', 'run.csv'),
    ('parameters that are not there', 'night --out n --params no.yaml', 'no.yaml is no file'),
    ('parameters that are no YAML', 'night --out n --params broken.yaml', 'broken.yaml'),
    ('a goal without a unit', 'night --out n --track 1.5', '1.5'),
    ('a driver that is not there', 'observe --out n --driver no.py', 'no.py is no file'),
    ('a transition that is left out', 'lifecycle mount_guard', 'name a transition'),
    ('images without their keywords', 'solve images', 'mount.yaml'),
    # --- what is written
    ('a model of another kind', 'fit run.csv --save model.txt', 'must end in .json'),
    ('a folder that is not there', 'fit run.csv --save no/model.json', 'no such folder'),
    ('a file that is there', 'fit run.csv --save model.json', 'is there already', '--overwrite'),
    ('results over the model', 'fit run.csv --json model.json', 'is there already'),
    ('results with another name', 'fit run.csv --json out.txt', 'out.txt', '.json'),
    ('a page that is a folder', 'diagnose run.csv --report used', 'used', '.html'),
    ('a table over a table', 'apply model.json run.csv --out run.csv', 'run.csv is there already'),
    ('a table for a spreadsheet', 'export run.csv out.xlsx', 'must end in .csv or .parquet'),
    ('a format of one table', 'export run.csv out.csv --format parquet', '--topics'),
    ('stars of a measured run', 'close-the-loop run.csv --out n --stars 20',
     '--stars applies to simulated nights'),
    ('an encoder of a model', 'bolts good.json --encoder abs', '--encoder applies to runs'),
    ('stars beside a plan', 'observe --out n --stars 20 --plan fit', '--stars', '--plan'),
    ('a table over a folder', 'export run.csv used', 'it is a folder; name a file'),
    ('a run over itself', 'export run.csv run.csv', 'is the input itself'),
    ('a folder in use', 'night --out used', 'is not empty; choose another folder'),
    ('a file for a folder', 'night --out run.csv', 'run.csv is a file'),
    ('a log into itself', 'recover bag --out bag/new', 'lies in the log itself'),
    ('a full disk', 'fit run.csv --json full.json', 'No space left on device', 'elsewhere'),
]
