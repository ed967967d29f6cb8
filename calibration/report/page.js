(function () {
'use strict';
var doc = document, pinned = '', shown = '', told = doc.getElementById('told');
function all(query, root) { return Array.from((root || doc).querySelectorAll(query)); }
function words(row) {
  var heads = all('th', row.closest('table'));
  return Array.from(row.cells).map(function (cell, i) {
    var of = / ?([^ ]*)$/.exec(heads[i] ? heads[i].textContent : ''), unit = '';
    if (of[1] === '″' || of[1] === '°') { unit = of[1]; }
    var name = unit ? of.input.slice(0, of.index) : of.input;
    return (name + ' ' + cell.textContent + unit).trim(); }).join(', ');
}
function pin(key) {
  pinned = key;
  doc.dispatchEvent(new CustomEvent('pin', { detail: key }));
}
function light(key, byRow) {
  if (key === shown) { return; }
  all('.lit').forEach(function (e) { e.classList.remove('lit'); });
  shown = key;
  if (key === '') { if (told) { told.textContent = ''; } return; }
  all('[data-i="' + key + '"]').forEach(function (e) { e.classList.add('lit'); });
  var row = doc.querySelector('tr[data-i="' + key + '"]');
  if (row === null) { return; }
  if (told) { told.textContent = words(row); }
  var box = row.closest('.tall');
  if (box) { if (byRow === false) {
    box.scrollTop = row.offsetTop - box.clientHeight / 2; } }
}
function marks(svg) {
  if (svg.marks) { return svg.marks; }
  svg.marks = all('[data-i]', svg).map(function (e) {
    var path = e.tagName === 'g' ? e.querySelector('path') : e;
    var at = /M([-0-9.]+) ([-0-9.]+)/.exec(path.getAttribute('d'));
    return [Number(at[1]), Number(at[2]), e];
  });
  return svg.marks;
}
function nearest(svg, event) {
  var to = svg.getScreenCTM();
  if (to === null) { return ''; }
  var p = new DOMPoint(event.clientX, event.clientY).matrixTransform(to.inverse());
  var best = 16 / to.a, key = '';
  marks(svg).forEach(function (mark) {
    var far = Math.hypot(mark[0] - p.x, mark[1] - p.y);
    if (best > far) { if (mark[2].classList.contains('off') === false) {
      best = far; key = mark[2].dataset.i; } }
  });
  return key;
}
all('svg.link').forEach(function (svg) {
  svg.addEventListener('pointermove', function (event) {
    light(nearest(svg, event) || pinned, false); });
  svg.addEventListener('pointerleave', function () { light(pinned, false); });
  svg.addEventListener('click', function (event) {
    pin(nearest(svg, event)); light(pinned, false); });
});
all('table').forEach(function (table) {
  var rows = all('tbody tr[data-i]', table);
  if (rows.length === 0) { return; }
  var body = table.tBodies[0];
  function step(row) { all('tr[tabindex]', body).forEach(function (r) { r.tabIndex = -1; });
    row.tabIndex = 0; }
  rows.forEach(function (row) { row.tabIndex = -1; });
  rows[0].tabIndex = 0;
  body.addEventListener('pointerover', function (event) {
    var row = event.target.closest('tr[data-i]');
    if (row) { light(row.dataset.i, true); } });
  body.addEventListener('pointerleave', function () { light(pinned, true); });
  body.addEventListener('focusin', function (event) {
    var row = event.target.closest('tr[data-i]');
    if (row) { step(row); light(row.dataset.i, true); } });
  body.addEventListener('click', function (event) {
    var row = event.target.closest('tr[data-i]');
    if (row) { pin(row.dataset.i); light(pinned, true); } });
  body.addEventListener('keydown', function (event) {
    var way = { ArrowDown: 'nextElementSibling', ArrowUp: 'previousElementSibling' }[event.key];
    var row = event.target.closest('tr[data-i]');
    if (row === null) { return; }
    if (event.key === 'Enter') { pin(row.dataset.i); }
    if (way === undefined) { return; }
    do { row = row[way]; } while (row ? row.classList.contains('off') : false);
    if (row) { event.preventDefault(); row.focus(); }
  });
});
function value(row, column) { return row.cells[column].textContent.trim(); }
all('table.sort').forEach(function (table) {
  all('thead th', table).forEach(function (head, column) {
    var button = doc.createElement('button');
    button.type = 'button';
    button.append.apply(button, Array.from(head.childNodes));
    head.append(button);
    button.addEventListener('click', function () {
      var up = head.getAttribute('aria-sort') === 'descending';
      all('th', table).forEach(function (h) { h.removeAttribute('aria-sort'); });
      head.setAttribute('aria-sort', up ? 'ascending' : 'descending');
      var body = table.tBodies[0], rows = all('tr', body).map(function (row, i) {
        var text = value(row, column), clean = text.replace('\u2212', '-');
        var number = clean === '' ? NaN : Number(clean);
        return [row, number, text, i]; });
      rows.sort(function (a, b) {
        var an = isNaN(a[1]), bn = isNaN(b[1]);
        if (an !== bn) { return an ? 1 : -1; }
        var by = an ? a[2].localeCompare(b[2]) : a[1] - b[1];
        return (up ? by : -by) || a[3] - b[3]; });
      body.append.apply(body, rows.map(function (r) { return r[0]; }));
    });
  });
});
var group = doc.getElementById('group');
if (group) {
  group.closest('label').hidden = false;
  var of = {};
  all('tr[data-g]').forEach(function (row) { of[row.dataset.i] = row.dataset.g; });
  group.addEventListener('change', function () {
    all('[data-i]').forEach(function (e) {
      var own = of[e.dataset.i];
      var away = group.value === '' ? false : own === undefined ? false : own !== group.value;
      e.classList.toggle('off', away); });
    pin(''); light('');
    if (told) { told.textContent = group.selectedOptions[0].dataset.say || ''; }
  });
}
all('details').forEach(function (e) {
  e.addEventListener('toggle', function () { var key = shown; shown = ''; light(key, false); }); });
doc.addEventListener('keydown', function (event) {
  if (event.key === 'Escape') { pin(''); light(''); } });
addEventListener('beforeprint', function () {
  all('details').forEach(function (e) { e.open = true; }); });
}());
