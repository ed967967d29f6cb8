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

"""Draws the glossary's pictures: what each term tilts, turns or bends, and its effect on the sky.

    .venv/bin/python docs/make/drawings.py

The mount is turned by the rotations of `pointing_model.geometry`, exaggerated to be visible; the
arrows are the term's own columns, computed at 60 arcsec.
"""

import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / 'docs' / 'pictures'
sys.path.insert(0, str(ROOT))

from msg_tools.units import ARCSEC, DEG  # noqa: E402
from pointing_model.geometry import encoder_to_sky  # noqa: E402
from pointing_model.mounts import parse_mount  # noqa: E402
from pointing_model.pointing_terms import design  # noqa: E402

WIDTH, HEIGHT = 330, 170
FAR = 13.0 * DEG  # rotation of a part in a drawing
LATITUDE = 45.0 * DEG
STYLE = ('<style>.bg{fill:#fff}.o{stroke:#9aa5b1;fill:none;stroke-width:1.5;stroke-dasharray:4 3}'
         '.m{stroke:#1b2430;fill:none;stroke-width:2.5;stroke-linecap:round}'
         '.w{stroke:#c2410c;fill:none;stroke-width:3;stroke-linecap:round}'
         '.t{stroke:#31567a;fill:none;stroke-width:6;stroke-linecap:round;stroke-linejoin:round}'
         '.s{stroke:#c2410c;fill:none;stroke-width:1.5;stroke-dasharray:2 3}'
         '.c{stroke:#9aa5b1;fill:none}.a{stroke:#c2410c;fill:none;stroke-width:1.4}'
         '.d{fill:#c2410c}.k{fill:#1b2430}text{font:12px system-ui,sans-serif;fill:#1b2430}'
         '.l{fill:#667;font-size:11px}</style>')
#: terms with drawings: kind of mount, and caption
DRAWN = {
    'IA': ('altaz', 'the zero of the azimuth reading is turned'),
    'IE': ('altaz', 'the zero of the elevation reading is turned'),
    'CA': ('altaz', 'the line of sight is not square to the elevation axis'),
    'NPAE': ('altaz', 'the elevation axis is not square to the azimuth axis'),
    'AN': ('altaz', 'the azimuth axis tilts north'),
    'AW': ('altaz', 'the azimuth axis tilts west'),
    'TF': ('altaz', 'the tube bends under its weight'),
    'TX': ('altaz', 'the air bends the light'),
    'IH': ('equatorial', 'the zero of the hour angle reading is turned'),
    'ID': ('equatorial', 'the zero of the declination reading is turned'),
    'CH': ('equatorial', 'the line of sight is not square to the declination axis'),
    'NP': ('equatorial', 'the declination axis is not square to the polar axis'),
    'MA': ('equatorial', 'the polar axis points beside the pole, to the west'),
    'ME': ('equatorial', 'the polar axis points too high'),
    'FO': ('equatorial', 'the fork bends'),
    'DAF': ('equatorial', 'the declination axis bends under its load'),
}
POSE = {'altaz': (55.0 * DEG, 40.0 * DEG), 'equatorial': (-50.0 * DEG, 35.0 * DEG)}


def rx(angle):
    """Matrix of a rotation about x."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def ry(angle):
    """Matrix of a rotation about y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def rz(angle):
    """Matrix of a rotation about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def leaning(an, aw):
    """Matrix that tilts the first axis by (an, aw): the rotation vector (-an, -aw, 0)."""
    angle = np.hypot(an, aw)
    if not angle:
        return np.eye(3)
    x, y = -an / angle, -aw / angle
    k = np.array([[0, 0, y], [0, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


class Skeleton:
    """A mount as lines, in east, north, up; ``s = T(AN, AW) Rz(-a) N(NPAE) Rx(e) b(CA)``.

    Parameters
    ----------
    kind : {'altaz', 'equatorial'}
    errors : dict of str to float
        With the names of an alt-azimuth mount (`mount_kinds.CANONICAL`), radians.
    """

    def __init__(self, kind, errors):
        self.kind, self.errors = kind, errors
        self.frame = np.eye(3) if kind == 'altaz' else np.array([
            [-1, 0, 0], [0, -np.sin(LATITUDE), np.cos(LATITUDE)],
            [0, np.cos(LATITUDE), np.sin(LATITUDE)]]).T
        a, e = POSE[kind]
        self.lean = self.frame @ leaning(errors.get('AN', 0.0), errors.get('AW', 0.0))
        self.turned = self.lean @ rz(-a)
        self.lifted = self.turned @ ry(-errors.get('NPAE', 0.0))
        self.tube = self.lifted @ rx(e)
        self.foot = self.lean @ [0, 0, -1.0]
        self.head = np.zeros(3)

    def first_axis(self):
        """Both ends of the first axis."""
        return [self.foot, self.lean @ [0, 0, 0.15]]

    def second_axis(self):
        """Both ends of the second axis."""
        return [self.lifted @ [-0.42, 0, 0], self.lifted @ [0.42, 0, 0]]

    def barrel(self):
        """Points along the tube, bent by TF."""
        t = np.linspace(-0.35, 1.0, 15)
        sag = self.errors.get('TF', 0.0) * np.sign(t) * t**2 * 0.8
        return [self.tube @ [0, each, -down] for each, down in zip(t, sag)]

    def sight(self):
        """Both ends of the line of sight."""
        ca = self.errors.get('CA', 0.0)
        first = np.array([-np.sin(ca), np.cos(ca), 0.0])
        return [self.tube @ (0.2 * first), self.tube @ (1.35 * first)]

    def dial(self, axis, zero):
        """Circle of an encoder, and its zero mark, rotated by `zero`."""
        around = np.linspace(0.0, 2 * np.pi, 49)
        if axis == 1:
            ring = [self.lean @ [0.55 * np.sin(t), 0.55 * np.cos(t), -0.8] for t in around]
            mark = [self.lean @ [r * np.sin(zero), r * np.cos(zero), -0.8] for r in (0.4, 0.7)]
        else:
            ring = [self.lifted @ [0.42, 0.3 * np.cos(t), 0.3 * np.sin(t)] for t in around]
            mark = [self.lifted @ [0.42, r * np.cos(zero), r * np.sin(zero)] for r in (0.2, 0.42)]
        return ring, mark


def seen(points):
    """Project east, north, up to the picture: seen from the south-east, from above."""
    turn = rx(-70 * DEG) @ rz(28 * DEG)
    flat = np.array([turn @ p for p in points])
    return [(84 + 68 * x, 84 - 68 * y) for x, y in flat[:, :2]]


def path(points, style):
    """A polyline through points of the picture."""
    return f'<path class="{style}" d="M' + 'L'.join(f'{x:.1f} {y:.1f}' for x, y in points) + '"/>'


def mount_drawing(name):
    """The mount, dashed without and solid with the term; empty for terms without rotation."""
    kind, _ = DRAWN[name]
    if name in ('TX', 'FO', 'DAF'):
        return []
    own, sign = parse_mount(kind, LATITUDE).names.terms[name]
    wrong = {own: sign * FAR * (2.2 if own == 'TF' else 1.5 if own in ('IA', 'IE') else 1.0)}
    good, bad = Skeleton(kind, {}), Skeleton(kind, wrong)
    # keep the foot in place
    shift = good.foot - bad.foot
    north = [np.array([0.0, y, -1.05]) for y in (-0.9, 1.25)]
    out = [path(seen(north), 'c')]
    x, y = seen(north)[1]
    out.append(f'<text class="l" x="{x - 11:.0f}" y="{y + 4:.0f}">N</text>')
    moved = {'AN': 1, 'AW': 1, 'NPAE': 2, 'CA': 4, 'TF': 3, 'IA': 5, 'IE': 6}[own]
    if moved <= 3:
        out += [path(seen(part), 'o') for part in (good.first_axis(), good.second_axis(),
                                                   good.barrel())]
    parts = [bad.first_axis(), bad.second_axis(), bad.barrel()]
    for i, part in enumerate(parts):
        style = 't' if i == 2 else 'w' if i + 1 == moved else 'm'
        out.append(path(seen([p + shift for p in part]), style))
    if moved == 3:
        out.append(path(seen([p + shift for p in bad.barrel()]), 'w'))
    if moved == 4:
        out += [path(seen(good.sight()), 'o'), path(seen(bad.sight()), 'w')]
    for axis, which in ((1, 5), (2, 6)):
        if moved == which:
            ring, right = good.dial(axis, 0.0)
            _, mark = good.dial(axis, sum(wrong.values()))
            out += [path(seen(ring), 'c'), path(seen(right), 'o'), path(seen(mark), 'w')]
    return out


def sky_drawing(name):
    """Arrows of reading errors over the sky: north up, east right, zenith in the middle."""
    kind, _ = DRAWN[name]
    mount = parse_mount(kind, LATITUDE)
    cx, cy, radius = 245, 88, 68

    def place(az, el):
        r = radius * (90 - el / DEG) / 75.0
        return np.array([cx + r * np.sin(az), cy - r * np.cos(az)])
    out = [f'<circle class="c" cx="{cx}" cy="{cy}" r="{radius}"/>',
           f'<text class="l" x="{cx}" y="{cy - radius - 4}" text-anchor="middle">N</text>',
           f'<text class="l" x="{cx + radius + 4}" y="{cy + 4}">E</text>']
    amount, shown = 60.0 * ARCSEC, 1050.0
    for el_deg, count in ((22, 14), (42, 10), (62, 6), (82, 3)):
        for i in range(count):
            az, el = 2 * np.pi * (i + 0.5 * (count % 4 == 2)) / count, el_deg * DEG
            one, two = mount.axes_of(az, el)
            x, y = (float(np.squeeze(v)) * amount for v in design([name], np.array([one]),
                                                                  np.array([two]), mount))
            there = mount.horizon_of(one + x / np.cos(two), two + y)
            begin, end = place(az, el), place(*map(float, there))
            tip = begin + (end - begin) * shown
            length = np.hypot(*(tip - begin))
            if length < 0.6:
                out.append(f'<circle class="d" cx="{begin[0]:.1f}" cy="{begin[1]:.1f}" r="1.2"/>')
                continue
            along = (tip - begin) / length
            side = np.array([-along[1], along[0]])
            wing = min(4.0, 0.5 * length)
            out.append(path([begin, tip], 'a') + path(
                [tip - wing * along + 0.6 * wing * side, tip,
                 tip - wing * along - 0.6 * wing * side], 'a'))
    return out


def term_picture(name):
    """The picture of a term, SVG."""
    kind, words = DRAWN[name]
    return _svg([*mount_drawing(name), *sky_drawing(name)], f'{name}: {words}')


def _svg(parts, title, width=WIDTH, height=HEIGHT):
    return '\n'.join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
        f'height="{height}" role="img"><title>{title}</title>', STYLE,
        f'<rect class="bg" width="{width}" height="{height}"/>', *parts, '</svg>']) + '\n'


def reference_mark():
    """A grating with its reference mark, which is detected elsewhere after a power-on."""
    lines = [f'<path class="c" d="M{x} 60V90"/>' for x in range(20, 311, 10)]
    return _svg([*lines, '<path class="m" d="M150 40V60"/>',
                 '<text x="150" y="32" text-anchor="middle">reference mark</text>',
                 '<path class="o" d="M150 60V120"/><path class="w" d="M163 60V120"/>',
                 '<text class="l" x="20" y="108">lines of the grating</text>',
                 '<text x="172" y="118">where it was met: the counter is set to 0 here,</text>',
                 '<text x="172" y="134">and all readings are off by the difference</text>'],
                'reference mark: where it is met sets the zero of the encoder', 460, 146)


def miss_distance():
    """The field of the camera with the star off the boresight."""
    return _svg(['<rect class="c" x="20" y="15" width="140" height="140"/>',
                 '<path class="m" d="M80 85H100M90 75V95"/>',
                 '<text class="l" x="26" y="148">field of the camera</text>',
                 '<path class="w" d="M90 85L130 50"/><circle class="k" cx="130" cy="50" r="4"/>',
                 '<text x="104" y="42">star</text><text class="l" x="46" y="104">boresight</text>',
                 '<text x="175" y="70">miss distance =</text>',
                 '<text x="175" y="88">star − boresight:</text>',
                 '<text x="175" y="112">x toward rising azimuth,</text>',
                 '<text x="175" y="130">y toward rising elevation</text>'],
                'miss distance: where the star is, seen from the boresight')


def hysteresis():
    """One star, reached from below and from above: two readings."""
    return _svg(['<path class="c" d="M20 120H310M165 20V150"/>',
                 '<path class="a" d="M40 110L150 80M142 78L150 80L145 86"/>',
                 '<path class="a" d="M290 50L180 70M188 64L180 70L189 73"/>',
                 '<circle class="d" cx="165" cy="78" r="4"/><circle class="d" cx="165" cy="64" '
                 'r="4"/>', '<text x="28" y="98">from below</text>',
                 '<text x="228" y="44">from above</text>',
                 '<text class="l" x="172" y="146">the same star</text>',
                 '<text class="l" x="20" y="136">where the axis points</text>'],
                'hysteresis: the reading of one star depends on the side it was reached from')


def pages():
    """All pictures by file name, dict of str to str."""
    return {**{f'term_{name}.svg': term_picture(name) for name in DRAWN},
            'reference_mark.svg': reference_mark(), 'miss_distance.svg': miss_distance(),
            'hysteresis.svg': hysteresis()}


def skeleton_error(name, amount=1e-4):
    """Angle between the drawn line of sight and that of `pointing_model.geometry`, radians."""
    kind, _ = DRAWN[name]
    mount = parse_mount(kind, LATITUDE)
    own, sign = mount.names.terms[name]
    a, e = POSE[kind]
    drawn = Skeleton(kind, {own: sign * amount})
    ends = drawn.sight()
    looks = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    az, el = mount.horizon_of(*encoder_to_sky(a, e, {name: amount}, mount=mount))
    return float(np.linalg.norm(
        looks - [np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)]))


def main():
    """Write all pictures."""
    PICTURES.mkdir(exist_ok=True)
    for name, text in pages().items():
        (PICTURES / name).write_text(text, encoding='utf-8')
    print(f'{len(pages())} pictures in {PICTURES}')


if __name__ == '__main__':
    main()
