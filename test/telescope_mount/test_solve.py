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

"""A folder of images through a plate solver: one that fails in every way, and the real one."""

import json
import shutil
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from plate_solved import draw

from msg_tools.units import ARCSEC, DEG
from pointing_model.runs.formats.csv import iso_utc
from pointing_model.runs.plate_solves import solvers
from pointing_model.runs.run_reader import read_run

if find_spec('astropy') is None:
    pytest.skip('needs astropy (./install.sh ros,test,images)', allow_module_level=True)

START = 1_795_000_000.0
YAML = """\
images: 'img*.fits'
site: {latitude_deg: 34.3, longitude_deg: 109.0}
time_is: start
encoders_at: start
keywords: {time: DATE-OBS, az_enc_deg: ENC_AZ, el_enc_deg: ENC_EL, humid: HUMIDITY}
"""
#: what the name of an image says happens to it; the solution lies beside the image
FAKE = """\
#!/bin/sh
echo "$@" >> {folder}/called
for image; do :; done
while [ $# -gt 1 ]; do [ "$1" = --dir ] && dir=$2; shift; done
case "$image" in
*_hang.fits) sleep 60 & wait;;
*_die.fits) kill -SEGV $$;;
*_code.fits) echo 'You must list at least one index'; exit 255;;
*_junk.fits) echo junk > "$dir/solved.wcs";;
*_none.fits) echo 'Field 1 did not solve';;
*) cp "${{image%.fits}}.truth" "$dir/solved.wcs";;
esac
"""


def cards(number, **more):
    return {'DATE-OBS': iso_utc(np.array([START + 600.0 * number]))[0].rstrip('Z'),
            'ENC_AZ': 100.0 + number, 'ENC_EL': 40.0 + number, 'HUMIDITY': 0.4, **more}


@pytest.fixture
def folder(tmp_path):
    """``folder(names)``: images of these names with solutions beside them, and a fake solver."""
    from astropy.io import fits

    def make(*names):
        for i, name in enumerate(names):
            fits.writeto(tmp_path / f'img_{i}_{name}.fits', np.zeros((4, 4), np.int16),
                         fits.Header(cards(i)))
            truth = fits.Header({
                'SIMPLE': True, 'BITPIX': 8, 'NAXIS': 0, 'CTYPE1': 'RA---TAN',
                'CTYPE2': 'DEC--TAN', 'EQUINOX': 2000.0, 'CRVAL1': 10.0 + i, 'CRVAL2': 20.0 + i,
                'CRPIX1': 2.5, 'CRPIX2': 2.5, 'CD1_1': -3e-4, 'CD1_2': 0.0, 'CD2_1': 0.0,
                'CD2_2': 3e-4, 'IMAGEW': 4, 'IMAGEH': 4})
            truth.tofile(tmp_path / f'img_{i}_{name}.truth')
        (tmp_path / 'mount.yaml').write_text(YAML)
        program = tmp_path / 'solve-field-fake'
        program.write_text(FAKE.format(folder=tmp_path))
        program.chmod(0o755)
        return tmp_path
    return make


def calls(folder):
    path = folder / 'called'
    return len(path.read_text().splitlines()) if path.exists() else 0


def solve(ended, folder, *options):
    return ended('solve', folder, '--solver', folder / 'solve-field-fake', *options)


def test_images_become_a_run(folder, ended):
    where = folder('a', 'b', 'c')
    code, out, err = solve(ended, where)
    assert code == 0 and err == '' and '3 of 3 images solved' in out
    lines = (where / 'solved.csv').read_text().splitlines()
    assert lines[0] == '# frame: ICRS' and '# latitude_deg: 34.3' in lines
    assert lines[3].startswith('star,time,ra_deg,dec_deg,az_enc_deg,el_enc_deg,scale_arcsec_px')
    row = dict(zip(lines[3].split(','), lines[5].split(',')))
    assert row['star'] == 'img_1_b.fits' and row['time'].startswith('2026-11-18T11:16:40')
    assert [float(row[n]) for n in ('ra_deg', 'dec_deg', 'az_enc_deg', 'parity', 'humid')] == [
        pytest.approx(11.0, abs=1e-9), pytest.approx(21.0, abs=1e-9), 101.0, -1.0, 0.4]
    assert float(row['scale_arcsec_px']) == pytest.approx(1.08)


def test_half_of_the_images_fail_and_are_told(folder, ended):
    where = folder('a', 'none', 'die', 'code', 'junk', 'b')
    code, out, err = solve(ended, where)
    assert code == 1 and err == '' and '2 of 6 images solved, 4 not' in out
    for words in ('img_1_none.fits: not solved, no solution', 'died of signal 11',
                  'ended with code 255 (it said: You must list', 'its solution cannot be read'):
        assert words in out
    text = (where / 'solved.csv').read_text()
    assert '# unsolved: 4 of 6 images' in text
    notes = read_run(where / 'solved.csv').meta['notes']
    assert any('4 of 6 images were not solved' in note for note in notes)


def test_a_hanging_solver_is_ended(folder, ended, monkeypatch):
    monkeypatch.setattr(solvers, '_GRACE', 1.0)
    where = folder('hang', 'a')
    code, out, err = solve(ended, where, '--timeout', 1)
    assert code == 1, err
    assert 'img_0_hang.fits: hung, no end after' in out and 'on 1 the solver' in out


def test_a_solver_that_hangs_on_everything_is_given_up(folder, refused, monkeypatch):
    monkeypatch.setattr(solvers, '_GRACE', -0.8)
    where = folder(*['hang'] * 7)
    line = refused('solve', where, '--solver', where / 'solve-field-fake', '--timeout', 1)
    assert 'hangs: 5 images in a row' in line and calls(where) == 5
    assert not (where / 'solved.csv').exists()


def test_what_is_done_is_not_done_again(folder, ended):
    from astropy.io import fits
    where = folder('a', 'none', 'b')
    solve(ended, where)
    assert calls(where) == 3
    first = (where / 'solved.csv').read_text()
    solve(ended, where)
    assert calls(where) == 3 and (where / 'solved.csv').read_text() == first
    # a line that a crash has cut is done again, and so is an image that changed
    journal = where / 'solved.csv.jsonl'
    journal.write_text(journal.read_text()[:-30])
    fits.writeto(where / 'img_0_a.fits', np.ones((4, 4), np.int16), fits.Header(cards(0, X=1)),
                 overwrite=True)
    solve(ended, where)
    assert calls(where) == 5 and (where / 'solved.csv').read_text() == first
    # those that were not solved are tried again when asked
    solve(ended, where, '--again')
    assert calls(where) == 6
    assert all(json.loads(line)['image'] for line in journal.read_text().splitlines()
               if line.endswith('}'))


def test_what_was_solved_before_an_interruption_is_kept(folder, ended, monkeypatch):
    from pointing_model.runs.plate_solves.solvers import PlateSolver
    where = folder('a', 'b', 'c')
    whole = PlateSolver.solve

    def interrupted(self, image, boresight=None):
        if 'img_2' in image.name:
            raise KeyboardInterrupt
        return whole(self, image, boresight)
    monkeypatch.setattr(PlateSolver, 'solve', interrupted)
    assert solve(ended, where)[0] == 130
    assert len((where / 'solved.csv').read_text().splitlines()) == 7
    monkeypatch.undo()
    assert solve(ended, where)[0] == 0 and calls(where) == 3


@pytest.mark.parametrize('words, text', [
    (('--solver', 'astap'), 'no plate solver is installed; install astap'),
    (('--solver', 'platypus'), "'platypus' is none that is known: solve-field, astap"),
    (('--solver', '/nowhere/solve-field'), 'no program that can be started'),
    (('--keywords', 'other.yaml'), 'other.yaml is not there: it says which keywords'),
    (('--out', 'run.txt'), 'must end in .csv'),
    (('--scale', '3', '2'), 'the first is the lower one'),
    (('--timeout', '0'), 'a decimal number, 1 to 36000 s'),
])
def test_bad_options_are_one_line(folder, refused, words, text, monkeypatch):
    if shutil.which('astap') or shutil.which('astap_cli'):
        monkeypatch.setenv('PATH', '/nowhere')
    assert text in refused('solve', folder('a'), *words)


def test_without_any_solver_a_line_says_what_to_install(folder, refused, monkeypatch):
    where = folder('a')
    monkeypatch.setenv('PATH', '/nowhere')
    line = refused('solve', where)
    assert 'astrometry-data-tycho2-10-19' in line and 'or astap' in line


def test_a_program_that_cannot_be_started_is_one_line(folder, refused):
    where = folder('a')
    (where / 'solve-field-fake').write_text('#!/nowhere/sh\n')
    assert 'cannot be started' in refused('solve', where, '--solver', where / 'solve-field-fake')


def test_a_folder_that_is_none_or_has_no_image_is_refused(folder, refused, tmp_path):
    assert 'is no folder' in refused('solve', tmp_path / 'nothing')
    assert 'which keywords of the images are what' in refused('solve', tmp_path)
    where = folder()
    assert 'has no image img*.fits' in refused('solve', where, '--solver',
                                               where / 'solve-field-fake')


def test_none_solved_is_a_refusal(folder, refused):
    where = folder('none', 'none')
    line = refused('solve', where, '--solver', where / 'solve-field-fake')
    assert 'none of 2 images is solved (img_0_none.fits: no solution)' in line


def test_astap_is_asked_and_understood(folder, ended):
    where = folder('a', 'none')
    program = where / 'astap_fake'
    program.write_text("""#!/bin/sh
out=; image=; fov=
while [ $# -gt 0 ]; do case "$1" in -o) out=$2;; -f) image=$2;; -fov) fov=$2;; esac; shift; done
echo "$fov" > """ + str(where) + """/fov
case "$image" in
*_none.fits) printf 'PLTSOLVD=F\\nERROR=No solution found!\\n' > "$out.ini"; exit 1;;
*) printf 'PLTSOLVD=T\\nCRPIX1=2.5\\nCRPIX2=2.5\\nCRVAL1=30.5\\nCRVAL2=-4\\nCD1_1=-1E-4\\n\
CD1_2=0\\nCD2_1=0\\nCD2_2=1E-4\\n' > "$out.ini";;
esac
""")
    program.chmod(0o755)
    code, out, err = ended('solve', where, '--solver', program, '--scale', 900, 1600)
    assert code == 1 and 'img_0_a.fits: solved, 30.50000 -4.00000' in out
    assert 'no solution (No solution found!)' in out
    # 4 rows of 1200 arcsec
    assert float((where / 'fov').read_text()) == pytest.approx(4800 / 3600, rel=1e-4)


# ------------------------------------------------------------------------------ the real solver

INDEX = list(Path('/usr/share/astrometry').glob('index-tycho2-1[0-9]*'))
real = pytest.mark.skipif(
    not (shutil.which('solve-field') and INDEX), reason='needs solve-field and index files '
    '(apt-get install astrometry.net astrometry-data-tycho2-10-19)')


@real
def test_the_real_solver_on_images_of_the_catalogue(tmp_path, ended):
    from astropy.io import fits
    places = np.array([[200.0, 60.0]]) * DEG
    for i, (ra, dec) in enumerate(places):
        draw(tmp_path / f'img_{i}.fits', ra, dec, cards(i), seed=i)
    # one with nothing on it, and one whose header has the solution of another
    fits.writeto(tmp_path / 'img_9.fits', np.random.default_rng(1).normal(
        100, 5, (400, 400)).astype(np.uint16), fits.Header(cards(9)))
    (tmp_path / 'mount.yaml').write_text(YAML)
    code, out, err = ended('solve', tmp_path, '--scale', 50, 70, '--timeout', 30, '--solver',
                           'solve-field')
    assert code == 1 and '1 of 2 images solved' in out, out + err
    assert 'img_9.fits: not solved, no solution' in out
    lines = [line.split(',') for line in (tmp_path / 'solved.csv').read_text().splitlines()
             if not line.startswith('#')]
    rows = [dict(zip(lines[0], line)) for line in lines[1:]]
    for row, (ra, dec) in zip(rows, places):
        away = np.hypot((float(row['ra_deg']) * DEG - ra) * np.cos(dec),
                        float(row['dec_deg']) * DEG - dec) / ARCSEC
        # a tenth of a pixel
        assert away < 6.0 and away < 7.0 * float(row['sigma_arcsec']) < 42.0
        assert float(row['scale_arcsec_px']) == pytest.approx(60.0, rel=0.002)
        assert row['parity'] == '-1'
