"""The style sheet of the pages beyond their theme: drawings, charts, formulas, light and dark, wide and narrow."""

LIGHT = "--measured:#757575;--before:#b84a06;--after:#0067a5;--between:#7a5195;--rule:#d5d5d5;--soft:#5b5b5b"
DARK = "--measured:#9a9a9a;--before:#ff9a57;--after:#62b5f2;--between:#c39be0;--rule:#3b3d3f;--soft:#a9a9a9"
CSS = """
body{LIGHT}
body[data-theme="dark"]{DARK}
@media (prefers-color-scheme:dark){body:not([data-theme="light"]){DARK}}
.picture{overflow-x:auto;background:#fff;border-radius:8px;border:1px solid var(--rule);margin:1em 0}
.picture svg{display:block;margin:0 auto}
.picture a:hover rect,.picture a:hover circle{stroke:#c2410c}
@media (max-width:46em){.picture svg{max-width:none!important;min-width:min(100%,560px)}}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(300px,100%),1fr));gap:16px 20px;margin:1em 0}
.cards figure{margin:0;min-width:0}
a.card{display:block;border:1px solid var(--rule);border-radius:8px;padding:12px 14px}
a.card{text-decoration:none;color:inherit}
a.card:hover{border-color:var(--color-brand-primary)}
a.card b{display:block;color:var(--color-brand-primary)}
a.card span{font-size:.9rem}
svg.chart{width:100%;max-width:520px;height:auto;display:block}
svg.chart text{font-size:11px;fill:var(--color-foreground-primary)}
path.grid{stroke:var(--rule);stroke-width:.6;fill:none}
.line{fill:none;stroke-width:1.4;stroke-linejoin:round}
.line.measured{stroke:var(--measured);stroke-width:2}
.line.after{stroke:var(--after)}.line.before{stroke:var(--before)}.line.between{stroke:var(--between)}
.key{display:flex;flex-wrap:wrap;gap:4px 16px;font-size:.85rem;margin:.6em 0}
.key span::before{content:'';display:inline-block;width:18px;height:4px;margin:0 6px 3px 0;background:var(--c)}
div.math{overflow-x:auto;overflow-y:hidden;padding:.4em 0;margin:.6em 0}
math{font-size:1.08em;font-family:"STIX Two Math","Cambria Math","Latin Modern Math",math}
mtable.aligned mtd{padding:.35em .12em}
mtable.cases{border-left:1.5px solid;border-radius:.6em/1.2em;padding-left:.2em}
mtable.cases mtd{text-align:left;padding:.2em .3em}
mtd.right{text-align:right}mtd.left{text-align:left}
table.docutils{font-size:.88rem;width:100%;box-shadow:none}
table.docutils th{text-align:left}
article h2{font-size:1.5em}article h3{font-size:1.2em}
article .highlight pre{font-size:.8rem}
dl.field-list{display:grid;grid-template-columns:fit-content(34%) auto;gap:.2em 1em;margin:1em 0}
dl.field-list>dt,dl.field-list>dd{margin:0;padding:0;line-height:1.6}
dl.field-list dd p{margin:0}
details{margin:.6em 0}summary{cursor:pointer}
article h1{font-size:2em}
@media (max-width:46em){article h1{font-size:1.5em;overflow-wrap:anywhere}
article h2{font-size:1.25em}table.docutils{min-width:36em}}
""".replace("LIGHT", LIGHT).replace("DARK", DARK)
