/* Zoom, pan and export of each plot. */
(function () {
'use strict';
var doc = document, NEAREST = 40;
function home(svg) {
  if (!svg.home) { svg.home = svg.getAttribute('viewBox').split(' ').map(Number); svg.box = svg.home; }
  return svg.home;
}
function set(svg, box) {
  var h = home(svg), w = Math.min(Math.max(box[2], h[2] / NEAREST), h[2]), z = h[2] / w;
  var high = h[3] / z;
  svg.box = [Math.min(Math.max(box[0], h[0]), h[0] + h[2] - w),
    Math.min(Math.max(box[1], h[1]), h[1] + h[3] - high), w, high];
  svg.setAttribute('viewBox', svg.box.join(' '));
  svg.classList.toggle('zoomed', z > 1.001);
  svg.style.setProperty('--zoom', z);
}
function zoom(svg, by, at) {
  home(svg);
  var b = svg.box, w = Math.min(Math.max(b[2] / by, svg.home[2] / NEAREST), svg.home[2]);
  var part = w / b[2];
  at = at || { x: b[0] + b[2] / 2, y: b[1] + b[3] / 2 };
  set(svg, [at.x - (at.x - b[0]) * part, at.y - (at.y - b[1]) * part, w, b[3] * part]);
}
function pan(svg, dx, dy) { home(svg); var b = svg.box; set(svg, [b[0] + dx, b[1] + dy, b[2], b[3]]); }
function place(svg, e) {
  return new DOMPoint(e.clientX, e.clientY).matrixTransform(svg.getScreenCTM().inverse());
}
/* a drawing that stands alone: what the style sheet says goes into each element */
var STYLE = ['fill', 'fill-opacity', 'stroke', 'stroke-width', 'stroke-opacity', 'stroke-dasharray',
  'stroke-linecap', 'font-size', 'font-weight', 'opacity', 'paint-order', 'display'];
function alone(svg) {
  home(svg);
  var copy = svg.cloneNode(true), own = [svg].concat(Array.from(svg.querySelectorAll('*')));
  [copy].concat(Array.from(copy.querySelectorAll('*'))).forEach(function (e, i) {
    var look = getComputedStyle(own[i]), text = '';
    if (e.tagName !== 'title') {
      STYLE.forEach(function (name) { text += name + ':' + look.getPropertyValue(name) + ';'; });
      e.setAttribute('style', text);
    }
    e.removeAttribute('class');
  });
  copy.setAttribute('style', 'font-family:sans-serif;background:'
    + getComputedStyle(doc.documentElement).getPropertyValue('--card'));
  copy.setAttribute('width', svg.box[2]); copy.setAttribute('height', svg.box[3]);
  return new XMLSerializer().serializeToString(copy);
}
function save(address, svg, kind) {
  var link = doc.createElement('a');
  link.href = address;
  link.download = (svg.getAttribute('aria-label') || 'plot').toLowerCase()
    .replace(/[^a-z0-9]+/g, '-').slice(0, 60).replace(/^-|-$/g, '') + '.' + kind;
  link.click();
}
function saveSvg(svg) { save('data:image/svg+xml;charset=utf-8,' + encodeURIComponent(alone(svg)), svg, 'svg'); }
function savePng(svg) {
  var image = new Image(), sharp = 3, text = alone(svg);
  image.onload = function () {
    var canvas = doc.createElement('canvas');
    canvas.width = sharp * svg.box[2]; canvas.height = sharp * svg.box[3];
    var to = canvas.getContext('2d');
    to.fillStyle = getComputedStyle(doc.documentElement).getPropertyValue('--card');
    to.fillRect(0, 0, canvas.width, canvas.height);
    to.drawImage(image, 0, 0, canvas.width, canvas.height);
    save(canvas.toDataURL('image/png'), svg, 'png');
  };
  image.src = 'data:image/svg+xml;charset=utf-8,' + encodeURIComponent(text);
}
function tools(svg) {
  if (svg.tools) { return; }
  var bar = svg.tools = doc.createElement('div');
  bar.className = 'tools'; svg.parentNode.append(bar);
  [['+', 'zoom in', function () { zoom(svg, 1.6); }],
    ['\u2212', 'zoom out', function () { zoom(svg, 1 / 1.6); }],
    ['Reset', 'whole plot', function () { set(svg, home(svg)); }],
    ['SVG', 'save as SVG', function () { saveSvg(svg); }],
    ['PNG', 'save as PNG', function () { savePng(svg); }]].forEach(function (one) {
    var button = doc.createElement('button');
    button.type = 'button'; button.textContent = one[0]; button.title = one[1];
    button.setAttribute('aria-label', one[1]);
    button.addEventListener('click', function (e) { e.stopPropagation(); one[2](); });
    bar.append(button);
  });
}
function handle(svg) {
  var fingers = new Map(), from = null, apart = 0, moved = false;
  var frame = doc.createElement('div');
  frame.className = 'plot'; svg.parentNode.insertBefore(frame, svg); frame.append(svg);
  svg.tabIndex = 0;
  svg.addEventListener('focus', function () { tools(svg); });
  svg.addEventListener('pointerenter', function () { tools(svg); });
  svg.addEventListener('wheel', function (e) {
    /* a page scrolls on, until a plot is clicked or Ctrl is held */
    if (!(e.ctrlKey || doc.activeElement === svg)) { return; }
    e.preventDefault();
    zoom(svg, Math.exp(-e.deltaY / (e.ctrlKey ? 100 : 400)), place(svg, e));
  }, { passive: false });
  svg.addEventListener('pointerdown', function (e) {
    tools(svg); home(svg); moved = false;
    fingers.set(e.pointerId, e); from = place(svg, e); apart = 0;
  });
  svg.addEventListener('pointermove', function (e) {
    if (!fingers.has(e.pointerId)) { return; }
    var before = fingers.get(e.pointerId);
    if (Math.hypot(e.clientX - before.clientX, e.clientY - before.clientY) < 4 && !moved) { return; }
    if (fingers.size === 2) {
      fingers.set(e.pointerId, e);
      var two = Array.from(fingers.values());
      var far = Math.hypot(two[0].clientX - two[1].clientX, two[0].clientY - two[1].clientY);
      if (apart > 0) { zoom(svg, far / apart, place(svg, { clientX: (two[0].clientX
        + two[1].clientX) / 2, clientY: (two[0].clientY + two[1].clientY) / 2 })); }
      apart = far; moved = true;
    } else if (svg.classList.contains('zoomed')) {
      if (!moved) { svg.setPointerCapture(e.pointerId); }
      moved = true;
      var to = place(svg, e);
      pan(svg, from.x - to.x, from.y - to.y);
    }
  });
  ['pointerup', 'pointercancel'].forEach(function (kind) {
    svg.addEventListener(kind, function (e) { fingers.delete(e.pointerId); apart = 0; }); });
  /* what ends a drag is no click on a star */
  svg.addEventListener('click', function (e) {
    if (moved) { e.stopImmediatePropagation(); moved = false; } }, true);
  svg.addEventListener('dblclick', function () { set(svg, home(svg)); });
  svg.addEventListener('keydown', function (e) {
    var step = home(svg) ? svg.box[2] / 8 : 0;
    var by = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step],
      ArrowDown: [0, step] }[e.key];
    if (e.key === '+' || e.key === '=') { zoom(svg, 1.6); }
    else if (e.key === '-') { zoom(svg, 1 / 1.6); }
    else if (e.key === '0') { set(svg, home(svg)); }
    else if (by && svg.classList.contains('zoomed')) { pan(svg, by[0], by[1]); }
    else { return; }
    e.preventDefault();
  });
}
doc.querySelectorAll('main svg').forEach(handle);
}());
