"""What every report as a page has: its frame, how it looks, and what it does when it is touched."""

# Plots are drawn on white: inverted to nine tenths, with their hues, white is the dark paper
STYLE = """
:root { color-scheme: light dark; --paper: #fff; --ink: #1a1a1a; --soft: #444; --faint: #666;
  --line: #ccc; --thin: #eee; }
@media screen and (prefers-color-scheme: dark) {
  :root { --paper: #1a1a1a; --ink: #e6e6e6; --soft: #c4c4c4; --faint: #a0a0a0; --line: #555;
    --thin: #333; }
  .plot, .legend i, .legend b { filter: invert(.9) hue-rotate(180deg); }
}
* { box-sizing: border-box; }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper);
  max-width: 1240px; margin: 0 auto; padding: 1rem 1.2rem 3rem; }
h1 { font-size: 1.7rem; margin: .4rem 0 0; } header p { margin: 0; color: var(--faint); }
header p.first { color: var(--ink); font-size: 1.1rem; font-weight: 600; margin-top: .35rem; }
p.first + p.first { font-size: .95rem; font-weight: 400; margin-top: 0; }
h2 { font-size: 1.2rem; border-bottom: 1px solid var(--line); margin: 2rem 0 .8rem;
  padding-bottom: .2rem; }
h3 { font-size: 1rem; margin: 1.2rem 0 .3rem; color: var(--soft); }
.part { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .3rem 0 1rem; }
tr + tr { border-top: 1px solid var(--thin); }
th { font-weight: 600; color: var(--soft); white-space: nowrap; }
td { overflow-wrap: break-word; } td math { font-size: 1.08rem; } code { font-size: .85em; }
.plots { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: .4rem 1.2rem; }
figure { margin: 0; min-width: 0; } figure.wide, figure:only-child { grid-column: 1 / -1; }
figcaption { font-size: .9rem; color: var(--ink); padding-left: .3rem; }
.legend { display: flex; flex-wrap: wrap; gap: .2rem 1.1rem; margin: 0; align-items: center; }
.legend i { display: inline-block; width: 1.5em; height: .8em; margin-right: .4em;
  border: 1px solid var(--line); }
.legend b { display: inline-block; width: 2em; margin: 0 .4em .25em 0; }
small { color: var(--faint); } summary { cursor: pointer; font-weight: 600; color: var(--soft); }
@media (max-width: 760px) { .plots { grid-template-columns: minmax(0, 1fr); }
  body { padding: .6rem .7rem 2rem; font-size: 14px; } th { white-space: normal; } }
@media print { .plots { display: block; } figure { break-inside: avoid; } }
"""

# Plots are made as they come into view, or are printed; a stretch of time that is chosen in one of
# them is shown in all.
SCRIPT = """
const plots = JSON.parse(document.getElementById("data").textContent);
const places = [...document.querySelectorAll(".plot")];
const look = {responsive: true, displaylogo: false, displayModeBar: false, doubleClick: false};
let busy = false;
function everywhere(change) {
  if (busy) return;
  busy = true;
  Promise.all(places.map((place, k) => plots[k].timed
    ? Plotly.relayout(place, change(plots[k].whole)) : null)).then(() => { busy = false; });
}
places.forEach((place, k) => {
  const plot = plots[k];
  plot.whole = (plot.layout.xaxis.range || []).slice();
  plot.all = (plot.layout.yaxis.range || []).slice();
  Plotly.newPlot(place, plot.data, plot.layout, look);
  place.on("plotly_relayout", change => {
    if (plot.timed && "xaxis.range[0]" in change)
      everywhere(() => ({"xaxis.range": [change["xaxis.range[0]"], change["xaxis.range[1]"]]}));
  });
  place.on("plotly_doubleclick", () => {
    if (plot.timed) everywhere(whole => ({"xaxis.range": whole.slice()}));
    Plotly.relayout(place, plot.all.length
      ? {"xaxis.range": plot.whole.slice(), "yaxis.range": plot.all.slice()}
      : {"xaxis.autorange": true, "yaxis.autorange": true});
  });
});
"""

PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
{body}
<script type="application/json" id="data">{data}</script>
<script>{library}</script>
<script>{script}</script>
</body>
</html>
"""
