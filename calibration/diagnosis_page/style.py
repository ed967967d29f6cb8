"""How the diagnosis page looks: colours that the colour-blind tell apart, and paper."""

CSS = """
:root { --ink:#1b2430; --soft:#5b6673; --line:#d9dee5; --card:#fff; --page:#f3f5f8;
  --before:#6b7684; --after:#0072b2; --fit:#d55e00; }
* { box-sizing:border-box }
html { -webkit-text-size-adjust:100% }
body { margin:0; background:var(--page); color:var(--ink);
  font:16px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif }
main { max-width:1000px; margin:0 auto; padding:28px 20px 60px }
h1 { font-size:1.05rem; font-weight:600; color:var(--soft); margin:0 0 2px; letter-spacing:.01em }
h2 { font-size:1.15rem; margin:0 0 10px }
h3 { font-size:1.02rem; margin:20px 0 4px }
h3:first-of-type { margin-top:4px }
p { margin:6px 0 10px }
.meta,.note,figcaption { color:var(--soft); font-size:.88rem }
.meta { margin:0 0 18px; overflow-wrap:anywhere }
section { background:var(--card); border:1px solid var(--line); border-radius:10px;
  padding:18px 22px; margin:16px 0 }
.verdict { border-left:6px solid var(--after) }
.verdict.ambiguous,.verdict.unknown { border-left-color:#e69f00 }
.verdict.undecided,.verdict.wanders { border-left-color:#e69f00 }
.verdict.none { border-left-color:#009e73 }
.verdict h2 { font-size:1.5rem; line-height:1.25; margin:4px 0 8px }
.verdict ul { margin:6px 0 4px; padding-left:20px; font-size:1.05rem }
.badge { display:inline-block; font-size:.78rem; font-weight:600; letter-spacing:.05em;
  text-transform:uppercase; color:var(--soft) }
.numbers-row { display:flex; flex-wrap:wrap; gap:10px 34px; margin:14px 0 4px }
.numbers-row div { line-height:1.15 }
.numbers-row b { display:block; font-size:1.7rem; font-weight:650;
  font-variant-numeric:tabular-nums }
.numbers-row span { color:var(--soft); font-size:.85rem }
.pair { display:grid; grid-template-columns:repeat(auto-fit,minmax(300px,1fr)); gap:8px 18px;
  align-items:start }
.effect.one { display:grid; grid-template-columns:minmax(0,1fr) minmax(300px,440px); gap:20px }
@media (max-width:760px) { .effect.one { grid-template-columns:1fr } }
.side { display:grid; grid-template-columns:280px minmax(0,1fr); gap:20px; align-items:start }
.side th { white-space:normal }
@media (max-width:760px) { .side { grid-template-columns:1fr } }
figure { margin:8px 0 14px; break-inside:avoid }
svg { display:block; width:100%; height:auto; font-family:inherit }
.frame,.rim { fill:none; stroke:#aab3bf }
.grid { fill:none; stroke:#e6eaef } .zero { stroke:#9aa4b1; fill:none }
.tick { font-size:11px; fill:#5b6673 }
.strong { fill:var(--ink); paint-order:stroke; stroke:#fff; stroke-width:3px }
.label { font-size:12px; fill:#3b4653 } .title { font-size:12.5px; font-weight:600; fill:#1b2430 }
circle.before,.before circle { fill:var(--before); fill-opacity:.75 }
.after circle { fill:var(--after); fill-opacity:.85 }
path.dots { fill:none; stroke-linecap:round; stroke-opacity:.7 }
path.before.dots { stroke:var(--before) } path.after.dots { stroke:var(--after) }
.before path,path.before.key { stroke:var(--before); fill:none; stroke-width:1.3 }
.after path,path.after.key { stroke:var(--after); fill:none; stroke-width:1.3 }
path.key { stroke-width:3 }
path.fit { stroke:var(--fit); stroke-width:2.4; fill:none; stroke-linecap:round;
  stroke-opacity:.85 }
path.band { fill:#0072b2; fill-opacity:.16; stroke:none }
path.level { fill:none; stroke:var(--after); stroke-width:1.6 }
path.beyond { fill:#fff; stroke:var(--ink); stroke-width:1 }
path.area { stroke-width:1.4 }
path.before.area { fill:#6b7684; fill-opacity:.22; stroke:var(--before) }
path.after.area { fill:none; stroke:var(--after); stroke-width:2.2 }
path.gauss { fill:none; stroke:var(--after); stroke-dasharray:2 4 }
.bar.before { fill:#b3bbc6 } .bar.after { fill:var(--after) }
.floor { stroke:var(--ink); stroke-dasharray:4 3; fill:none }
.next circle { fill:var(--after) } .next text { fill:#fff; font-size:11px; font-weight:600 }
.legend { font-size:.88rem; color:var(--soft); margin:0 0 4px }
.swatch { display:inline-block; width:12px; height:12px; border-radius:50%; margin:0 5px 0 12px;
  vertical-align:-1px }
.swatch.before { background:var(--before) } .swatch.after { background:var(--after) }
.swatch.fit { background:var(--fit); height:4px; width:16px; border-radius:2px;
  vertical-align:3px }
.scroll { overflow-x:auto }
table { border-collapse:collapse; font-size:.9rem; width:100%;
  font-variant-numeric:tabular-nums }
th { text-align:left; font-weight:600; color:var(--soft); border-bottom:2px solid var(--line);
  padding:4px 10px 4px 0; white-space:nowrap }
td { border-bottom:1px solid #edf0f4; padding:4px 10px 4px 0; vertical-align:top;
  overflow-wrap:anywhere }
.numbers td:not(:first-child),.numbers th:not(:first-child) { text-align:right }
.numbers td:last-child,.numbers th:last-child { padding-right:0 }
.gauge { display:inline-block; width:110px; height:9px; background:#edf0f4; border-radius:3px;
  margin-right:8px; vertical-align:1px }
.gauge i { display:block; height:9px; border-radius:3px; background:#b3bbc6 }
.gauge i.inset { background:var(--after) }
.correlations { font-size:.78rem; width:auto }
.correlations td { padding:1px; border:0; white-space:nowrap }
.correlations td:first-child { padding-right:10px } .correlations th { border:0; padding:2px 4px }
.corr { display:block; min-width:44px; padding:2px 4px; text-align:right; border-radius:3px }
details { margin-top:4px } summary { cursor:pointer; color:var(--after) }
dl { display:grid; grid-template-columns:auto 1fr; gap:2px 14px; font-size:.92rem; margin:6px 0;
  align-content:start }
dt { color:var(--soft) } dd { margin:0; overflow-wrap:anywhere }
footer { color:var(--soft); font-size:.82rem; margin-top:22px }
@media print {
  body { background:#fff; font-size:11.5pt } main { max-width:none; padding:0 }
  section { border:0; border-top:1px solid #999; border-radius:0; padding:10px 0; margin:8px 0 }
  .verdict { border-left:0 } h2,h3 { break-after:avoid } .scroll { overflow:visible }
  tr,svg { break-inside:avoid } .pair { grid-template-columns:1fr 1fr }
  .effect.one { grid-template-columns:1fr 300px }
  * { -webkit-print-color-adjust:exact; print-color-adjust:exact }
}
"""
