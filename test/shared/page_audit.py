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

"""What is wrong with a page in a browser: cut, too long, too faint, a script that failed."""

WIDTHS = 390, 1280

#: what a browser leaves out until it is scrolled into sight is drawn too
ALL_DRAWN = """const all = document.createElement('style');
  all.textContent = '* { content-visibility: visible !important }';
  document.head.append(all);"""

#: opens all parts, then looks at every text that is drawn: contrast after WCAG 2.1 (1.4.3, AA), and
#: whether it reaches out of the window or of a box that cuts it
_AUDIT = '(() => {' + ALL_DRAWN + r"""
  document.querySelectorAll('details').forEach(e => { e.open = true });
  const canvas = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
  const known = {};
  const colour = text => {
    if (!known[text]) {
      canvas.clearRect(0, 0, 1, 1); canvas.fillStyle = text; canvas.fillRect(0, 0, 1, 1);
      const c = canvas.getImageData(0, 0, 1, 1).data;
      known[text] = [c[0], c[1], c[2], c[3] / 255];
    }
    return known[text];
  };
  const over = (top, below, alpha) => top.slice(0, 3).map(
    (v, i) => v * alpha + below[i] * (1 - alpha));
  const ground = e => {
    const layers = [];
    for (let at = e; at; at = at.parentElement) {
      const c = colour(getComputedStyle(at).backgroundColor);
      if (c[3] > 0) { layers.push(c); if (c[3] > 0.99) { break } }
    }
    return layers.reverse().reduce((below, c) => over(c, below, c[3]), [255, 255, 255]);
  };
  const light = c => {
    const l = c.map(v => v / 255).map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * l[0] + 0.7152 * l[1] + 0.0722 * l[2];
  };
  const out = [], wide = document.documentElement.clientWidth;
  const walk = document.createTreeWalker(document.querySelector('main'), NodeFilter.SHOW_TEXT);
  if (document.documentElement.scrollWidth > wide) { out.push('wider than the window') }
  const first = document.querySelector('.verdict');
  if (wide < 400 && first && first.getBoundingClientRect().bottom + scrollY > 2 * 844) {
    out.push('the first layer is longer than two screens of a phone') }
  while (walk.nextNode()) {
    const node = walk.currentNode, e = node.parentElement, text = node.textContent.trim();
    if (!text || e.closest('title,caption,.unseen,[hidden]') || !e.getClientRects().length) {
      continue }
    const look = getComputedStyle(e), drawn = e.namespaceURI.endsWith('svg');
    if (look.visibility === 'hidden' || look.display === 'none') { continue }
    const disc = drawn && e.previousElementSibling?.tagName === 'circle'
      && e.parentElement.tagName === 'g' ? e.previousElementSibling : null;
    const ink = colour(drawn ? look.fill : look.color);
    const below = disc ? colour(getComputedStyle(disc).fill).slice(0, 3) : ground(e);
    let alpha = ink[3] * (drawn ? Number(look.fillOpacity) : 1);
    for (let at = e; at; at = at.parentElement) { alpha *= Number(getComputedStyle(at).opacity) }
    if (e.closest('.tools')) { continue }
    const a = light(over(ink, below, alpha)), b = light(below);
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    const size = parseFloat(look.fontSize), bold = Number(look.fontWeight) >= 700;
    const least = size >= 24 || (bold && size >= 18.66) ? 3 : 4.5;
    if (ratio < least) { out.push(`contrast ${ratio.toFixed(2)}: ${text.slice(0, 40)}`) }
    const range = document.createRange();
    range.selectNodeContents(node);
    const box = drawn ? e.getBoundingClientRect() : range.getBoundingClientRect();
    if (e.closest('.scroll')) { continue }
    if (box.right > wide + 1 || box.left < -1) { out.push(`cut: ${text.slice(0, 40)}`) }
    const frame = drawn && e.closest('svg').getBoundingClientRect();
    if (frame && (box.right > frame.right + 2 || box.left < frame.left - 2
        || box.bottom > frame.bottom + 2 || box.top < frame.top - 2)) {
      out.push(`cut by its drawing: ${text.slice(0, 40)}`) }
  }
  return [...new Set(out)];
})()"""


def audit(browser, path, width, dark):
    """Problems of a page at a width, in light or dark, list of str."""
    browser.window(width, dark)
    browser.show(path)
    return [*browser.run(_AUDIT), *browser.complaints]
