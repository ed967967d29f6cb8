"""How the pages look: colours that the colour-blind tell apart, light and dark, and paper."""

CSS = """
:root { color-scheme:light dark; --ink:#1b2430; --soft:#57626f; --line:#d9dee5; --card:#fff;
  --page:#f3f5f8; --before:#7a6a58; --after:#0072b2; --fit:#d55e00; --third:#2d0a33;
  --good:#009e73; --bar:#c9bfb2; --grid:#e6eaef; --zero:#9aa4b1; --rim:#aab3bf; --lit:#c2187a;
  --warn:#e69f00 }
@media (prefers-color-scheme:dark) { :root { --ink:#e6eaf0; --soft:#a3aebb; --line:#38424e;
  --card:#1a2129; --page:#10151b; --before:#c8b8a2; --after:#56b4e9; --fit:#f0803c;
  --third:#8560f5; --good:#3cc79b; --bar:#6d6355; --grid:#2c353f; --zero:#67727f; --rim:#56616d;
  --lit:#ff7ac6 } }
* { box-sizing:border-box }
html { -webkit-text-size-adjust:100% }
body { margin:0; background:var(--page); color:var(--ink);
  font:16px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif }
main { max-width:1440px; margin:0 auto; padding:24px clamp(10px,2.4vw,28px) 60px }
h1 { font-size:1.05rem; font-weight:600; color:var(--soft); margin:0 0 2px; letter-spacing:.01em }
h2 { font-size:1.15rem; margin:0 0 10px } h2.part { font-size:1.3rem; margin:34px 0 2px }
h3 { font-size:1.02rem; margin:20px 0 4px }
h3:first-of-type { margin-top:4px }
p { margin:6px 0 10px; max-width:78ch }
.meta,.note,figcaption { color:var(--soft); font-size:.88rem }
.meta { margin:0 0 18px; max-width:none; overflow-wrap:anywhere }
section { background:var(--card); border:1px solid var(--line); border-radius:10px;
  padding:18px clamp(12px,2vw,22px); margin:16px 0; overflow-wrap:break-word }
.verdict { border-left:6px solid var(--after) }
.verdict.ambiguous,.verdict.unknown,.verdict.undecided,.verdict.wanders,.verdict.alarm {
  border-left-color:var(--warn) }
.verdict.none { border-left-color:var(--good) }
.verdict h2 { font-size:1.5rem; line-height:1.25; margin:4px 0 8px }
.verdict ul { margin:6px 0 4px; padding-left:20px; font-size:1.05rem }
.verdict ol.ranked { margin:6px 0 10px; padding-left:26px }
.verdict li p { margin:3px 0 8px; font-size:.95rem; max-width:none }
.verdict li b { font-weight:620 } .folding th { white-space:normal }
.folding th,.folding td { padding-left:6px; padding-right:6px }
.ranked li { margin:12px 0 } .ranked li:first-child b { font-size:1.2rem }
.ranked .size { display:block; height:6px; margin:5px 0 4px; max-width:420px }
.verdict .then { font-size:1.15rem; margin:-2px 0 8px; max-width:none }
.ranked .size i { display:block; height:100%; background:var(--warn); border-radius:3px }
li { max-width:90ch; overflow-wrap:anywhere }
.badge { display:inline-block; font-size:.78rem; font-weight:600; letter-spacing:.05em;
  text-transform:uppercase; color:var(--soft) }
.numbers-row { display:flex; flex-wrap:wrap; gap:10px 26px; margin:14px 0 4px }
.numbers-row div { line-height:1.15; flex:1 1 0; min-width:13ch; max-width:21ch }
.numbers-row b { display:block; font-size:1.7rem; font-weight:650;
  font-variant-numeric:tabular-nums }
.numbers-row span { color:var(--soft); font-size:.85rem }
.pair { display:grid; grid-template-columns:repeat(auto-fit,minmax(min(100%,330px),1fr));
  gap:8px 22px; align-items:start }
.pair figure,.pair>svg { max-width:640px; width:100% }
.effect.one { display:grid; grid-template-columns:minmax(0,1fr) minmax(0,440px); gap:20px }
.side { display:grid; grid-template-columns:minmax(0,280px) minmax(0,1fr); gap:20px;
  align-items:start }
.side th { white-space:normal }
@media (max-width:760px) { .side,.effect.one { grid-template-columns:minmax(0,1fr) } }
figure { margin:8px 0 14px; break-inside:avoid }
svg { display:block; width:100%; height:auto; font-family:inherit; break-inside:avoid }
.frame,.rim { fill:none; stroke:var(--rim) }
.grid { fill:none; stroke:var(--grid) }
.grid.axes { stroke:var(--rim); stroke-width:.7; stroke-dasharray:2 3 }
text.axes { font-size:9px; fill:var(--soft) } .zero { stroke:var(--zero); fill:none }
.tick { font-size:11px; fill:var(--soft) }
.strong { fill:var(--ink); paint-order:stroke; stroke:var(--card); stroke-width:3px }
.label { font-size:12px; fill:var(--ink); fill-opacity:.85 }
.title { font-size:12.5px; font-weight:600; fill:var(--ink) }
circle.before,.before circle { fill:var(--before); fill-opacity:.75 }
.after circle { fill:var(--after); fill-opacity:.9 }
path.dots,.dots path { fill:none; stroke-width:4.4; stroke-linecap:round; stroke-opacity:.75 }
path.after.dots,.after.dots path { stroke-linecap:square; stroke-width:3.8 }
path.third.dots { stroke:none; fill:var(--third); fill-opacity:.8 }
path.before.dots.big,.before.big.dots path { stroke-width:7.5 }
path.after.dots.big,.after.big.dots path { stroke-width:6 }
path.before.dots,.before path,path.before.key { stroke:var(--before) }
path.after.dots,.after path,path.after.key { stroke:var(--after) }
.before path,.after path,path.key { fill:none; stroke-width:1.3 }
.before.dots path { stroke-width:4.4 } .after.dots path { stroke-width:3.8 }
path.key { stroke-width:3 }
.crosses path { fill:none; stroke-width:1.6; stroke-opacity:.9 }
.bars-of path { fill:none; stroke-width:1.2; stroke-opacity:.75 }
path.fit { stroke:var(--fit); stroke-width:2.4; fill:none; stroke-linecap:round;
  stroke-opacity:.85 }
path.noise,circle.noise { fill:none; stroke:var(--fit); stroke-width:1.6; stroke-dasharray:5 3 }
circle.noise { fill:var(--fit); fill-opacity:.07 }
path.band { fill:var(--after); fill-opacity:.16; stroke:none }
path.level { fill:none; stroke:var(--after); stroke-width:1.6 }
path.expected { fill:none; stroke:var(--fit); stroke-width:1.8 }
path.error { fill:none; stroke:var(--before); stroke-width:1.2 }
path.step { fill:none; stroke:var(--fit); stroke-width:1.6; stroke-dasharray:5 3 }
path.tonight { fill:none; stroke:var(--fit); stroke-width:2.4 }
.series { fill:none; stroke-width:1.3; stroke-opacity:.8 } .series.before { stroke:var(--before) }
.series.after { stroke:var(--after) } .series.fit { stroke:var(--fit); stroke-width:1.3 }
.series.third { stroke:var(--third); stroke-dasharray:5 2 } .series.before { stroke-dasharray:2 2 }
path.fit.dots { stroke-width:1.6; stroke-linecap:butt }
path.gap { fill:none; stroke:var(--line); stroke-width:1; stroke-dasharray:3 3 }
rect.count { fill:var(--bar) }
path.beyond { fill:var(--card); stroke:var(--ink); stroke-width:1 }
path.area { stroke-width:1.4 }
path.before.area { fill:var(--before); fill-opacity:.22; stroke:var(--before) }
path.after.area { fill:none; stroke:var(--after); stroke-width:2.2 }
path.gauss { fill:none; stroke:var(--after); stroke-dasharray:2 4 }
.next circle { fill:var(--after) }
.next text { fill:var(--card); font-size:11px; font-weight:600 }
.legend { font-size:.88rem; color:var(--soft); margin:0 0 4px }
.swatch { display:inline-block; width:11px; height:11px; border-radius:50%; margin:0 5px 0 12px;
  vertical-align:-1px; background:var(--before) }
.swatch.after { background:var(--after); border-radius:0 }
.swatch.level { background:var(--after); height:8px; border-radius:2px }
.swatch.third { background:var(--third); clip-path:polygon(50% 0,100% 100%,0 100%) }
.swatch.fit,.swatch.noise { background:var(--fit); height:4px; width:16px; border-radius:2px;
  vertical-align:3px }
.swatch.noise { background:none; border-top:2px dashed var(--fit); border-radius:0 }
.swatch.cross { background:none; width:auto; height:auto } .swatch.cross::before { content:"×" }
.gains { display:grid; grid-template-columns:max-content minmax(0,1fr); gap:3px 14px;
  font-size:.9rem; font-variant-numeric:tabular-nums; max-width:860px }
.gains>div:nth-child(odd) { color:var(--soft); text-align:right; max-width:36ch }
.gains i { display:block; height:13px; border-radius:2px; background:var(--bar);
  min-width:2px; flex:none }
.gains p { display:flex; align-items:center; gap:8px; margin:0 0 3px; line-height:1.2 }
.gains i.after { background:var(--after) }
.gains i.floor { background:none; height:11px; border:2px dashed var(--fit) }
@media (max-width:620px) { .gains { grid-template-columns:minmax(0,1fr) }
  .gains>div:nth-child(odd) { text-align:left; margin-top:6px; max-width:none } }
.scroll { overflow-x:auto; max-width:100%;  /* a shadow where it goes on */
  background:linear-gradient(to right,var(--card) 40%,transparent) 0 0/40px 100% no-repeat local,
    linear-gradient(to left,var(--card) 40%,transparent) 100% 0/40px 100% no-repeat local,
    linear-gradient(to right,rgba(110,110,110,.55),transparent) 0 0/14px 100% no-repeat,
    linear-gradient(to left,rgba(110,110,110,.55),transparent) 100% 0/14px 100% no-repeat }
.scroll svg { min-width:620px }
.scroll.tall { max-height:min(70vh,560px); overflow:auto }
.tall thead th { position:sticky; top:0; background:var(--card); z-index:1 }
table { border-collapse:collapse; font-size:.9rem; width:100%;
  font-variant-numeric:tabular-nums }
caption,.unseen { position:absolute; width:1px; height:1px; overflow:hidden;
  clip-path:inset(50%); white-space:nowrap }
.scroll { position:relative }
th { text-align:left; font-weight:600; color:var(--soft); border-bottom:2px solid var(--line);
  padding:4px 10px 4px 0; white-space:nowrap }
th button { font:inherit; color:inherit; background:none; border:0; padding:0; cursor:pointer;
  text-align:inherit }
th[aria-sort] button::after { content:" ▾" } th[aria-sort=ascending] button::after { content:" ▴" }
td { border-bottom:1px solid var(--line); padding:4px 10px 4px 0; vertical-align:top;
  overflow-wrap:break-word; max-width:60ch }
.nodes td:last-child { min-width:30ch }
.numbers td:not(:first-child),.numbers th:not(:first-child) { text-align:right }
.numbers td:last-child,.numbers th:last-child { padding-right:0 }
.nights :is(td,th):nth-child(-n+2) { text-align:left!important; white-space:nowrap }
.numbers td,.keep td { overflow-wrap:normal }
.keep td,.stars td { white-space:nowrap }
.stars td,.stars th { text-align:right }
.stars :is(td,th):first-child,.stars :is(td,th):last-child { text-align:left }
.stars th,.keep th { white-space:normal; vertical-align:bottom }
.stars td:last-child { white-space:normal; min-width:16ch }
.gauge { display:inline-block; width:110px; height:9px; background:var(--grid); border-radius:3px;
  margin-right:8px; vertical-align:1px }
.gauge i { display:block; height:9px; border-radius:3px; background:var(--bar) }
.gauge i.inset { background:var(--after) }
.correlations { font-size:.78rem; width:auto }
.correlations td { padding:1px; border:0; white-space:nowrap }
.correlations td:first-child { padding-right:10px } .correlations th { border:0; padding:2px 4px }
.corr { display:block; min-width:44px; padding:2px 4px; text-align:right; border-radius:3px }
details { margin-top:4px } summary { cursor:pointer; color:var(--after) }
dl { display:grid; grid-template-columns:fit-content(min(15em,40%)) minmax(0,1fr); gap:2px 14px;
  font-size:.92rem; margin:6px 0; align-content:start }
dt { color:var(--soft) } dd { margin:0; overflow-wrap:anywhere }
code { font-size:.88em; overflow-wrap:anywhere }
footer { color:var(--soft); font-size:.82rem; margin-top:22px }
.controls { position:sticky; top:0; z-index:3; display:flex; flex-wrap:wrap; gap:4px 22px;
  align-items:center; background:var(--page); border-bottom:1px solid var(--line);
  padding:7px 0; font-size:.9rem }
.controls fieldset { border:0; padding:0; margin:0; display:flex; flex-wrap:wrap; gap:0 14px }
.controls legend { float:left; padding:0; margin-right:10px; color:var(--soft) }
.controls label { white-space:nowrap }
.controls select { font:inherit; max-width:60vw; color:inherit; background:var(--card);
  border:1px solid var(--rim); border-radius:4px }
.controls output { position:fixed; left:0; right:0; bottom:0; background:var(--card);
  border-top:2px solid var(--lit); padding:6px clamp(10px,2.4vw,28px); overflow-wrap:anywhere }
.controls output:empty { display:none }
:focus-visible { outline:3px solid var(--lit); outline-offset:1px }
svg.link { cursor:crosshair } tr[data-i] { cursor:pointer }
.lit,.lit path { stroke:var(--lit)!important; stroke-opacity:1!important }
.dots .lit { stroke-width:10px!important }
.lit path,.crosses .lit { stroke-width:3.2 }
.lit circle { fill:var(--lit); stroke:var(--lit); stroke-width:5 }
tr.lit td { background:color-mix(in srgb,var(--lit) 22%,var(--card)) }
.off { display:none }
@media screen {
  .controls:has(input[value=before]:checked)~* .when-after { display:none }
  .controls:has(input[value=after]:checked)~* .when-before { display:none }
}
@media print {
  :root { color-scheme:light; --ink:#000; --soft:#444; --line:#bbb; --card:#fff; --page:#fff;
    --before:#7a6a58; --after:#0072b2; --fit:#d55e00; --third:#2d0a33; --good:#009e73;
    --bar:#c9bfb2; --grid:#e6eaef; --zero:#9aa4b1; --rim:#aab3bf }
  body { background:#fff; font-size:11pt } main { max-width:none; padding:0 }
  section { border:0; border-top:1px solid #999; border-radius:0; padding:10px 0; margin:8px 0 }
  .verdict { border-left:0 } h2,h3 { break-after:avoid } .scroll { overflow:visible }
  .scroll.tall { max-height:none; overflow:visible } .tall thead th { position:static }
  table { font-size:9pt } .stars,.keep { font-size:7pt }
  td,th { white-space:normal!important; padding-right:6px }
  :is(.stars,.keep) :is(td,th) { padding-right:4px }
  thead { display:table-header-group }
  tr,svg,figure { break-inside:avoid } .pair { grid-template-columns:1fr 1fr }
  .scroll svg { min-width:0 } .controls { display:none }
  .effect.one { grid-template-columns:1fr 300px }
  * { -webkit-print-color-adjust:exact; print-color-adjust:exact }
}
"""
