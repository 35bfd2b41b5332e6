"""Look of the page, and what its browser does by itself: say that the server is gone. Nothing is fetched elsewhere."""

STYLE = """
:root { --ok: #009e73; --attention: #e69f00; --fault: #d55e00; --line: #d8d8d8; }
body { background: #eee; color: #111; font: 17px/1.35 system-ui, "DejaVu Sans", sans-serif; margin: 0; }
.nicegui-content { padding: 0 !important; gap: 0 !important; display: block !important; width: 100%; }
.cell { display: grid; width: 100%; box-sizing: border-box; gap: 10px; padding: 10px;
  grid-template-columns: repeat(6, minmax(0, 1fr)); }
section { background: #fff; border: 1px solid var(--line); border-radius: 6px; padding: 8px 12px; min-width: 0;
  grid-column: span 2; overflow-wrap: anywhere; }
section.whole { grid-column: 1 / -1; } section.most { grid-column: span 4; }
section.top { padding: 0; overflow: hidden; }
h2 { font-size: 17px; line-height: 1.3; font-weight: 700; margin: 0 0 4px; letter-spacing: 0; }
p { margin: 2px 0; }
.verdict { display: flex; align-items: center; gap: 16px; padding: 10px 16px; min-height: 92px; font-size: 28px;
  line-height: 1.2; }
.verdict strong { font-size: 56px; line-height: 1; letter-spacing: .02em;
  white-space: nowrap; }
.verdict .sign { width: 60px; height: 60px; flex: none; }
.verdict.ok { background: var(--ok); color: #fff; } .verdict.attention { background: var(--attention); color: #000; }
.verdict.fault { background: var(--fault); color: #fff; }
.verdict .sign { fill: currentColor !important; }
.verdict.ok .sign .in { stroke: var(--ok); } .verdict.attention .sign .in { stroke: var(--attention); }
.verdict.fault .sign .in { stroke: var(--fault); }
.title { padding: 3px 16px; margin: 0; font-size: 16px; } .title time { float: right; }
.badge { border: 2px solid #111; padding: 0 6px; border-radius: 4px; }
.sign { width: 1.15em; height: 1.15em; display: inline-block; vertical-align: -.2em; }
.sign.ok { fill: var(--ok); } .sign.attention { fill: var(--attention); } .sign.fault { fill: var(--fault); }
.sign .in { stroke: #fff; stroke-width: 3; fill: none; } .sign.attention .in { stroke: #000; }
table { border-collapse: collapse; width: 100%; }
.values th { text-align: left; font-weight: 600; white-space: nowrap; padding: 1px 8px 1px 0; }
.values td { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; padding: 1px 0 1px 6px; }
.values td.text { text-align: left; white-space: normal; } .values td.unit { text-align: left; color: #444; }
.values td.large { font-size: 27px; font-weight: 600; } .values td.spread { color: #444; font-size: 15px; }
.values.two { table-layout: fixed; } .values.two th { white-space: normal; font-size: 16px; }
.values.two tr:first-child th { text-align: right; } .values.two td.unit { padding-left: 4px; }
.values.two th:first-child { width: 17%; } .values.two th:last-child { width: 17%; }
.values td.bar { width: 30%; min-width: 50px; } .bar svg { width: 100%; height: 14px; display: block; }
.large { font-size: 21px; font-weight: 600; } .small { font-size: 15px; color: #444; }
.none { color: #555; font-style: italic; }
.latch { font-size: 21px; font-weight: 600; }
.latched { background: #fbe3d6; border-left: 8px solid var(--fault); padding: 6px; }
.health { list-style: none; margin: 0; padding: 0; }
.health.well { columns: 2; column-gap: 24px; }
.health li { display: flex; gap: 8px; padding: 2px 0; border-top: 1px solid var(--line); break-inside: avoid; }
.health .sign { flex: none; margin-top: 2px; } .health i { flex: none; width: 6.8em; font-style: normal;
  font-size: 15px; } .health.well i { width: 1.8em; }
.health b { flex: 0 0 30%; font-weight: 600; } .health.well b { flex-basis: 55%; }
.health span { flex: 1; min-width: 0; }
.stale, .old { color: #767676; filter: grayscale(1); } .old svg, .old td { opacity: .45; }
.drawing svg { width: 100%; max-height: 330px; display: block; }
.drawing svg * { vector-effect: non-scaling-stroke; }
.trend svg:not(.key) { width: 100%; display: block; } .key { width: 28px; height: 12px; display: inline-block; }
.act { margin-top: 6px; } .act button { font-size: 17px !important; min-height: 48px; }
.cut-line { display: none; position: fixed; inset: 0 0 auto 0; z-index: 9000; background: #000; color: #fff;
  padding: 16px;  font-size: 34px; font-weight: 700; text-align: center; border-bottom: 10px solid var(--fault); }
body.cut .cut-line { display: block; } body.cut .cell { filter: grayscale(1); opacity: .4; }
.beat { display: none; } #popup { display: none !important; }
@media (max-width: 900px) { section { grid-column: span 3; } section.most, section.wide { grid-column: 1 / -1; } }
@media (max-width: 600px) { section { grid-column: 1 / -1; } .verdict { flex-wrap: wrap; font-size: 22px; } }
"""

BEAT_PERIOD = 0.5
"""s between two signs of life of the server."""

_SILENT_AFTER_MS = 2000
"""Four signs of life that did not come: one late one says nothing, and 2 s is what a fault may take to be seen."""


SCRIPT = f"""
window.beatAt = performance.now();
setInterval(() => {{
  const beat = document.querySelector(".beat"), text = beat ? beat.textContent : "", now = performance.now();
  if (text !== window.lastBeat) {{ window.lastBeat = text; window.beatAt = now; }}
  document.body.classList.toggle("cut", now - window.beatAt > {_SILENT_AFTER_MS});
}}, 200);
"""
"""Without a sign of life the page says so and greys, whether the server has ended, hangs, or the network is gone."""
