"""The page around a report: one sheet of style, light, responsive and fit for print; nothing comes from outside."""

STYLE = """
:root { --ink: #1c2430; --soft: #667085; --rule: #e4e7ec; --wash: #f7f8fa; --verdict: #1d4ed8; }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0; background: #fff; color: var(--ink); font: 16px/1.6 Charter, 'Bitstream Charter',
  'Iowan Old Style', Georgia, serif; }
main { max-width: 1080px; margin: 0 auto; padding: 48px 28px 72px; }
h1, h2, h3, nav, table, figcaption, .tag, .tile, .legend, svg text, .note, summary, header p
  { font-family: Inter, 'Segoe UI', 'Helvetica Neue', 'Liberation Sans', Arial, sans-serif; }
h1 { font-size: 30px; line-height: 1.2; letter-spacing: -.015em; margin: 4px 0 2px; font-weight: 650; }
h2 { font-size: 21px; letter-spacing: -.01em; margin: 60px 0 6px; padding-top: 16px;
  border-top: 1px solid var(--rule); font-weight: 650; }
h3 { font-size: 14.5px; margin: 30px 0 6px; font-weight: 650; }
p { max-width: 44em; margin: 8px 0 14px; }
header p { color: var(--soft); font-size: 14px; margin: 0; }
code { font: 13px/1.4 ui-monospace, 'Cascadia Mono', Menlo, Consolas, 'Liberation Mono', monospace; }
.verdict { border: 1px solid var(--rule); border-left: 6px solid var(--verdict); border-radius: 8px;
  padding: 22px 26px 20px; margin: 26px 0 0;
  background: linear-gradient(90deg, color-mix(in srgb, var(--verdict) 7%, #fff), #fff 70%); }
.tag { display: inline-block; color: #fff; background: var(--verdict); font-size: 12px; font-weight: 650;
  letter-spacing: .06em;
  text-transform: uppercase; padding: 2px 10px; border-radius: 99px; }
.verdict .headline { font-size: 23px; line-height: 1.35; margin: 10px 0 4px; max-width: none; }
.verdict p { margin: 4px 0; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(170px, 1fr)); gap: 12px 28px;
  margin-top: 18px; }
.tile b { display: block; font-size: 21px; font-weight: 650; letter-spacing: -.01em;
  font-variant-numeric: tabular-nums; }
.tile span { font-size: 12.5px; color: var(--soft); display: block; line-height: 1.4; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 13.5px; line-height: 1.45; margin: 10px 0 16px;
  font-variant-numeric: tabular-nums; }
table.wide { width: 100%; }
th { text-align: left; font-weight: 600; color: var(--soft); border-bottom: 1px solid #98a2b3;
  padding: 4px 18px 5px 0; vertical-align: bottom; }
td { border-bottom: 1px solid var(--rule); padding: 5px 18px 5px 0; vertical-align: top; }
td.n, th.n { text-align: right; white-space: nowrap; } tr.sum td { font-weight: 600; background: var(--wash); }
td:first-child, th:first-child { padding-left: 8px; }
figure { margin: 18px 0; break-inside: avoid; } figure svg text { font-family: Inter, 'Segoe UI', 'Helvetica Neue',
  'Liberation Sans', Arial, sans-serif !important; }
figure svg, figure img { width: 100%; height: auto; display: block; }
figcaption { font-size: 13px; color: var(--soft); line-height: 1.5; max-width: 62em; margin-top: 4px; }
.pair { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(380px, 100%), 1fr)); gap: 8px 44px;
  align-items: start; }
.legend { font-size: 13px; color: var(--ink); display: flex; flex-wrap: wrap; gap: 4px 24px; margin: 14px 0 0; }
.legend i { display: inline-block; width: 22px; height: 0; border-top: 3px solid; vertical-align: middle;
  margin-right: 7px; }
.legend i.band { height: 11px; border: 0; background: #dfe5ec; }
.note { background: var(--wash); border-left: 3px solid #98a2b3; padding: 10px 16px; font-size: 14px;
  margin: 14px 0; max-width: 62em; }
details summary { cursor: pointer; font-size: 13.5px; color: var(--soft); margin: 4px 0; }
ul { padding-left: 1.2em; max-width: 50em; margin: 8px 0; } li { margin: 3px 0; }
footer { margin-top: 64px; border-top: 1px solid var(--rule); padding-top: 12px; color: var(--soft);
  font-size: 13px; }
@media (max-width: 700px) { main { padding: 24px 16px 48px; } h1 { font-size: 25px; }
  .wide-figure { overflow-x: auto; }
  .wide-figure svg, .wide-figure img { min-width: 720px; } }
@media print { @page { margin: 14mm; } body { font-size: 10.5pt; } main { max-width: none; padding: 0; }
  h2 { margin-top: 26pt; break-after: avoid; }
  h3 { break-after: avoid; } * { print-color-adjust: exact; -webkit-print-color-adjust: exact; } }
"""

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body style="--verdict: {colour}">
<main>
{body}
</main>
</body>
</html>
"""
