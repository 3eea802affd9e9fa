#include "daemon/session/report.h"

namespace lightrig {

std::string_view report_style() {
  return R"css(
:root { color-scheme: light dark;
  --paper:#ffffff; --ink:#1b1f24; --muted:#59636e; --rule:#d5dae0; --card:#f4f6f8; --warn:#8a4b00;
  --warn-paper:#fff4e0; --predicted:#1763a6; --held:#b3500f; --true:#1e7a3c; --base:#6a7480;
  --random:#7a3fa0; }
@media (prefers-color-scheme: dark) { :root {
  --paper:#14171a; --ink:#dfe3e7; --muted:#98a2ad; --rule:#333a41; --card:#1d2226; --warn:#f0b465;
  --warn-paper:#2c2312; --predicted:#6cb2f0; --held:#f0975c; --true:#6ccb86; --base:#98a2ad;
  --random:#c497e8; } }
* { box-sizing: border-box; }
body { margin:0 auto; padding:2rem 1.5rem 4rem; max-width:66rem; background:var(--paper); color:var(--ink);
  font:15px/1.5 system-ui,"Segoe UI","Noto Sans","DejaVu Sans",sans-serif; font-variant-numeric:tabular-nums; }
h1 { font-size:1.6rem; line-height:1.2; margin:0 0 .2rem; }
h2 { font-size:1.15rem; margin:2.6rem 0 .6rem; padding-top:.8rem; border-top:1px solid var(--rule); }
h3 { font-size:1rem; margin:1.2rem 0 .3rem; }
p { margin:.4rem 0; max-width:46rem; }
.muted, figcaption, .note { color:var(--muted); }
.note, figcaption { font-size:.86rem; }
.cards { display:grid; grid-template-columns:repeat(auto-fit,minmax(12rem,1fr)); gap:.8rem; margin:1.2rem 0; }
.card { background:var(--card); border-radius:.5rem; padding:.8rem 1rem; border-left:4px solid var(--rule); }
.card b { display:block; font-size:1.7rem; line-height:1.25; font-weight:650; }
.card span { display:block; font-size:.86rem; color:var(--muted); }
.card.predicted { border-color:var(--predicted); } .card.held { border-color:var(--held); }
.card.true { border-color:var(--true); } .card.cost { border-color:var(--base); }
.warnings { background:var(--warn-paper); border-left:4px solid var(--warn); border-radius:.5rem;
  padding:.6rem 1rem .7rem; margin:1rem 0; }
.warnings h2 { border:0; margin:0; padding:0; color:var(--warn); font-size:1rem; }
.warnings ul { margin:.2rem 0 0; padding-left:1.2rem; }
table { border-collapse:collapse; width:100%; margin:.6rem 0; }
th, td { text-align:left; padding:.3rem .8rem .3rem 0; border-bottom:1px solid var(--rule); vertical-align:top; }
th { font-weight:600; color:var(--muted); font-size:.86rem; }
td.n, th.n { text-align:right; white-space:nowrap; }
td.why { color:var(--muted); font-size:.88rem; }
figure { margin:.6rem 0; }
figcaption { margin-top:.35rem; max-width:46rem; }
img { display:block; max-width:100%; height:auto; image-rendering:auto; }
img.cells { image-rendering:pixelated; background:var(--card); }
.row { display:flex; flex-wrap:wrap; gap:1.8rem 2.4rem; align-items:flex-start; }
.light { display:grid; grid-template-columns:minmax(13rem,17rem) 1fr; gap:.4rem 1.4rem; padding:1rem 0;
  border-bottom:1px solid var(--rule); break-inside:avoid; }
.light h3 { margin:0 0 .2rem; }
.light dl, .facts dl { display:grid; grid-template-columns:max-content 1fr; gap:.05rem .7rem; margin:0; font-size:.86rem; }
.light dt, .facts dt { color:var(--muted); } .light dd, .facts dd { margin:0; }
.light .strip { display:flex; gap:1rem; align-items:flex-start; }
.light .strip figure { margin:0; }
.three { display:grid; grid-template-columns:1fr 1fr 1fr; font-size:.8rem; color:var(--muted); }
.grid-picture { display:grid; grid-template-columns:auto minmax(0,max-content); max-width:100%; font-size:.8rem; color:var(--muted); gap:.15rem .35rem; }
.grid-picture .y { writing-mode:vertical-rl; transform:rotate(180deg); display:flex; justify-content:space-between; }
.grid-picture .x { grid-column:2; display:flex; justify-content:space-between; }
.two-names { display:grid; grid-template-columns:1fr 1fr; font-size:.86rem; color:var(--muted); }
.legend { font-size:.8rem; color:var(--muted); max-width:17rem; margin-top:.4rem; }
.legend i { display:block; height:.7rem; border-radius:2px; print-color-adjust:exact; -webkit-print-color-adjust:exact; }
.legend div { display:flex; justify-content:space-between; }
svg.chart { width:100%; height:auto; display:block; }
svg .grid { stroke:var(--rule); stroke-width:1; }
svg .axis { fill:var(--muted); font-size:12px; }
svg .label { font-size:13px; stroke:none; }
svg path { fill:none; stroke-width:2.2; } svg line { stroke-width:1.6; }
svg .predicted { stroke:var(--predicted); } svg circle.predicted, svg .label.predicted { fill:var(--predicted); }
svg .held { stroke:var(--held); } svg circle.held, svg .label.held { fill:var(--held); }
svg .true { stroke:var(--true); } svg circle.true, svg .label.true { fill:var(--true); }
svg .mean { stroke:var(--base); stroke-dasharray:6 4; } svg .label.mean { fill:var(--base); }
svg .random { stroke:var(--random); stroke-dasharray:2 3; } svg .label.random { fill:var(--random); }
svg path.band { fill:var(--predicted); fill-opacity:.14; stroke:none; }
svg .label { stroke:none !important; stroke-dasharray:none; }
/* Pictures are drawn for a light page: black objects and dark marks would drown in a dark one. */
@media screen and (prefers-color-scheme: dark) {
  img.cells { background:#e3e7eb; } .light .strip img:not(.cells) { background:#8a939c; border-radius:3px; } }
@media screen and (max-width:44rem) {
  .light { grid-template-columns:1fr; } .light .strip { flex-wrap:wrap; }
  .row > * { max-width:100%; } table { display:block; overflow-x:auto; }
  figure { overflow-x:auto; } svg.chart { min-width:34rem; } }
@media print {
  :root { --paper:#fff; --ink:#000; --muted:#444; --rule:#bbb; --card:#f4f4f4; --warn:#603400; --warn-paper:#fff;
    --predicted:#1763a6; --held:#b3500f; --true:#1e7a3c; --base:#555; --random:#7a3fa0; }
  body { max-width:none; padding:0; font-size:10.5pt; }
  h2, h3 { break-after:avoid; } .card, figure, table, tr, .light { break-inside:avoid; }
  .row { display:block; } .row > * { display:inline-block; vertical-align:top; break-inside:avoid; margin-right:1.5rem; }
  .card, .warnings { border:1px solid #999; border-left-width:4px; }
}
)css";
}

}  // namespace lightrig
