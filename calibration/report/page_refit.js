/* Rows excluded in the page: a linear refit of its terms, a preview of the command's. */
(function () {
'use strict';
var doc = document, box = doc.getElementById('refit');
if (!box) { return; }
var data = JSON.parse(box.dataset.refit), keys = data.keys.split(' '), n = keys.length;
var gone = new Uint8Array(n);  // a mask of `out`
var row = {}, out = new Set(), past = [], pinned = '', panel = null, later = 0;
keys.forEach(function (key, i) { row[key] = i; });
function bytes(text) {
  return Uint8Array.from(atob(text), function (c) { return c.charCodeAt(0); }).buffer; }
function half(one) {
  if (!one) { return null; }
  var whole = bytes(one[1]);
  return Float64Array.from(one[2] === 2 ? new Int16Array(whole) : new Int32Array(whole),
    function (v) { return v * one[0]; }); }
var columns = data.columns.map(function (c) { return c.map(half); });
var angle = half(data.angle);
data.models.forEach(function (m) {
  m.residual = m.residual.map(function (one) { return half(one) || new Float64Array(n); });
  m.weights = m.weights ? m.weights.map(function (one) { return new Float32Array(bytes(one)); })
    : null;
  if (m.loss) { m.loss.weights = new Float32Array(bytes(m.loss.weights)); }
  m.now = { values: m.values || [], sigmas: [], residual: m.residual };
});
/* inverse of a symmetric positive matrix, by Cholesky of unit diagonal; null: singular */
function inverse(a, k) {
  var s = [], l = new Float64Array(k * k), v = new Float64Array(k * k), i, j, m, t;
  for (i = 0; i < k; i++) { s[i] = Math.sqrt(a[i * k + i]); if (!(s[i] > 0)) { return null; } }
  for (i = 0; i < k; i++) {
    for (j = 0; j <= i; j++) {
      t = a[i * k + j] / s[i] / s[j];
      for (m = 0; m < j; m++) { t -= l[i * k + m] * l[j * k + m]; }
      if (i === j) { if (!(t > 1e-12)) { return null; } l[i * k + i] = Math.sqrt(t); }
      else { l[i * k + j] = t / l[j * k + j]; }
    }
  }
  for (j = 0; j < k; j++) {
    var y = new Float64Array(k);
    for (i = j; i < k; i++) {
      t = i === j ? 1 : 0;
      for (m = j; m < i; m++) { t -= l[i * k + m] * y[m]; }
      y[i] = t / l[i * k + i];
    }
    for (i = k - 1; i >= 0; i--) {
      t = y[i];
      for (m = i + 1; m < k; m++) { t -= l[m * k + i] * v[m * k + j]; }
      v[i * k + j] = t / l[i * k + i];
    }
  }
  for (i = 0; i < k; i++) { for (j = 0; j < k; j++) { v[i * k + j] /= s[i] * s[j]; } }
  return v;
}
function times(a, b, k) {
  var c = new Float64Array(k * k);
  for (var i = 0; i < k; i++) { for (var m = 0; m < k; m++) {
    for (var j = 0; j < k; j++) { c[i * k + j] += a[i * k + m] * b[m * k + j]; } } }
  return c;
}
/* normal matrix of each axis, its inverse, and the step; a loss has weights of its own */
function solve(model, weights, whole) {
  var k = model.of.length, g = new Float64Array(k), normal = [new Float64Array(k * k),
    new Float64Array(k * k)], i, a, b, w, axis;
  var weighed = new Float64Array(n), product;
  for (axis = 0; axis < 2; axis++) {
    w = weights[axis % weights.length];
    var r = model.residual[axis];
    for (a = 0; a < k; a++) {
      var one = columns[model.of[a]][axis];
      if (!one) { continue; }
      for (i = 0; i < n; i++) {
        product = w[i] * one[i];
        weighed[i] = gone[i] ? 0 : product;
        if (gone[i] ? !whole : whole) { g[a] += (whole ? product : -product) * r[i]; }
      }
      for (b = 0; b <= a; b++) {
        var other = columns[model.of[b]][axis];
        if (!other) { continue; }
        var sum = 0;
        for (i = 0; i < n; i++) { sum += weighed[i] * other[i]; }
        normal[axis][a * k + b] = normal[axis][b * k + a] = sum;
      }
    }
  }
  var inv = inverse(normal[0].map(function (v, m) { return v + normal[1][m]; }), k);
  if (!inv) { return null; }
  var step = new Float64Array(k);
  for (a = 0; a < k; a++) { for (b = 0; b < k; b++) { step[a] += inv[a * k + b] * g[b]; } }
  return { inv: inv, first: normal[0], step: step, residual: model.residual.map(
    function (r, axis) {
      var left = Float64Array.from(r);
      model.of.forEach(function (c, a) {
        var one = columns[c][axis];
        if (one) { for (var i = 0; i < n; i++) { left[i] -= step[a] * one[i]; } } });
      return left; }) };
}
function sums(weights, residual, all) {
  var total = 0, squares = [0, 0];
  for (var i = 0; i < n; i++) { if (all || !gone[i]) { total += weights[0][i];
    squares[0] += weights[0][i] * residual[0][i] ** 2;
    squares[1] += weights[0][i] * residual[1][i] ** 2; } }
  return { total: total, squares: squares };
}
/* weights of the radial distance, at scales that follow the rows that stay */
function reweighted(model) {
  var table = model.loss.weights, most = table.length - 1, s = model.loss.scales;
  var k = model.of.length, found = null, round, i;
  var weights = model.weights, before = sums(weights, model.residual, true);
  function spread(total) { return total / Math.max(total - k / 2, 1); }
  for (round = 0; round < 40; round++) {
    var last = found;
    found = solve(model, weights, true);
    if (!found) { return null; }
    var now = sums(weights, found.residual, false), r = found.residual, row = new Float64Array(n);
    var scale = s.map(function (v, m) { return v * Math.sqrt(now.squares[m] / now.total
      / (before.squares[m] / before.total) * spread(now.total) / spread(before.total)); });
    for (i = 0; i < n; i++) {
      var place = Math.hypot(r[0][i] / scale[0], r[1][i] / scale[1]) / model.loss.reach * most;
      var at = Math.min(Math.floor(place), most - 1);
      var w = place < most ? table[at] + (place - at) * (table[at + 1] - table[at]) : table[most];
      row[i] = model.weights[0][i] > 0 || w > 0.5 ? w : 0;
    }
    if (last && found.step.every(function (v, m) { return Math.abs(v - last.step[m]) < 1e-8; })) {
      break; }
    weights = [row];
  }
  found.weights = weights;
  return found;
}
function refit(model) {
  var k = model.of.length, a;
  var found = model.loss ? reweighted(model) : solve(model, model.weights, false);
  if (!found) { return null; }
  var cov = found.inv;
  if (!model.given) {
    var hat = times(cov, found.first, k), byX = times(hat, cov, k), used = 0;
    var of = sums(found.weights || model.weights, found.residual, false);
    for (a = 0; a < k; a++) { used += hat[a * k + a]; }
    var free = [of.total - used, of.total - k + used];
    var variance = of.squares.map(function (v, m) { return v / free[m] / model.consistency; });
    if (!(Math.min(free[0], free[1]) > 0.5)) {
      variance[0] = variance[1] = (of.squares[0] + of.squares[1])
        / Math.max(2 * of.total - k, 1e-9) / model.consistency; }
    cov = byX.map(function (v, m) { return variance[0] * v
      + variance[1] * (found.inv[m] - v); });
  }
  return { values: model.values.map(function (v, m) { return v + found.step[m]; }),
    residual: found.residual, sigmas: model.values.map(function (v, m) {
      return Math.sqrt(Math.max(cov[m * k + m] * model.inflation, 0)); }) };
}
function rms(model) {
  var sum = 0, count = 0, r = model.now.residual;
  for (var i = 0; i < n; i++) { if (data.used[i] === '1' && !out.has(i)) {
    count += 1; sum += r[0][i] ** 2 + r[1][i] ** 2; } }
  return Math.sqrt(sum / Math.max(count, 1));
}
/* ------------------------------------------------------------------------------- what moves */
var of = {};
data.models.forEach(function (m) { of[m.when] = m; m.first = rms(m); });
var last = data.models[data.models.length - 1], moving = null;
function found() {
  if (moving) { return moving; }
  moving = [];
  function place(text) { return text ? text.split(' ').map(Number) : null; }
  doc.querySelectorAll('g[data-when]').forEach(function (g) {
    var x = place(g.dataset.x), y = place(g.dataset.y), model = of[g.dataset.when];
    g.querySelectorAll('path[data-i]').forEach(function (e) {
      var part = /^M([-0-9.]+) ([-0-9.]+)(.*)$/.exec(e.getAttribute('d'));
      moving.push([e, row[e.dataset.i], model, x, y, part]); }); });
  doc.querySelectorAll('g[data-arrows]').forEach(function (g) {
    var size = place(g.dataset.arrows), model = of[g.classList[0]];
    g.querySelectorAll('g[data-i]').forEach(function (e) {
      var c = e.querySelector('circle');
      moving.push([e.querySelector('path'), row[e.dataset.i], model, size, null,
        [null, c.getAttribute('cx'), c.getAttribute('cy')], e]); }); });
  moving = moving.filter(function (m) { return m[1] !== undefined && m[2]; });
  moving.forEach(function (m) { m.fold = m[0].closest('details'); });
  return moving;
}
function short(v) { return v.toFixed(1).replace(/\.0$/, ''); }
function arrow(x, y, dx, dy) {
  var d = 'M' + x + ' ' + y + 'l' + short(dx) + ' ' + short(dy), far = Math.hypot(dx, dy);
  if (far > 3) {
    var head = Math.min(5, 0.45 * far), ux = dx / far, uy = dy / far;
    [1, -1].forEach(function (side) { d += 'M' + short(Number(x) + dx) + ' ' + short(Number(y) + dy)
      + 'l' + short(head * (-ux + 0.5 * side * uy)) + ' ' + short(head * (-uy - 0.5 * side * ux)); });
  }
  return d;
}
/* what is folded is drawn when it opens */
function draw(fold) {
  found().forEach(function (m) {
    if (fold ? m.fold !== fold : m.fold && !m.fold.open) { return; }
    var i = m[1], r = m[2].now.residual, part = m[5], d;
    function to(p, old) { return p ? short(Math.min(Math.max(p[1] + p[2] * r[p[0]][i], p[3]), p[4]))
      : old; }
    if (m.length === 7) {
      var c = Math.cos(angle[i]), s = Math.sin(angle[i]), size = m[3];
      var dx = size[0] * (r[0][i] * c - data.flip * r[1][i] * s);
      var dy = size[0] * (r[0][i] * s + data.flip * r[1][i] * c);
      var cap = Math.min(1, size[1] / Math.max(Math.hypot(dx, dy), 1e-9));
      d = arrow(part[1], part[2], cap * dx, cap * dy);
      m[6].classList.toggle('out', out.has(i));
    } else {
      d = 'M' + to(m[3], part[1]) + ' ' + to(m[4], part[2]) + part[3];
      m[0].classList.toggle('out', out.has(i));
    }
    m[0].setAttribute('d', d);
  });
  doc.querySelectorAll('svg').forEach(function (svg) { svg.marks = null; });
}
/* -------------------------------------------------------------------------- tables, panel */
function signed(v, digits) {
  var text = v.toFixed(digits);
  if (Number(text) === 0) { text = (0).toFixed(digits); } else if (v > 0) { text = '+' + text; }
  return text.replace('-', '\u2212');
}
function digits(sigma) {
  return sigma > 0 ? Math.min(Math.max(1 - Math.floor(Math.log10(sigma)), 0), 6) : 3; }
function each(rows, todo) { rows.forEach(function (r) { todo(r, Array.from(r.cells)); }); }
function tables() {
  var place = {};
  last.names.forEach(function (name, i) { place[name] = i; });
  each(doc.querySelectorAll('table.terms tbody tr'), function (r, cells) {
    var i = place[cells[0].textContent];
    if (i === undefined) { return; }
    if (!r.first) { r.first = cells.map(function (c) { return c.textContent; }); }
    var s = last.now.sigmas[i], d = digits(s), v = last.now.values[i];
    var now = out.size ? [signed(v, d), s.toFixed(d), Math.abs(v / s).toFixed(1)]
      : r.first.slice(1, 4);
    [1, 2, 3].forEach(function (at) { cells[at].textContent = now[at - 1]; });
  });
  doc.querySelectorAll('[data-rms]').forEach(function (e) {
    if (!e.first) { e.first = e.textContent; }
    e.textContent = out.size ? rms(of[e.dataset.rms]).toFixed(2) + '\u2033' : e.first; });
}
function stars() {
  each(doc.querySelectorAll('table.stars tbody tr[data-i]'), function (r, cells) {
    var i = row[r.dataset.i];
    if (i === undefined) { return; }
    if (!r.words) { r.words = cells[cells.length - 1].textContent; }
    data.models.forEach(function (m) {  // last but for what became of the row
      var first = cells.length - (m.when === 'before' ? 7 : 4), v = m.now.residual;
      [signed(v[0][i], 2), signed(v[1][i], 2), Math.hypot(v[0][i], v[1][i]).toFixed(2)].forEach(
        function (text, at) { cells[first + at].textContent = text; }); });
    r.classList.toggle('out', out.has(i));
    cells[cells.length - 1].textContent = out.has(i) ? 'excluded here' : r.words;
  });
}
/* numbers and ranges of the rows that are out, as --exclude takes them */
function ranges() {
  var order = keys.map(function (k, i) { return i; }).sort(function (a, b) {
    return data.rows[a] - data.rows[b]; }), text = [], first = null, end = null;
  function close() { if (first !== null) {
    text.push(first === end ? first : first + '-' + end); first = null; } }
  order.forEach(function (i) {
    if (!out.has(i)) { close(); return; }
    if (first === null) { first = data.rows[i]; }
    end = data.rows[i]; });
  close();
  return text.join(',');
}
function element(kind, text, parent) {
  var e = doc.createElement(kind);
  if (text) { e.textContent = text; }
  if (parent) { parent.append(e); }
  return e;
}
function button(text, parent, todo) {
  var b = element('button', text, parent);
  b.type = 'button'; b.addEventListener('click', todo);
  return b;
}
function count() { return out.size + (out.size === 1 ? ' row' : ' rows') + ' excluded'; }
function change() { return 'RMS ' + last.first.toFixed(2) + '\u2033 \u2192 ' + rms(last).toFixed(2)
  + '\u2033'; }
function show(trouble) {
  if (!panel) {
    panel = element('section'); panel.id = 'preview';
    doc.querySelector('.controls').insertAdjacentElement('afterend', panel);
  }
  panel.hidden = !out.size;
  panel.replaceChildren();
  doc.body.classList.toggle('previewing', out.size > 0);
  if (out.size) {
    element('h2', 'Preview: ' + count() + ', ' + change(), panel);
    element('p', 'A linear refit in this page; effects are not chosen again. Dimmed figures still '
      + 'have all rows. To refit for good:', panel);
    var line = element('p', '', panel), code = element('code', data.command + ranges(), line);
    code.id = 'command';
    button('Copy', line, function () {
      var range = doc.createRange();
      range.selectNodeContents(code);
      getSelection().removeAllRanges(); getSelection().addRange(range);
      if (navigator.clipboard) { navigator.clipboard.writeText(code.textContent).catch(function () {
        return null; }); } });
    button('Undo', line, undo);
    button('Include all', line, function () { apply(new Set()); });
    var wide = element('div', '', panel), table = element('table', '', wide);
    wide.className = 'scroll'; table.className = 'numbers';
    var head = element('tr', '', element('thead', '', table)), body = element('tbody', '', table);
    ['term', 'all rows \u2033', 'preview \u2033', '\u03c3 \u2033', 'change / \u03c3'].forEach(
      function (text) { element('th', text, head); });
    last.names.forEach(function (name, i) {
      var v = last.values[i], now = last.now.values[i], s = last.now.sigmas[i], d = digits(s);
      var r = element('tr', '', body);
      [name, signed(v, d), signed(now, d), s.toFixed(d), signed((now - v) / s, 1)].forEach(
        function (text) { element('td', text, r); }); });
  }
  foot(trouble);
}
function foot(trouble) {
  var acts = doc.getElementById('acts');
  acts.replaceChildren();
  var i = row[pinned];
  if (i !== undefined) {
    button(out.has(i) ? 'Include' : 'Exclude', acts, function () { toggle(i); }); }
  if (out.size) {
    element('span', 'Preview: ' + count() + ', ' + change(), acts);
    button('Undo', acts, undo);
  }
  if (trouble) { element('span', trouble, acts); }
}
function apply(next, back) {
  var old = out;
  out = next;
  gone.fill(0); out.forEach(function (i) { gone[i] = 1; });
  var now = data.models.map(function (m) { return m.of ? out.size ? refit(m)
    : { values: m.values, sigmas: [], residual: m.residual } : m.now; });
  if (now.indexOf(null) >= 0) {
    out = old; gone.fill(0); out.forEach(function (i) { gone[i] = 1; });
    foot('These rows are needed: without them the terms are undetermined.');
    return;
  }
  if (!back) { past.push(old); }
  data.models.forEach(function (m, i) { m.now = now[i]; });
  tables(); show(); draw();
  clearTimeout(later);
  later = setTimeout(stars, 30);  // a long table takes longest
}
function toggle(i) {
  var next = new Set(out);
  if (!next.delete(i)) { next.add(i); }
  apply(next);
}
function undo() { if (past.length) { apply(past.pop(), true); } }
doc.querySelectorAll('details').forEach(function (e) {
  e.addEventListener('toggle', function () { if (e.open && panel) { draw(e); } }); });
doc.addEventListener('pin', function (e) { pinned = e.detail; foot(); });
doc.addEventListener('keydown', function (e) {
  if ((e.key === 'Delete' || e.key === 'x') && row[pinned] !== undefined
      && !e.ctrlKey && !e.metaKey) { toggle(row[pinned]); } });
setTimeout(found, 200);
/* for tests: what a click does, and what came of it */
window.refitPreview = { exclude: function (lines) {
  apply(new Set(lines.map(function (line) { return data.rows.indexOf(line); }))); },
  terms: function () { return last.names.map(function (name, i) {
    return [name, last.now.values[i], last.now.sigmas[i]]; }); },
  rms: function () { return rms(last); } };
}());
