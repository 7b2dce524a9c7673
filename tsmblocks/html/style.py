"""How a report looks: colours for light and dark, apart for colour-blind readers, one column on a phone."""

CSS = """
:root{--paper:#fff;--ink:#1b1b1b;--soft:#5b5b5b;--rule:#d5d5d5;--panel:#f5f5f3;--measured:#909090;
--before:#b84a06;--after:#0067a5;--between:#7a9fbe;--noise:#009e7333;--floor:#00795a;--add:#0067a5;--gone:#a83232}
@media (prefers-color-scheme:dark){:root{--paper:#161718;--ink:#ececec;--soft:#a9a9a9;--rule:#3b3d3f;
--panel:#202224;--measured:#7d7d7d;--before:#ff9a57;--after:#62b5f2;--between:#6c8fae;--noise:#2fd0a333;
--floor:#45d6ad;--add:#62b5f2;--gone:#ff8f8f}}
*{box-sizing:border-box}
body{margin:0 auto;padding:16px;max-width:1160px;background:var(--paper);color:var(--ink);
font:16px/1.5 system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif;overflow-wrap:break-word}
h1{font-size:1.35rem;margin:.2em 0}h2{font-size:1.15rem;margin:2em 0 .5em;border-top:1px solid var(--rule);
padding-top:.8em}h3{font-size:1rem;margin:1.4em 0 .4em}
p{margin:.5em 0;max-width:75ch}small,.soft{color:var(--soft)}
.verdict{background:var(--panel);border-left:6px solid var(--after);padding:12px 16px;margin:14px 0;border-radius:4px}
.verdict p{font-size:1.1rem;margin:.2em 0}.verdict.unknown{border-color:var(--before)}
.verdict.none{border-color:var(--floor)}.verdict b.word{letter-spacing:.05em}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(420px,100%),1fr));gap:16px 20px}
figure{margin:0;min-width:0}figcaption{font-size:.85rem;color:var(--soft)}
svg.chart{width:100%;max-width:560px;height:auto;display:block}
svg.chart text{font-size:11px;fill:var(--ink)}svg.chart text.small{font-size:9.5px}
svg.chart text.floor{fill:var(--floor)}svg.chart text.strong{font-weight:600}
path.grid{stroke:var(--rule);stroke-width:.6;fill:none}path.zero{stroke:var(--soft);stroke-width:.8}
.line{fill:none;stroke-width:1.3;stroke-linejoin:round}.thin{stroke-width:.9}
.line.measured{stroke:var(--measured);stroke-width:3.6}.line.measured.thin{stroke-width:1.6}.line.before{stroke:var(--before)}
.line.after{stroke:var(--after)}.line.between{stroke:var(--between)}
.line.floor{stroke:var(--floor);stroke-width:1.6;stroke-dasharray:5 3}
.line.explained{stroke:var(--after);stroke-width:1.6;stroke-dasharray:4 3}
.fill.before,.dot.before{fill:var(--before)}.fill.after,.dot.after{fill:var(--after)}.fill.between{fill:var(--between)}
.hollow{fill:none;stroke:var(--ink);stroke-width:1}.cell{fill:none;stroke:var(--rule);stroke-width:.6}
.noise{fill:var(--noise)}
.key{display:flex;flex-wrap:wrap;gap:4px 16px;font-size:.85rem;margin:.4em 0}
.key span::before{content:'';display:inline-block;width:18px;height:10px;margin-right:6px;border-radius:2px;
background:var(--c);border:1px solid var(--b,var(--c))}
.scroll{overflow-x:auto}table{border-collapse:collapse;font-size:.88rem;font-variant-numeric:tabular-nums}
th,td{padding:4px 10px 4px 0;text-align:right;border-bottom:1px solid var(--rule);vertical-align:top}
th{color:var(--soft);font-weight:600}th.l,td.l{text-align:left}tr.named td{font-weight:650}
tr.blind td{color:var(--soft)}tr.blind td:first-child::after{content:' (not seen)'}
pre{background:var(--panel);padding:10px 12px;border-radius:4px;overflow-x:auto;font-size:.84rem;line-height:1.45}
pre.wrap{white-space:pre-wrap;overflow-wrap:anywhere}
code{font-size:.92em}.add{color:var(--add)}.gone{color:var(--gone)}
.picture{margin:.6em 0;overflow-x:auto;background:#fff;border-radius:8px;border:1px solid var(--rule)}
.picture svg{display:block;max-width:max(100%,560px)!important}
details{margin:.6em 0}summary{cursor:pointer;padding:4px 0}ul{padding-left:1.2em}li{margin:.2em 0}
@media (max-width:600px){table{font-size:.82rem}table.text{min-width:440px}table.wide{min-width:820px}
body{padding:12px}h2{margin-top:1.6em}.verdict p{font-size:1.02rem}}
@media print{html,body{font-size:11px}body{padding:0}.cards{grid-template-columns:1fr 1fr}details>*{display:block}
details::details-content{display:block;content-visibility:visible}
.scroll,.picture,pre{overflow:visible}pre{white-space:pre-wrap;overflow-wrap:anywhere}
h2,h3,.key{break-after:avoid}figure,table,.picture,.verdict,pre{break-inside:avoid}
.verdict,.key span::before{-webkit-print-color-adjust:exact;print-color-adjust:exact}}
"""
"""The style sheet of the page."""
