"""The one template of all report pages, with its style: no files beside it, no network."""

STYLE = """
:root { --ink: #1d2329; --soft: #59636e; --line: #d8dde3; --paper: #ffffff; --wash: #f5f7f9;
  --good: #1b6e3c; --caution: #8a5a00; --bad: #a4262c; --neutral: #1f5f99; --mark: #fff6da; --on-tone: #ffffff;
  --data-blue: #0072b2; --data-sky: #56b4e9; --data-orange: #d55e00; --data-green: #009e73; color-scheme: light dark; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e9ec; --soft: #a3adb7; --line: #3a424b; --paper: #15191e; --wash: #1e242a;
  --good: #5cc58a; --caution: #e0b04c; --bad: #f08a8a; --neutral: #7db8ea; --mark: #40371c; --on-tone: #15191e;
  --data-blue: #4aa8e8; --data-sky: #8fcdf2; --data-orange: #ff8a3d; --data-green: #35c99b; }
  figure img { background: #fff; padding: .3rem; border-radius: .2rem; } }
@media print { :root { --ink: #1d2329; --soft: #59636e; --line: #d8dde3; --paper: #ffffff; --wash: #f5f7f9; --good: #1b6e3c;
  --caution: #8a5a00; --bad: #a4262c; --neutral: #1f5f99; --mark: #fff6da; --on-tone: #fff; --data-blue: #0072b2;
  --data-sky: #56b4e9; --data-orange: #d55e00; --data-green: #009e73; } }
* { box-sizing: border-box; }
html { font-size: 100%; -webkit-text-size-adjust: 100%; }
body { margin: 0; background: var(--paper); color: var(--ink); line-height: 1.5;
  font-family: system-ui, "Segoe UI", "Helvetica Neue", Arial, "DejaVu Sans", sans-serif; }
main, footer { max-width: 60rem; margin: 0 auto; padding: 0 1.5rem; }
header { margin: 2.2rem 0 1.2rem; }
h1 { font-size: 1.65rem; line-height: 1.2; margin: 0; font-weight: 650; }
h2 { font-size: 1.2rem; margin: 2.4rem 0 .6rem; padding-top: 1.2rem; border-top: 1px solid var(--line); font-weight: 650; }
h3 { font-size: 1rem; margin: 1.4rem 0 .4rem; font-weight: 650; }
p { margin: .5rem 0; max-width: 46rem; }
.subtitle, figcaption, caption, .note { color: var(--soft); }
.subtitle { margin: .3rem 0 0; }
.verdict { display: grid; grid-template-columns: auto 1fr; gap: 0 .9rem; align-items: start; margin: 1.2rem 0;
  padding: 1rem 1.2rem; background: var(--wash); border-left: .35rem solid var(--tone); border-radius: .2rem; }
.verdict .mark { color: var(--on-tone); background: var(--tone); width: 1.7rem; height: 1.7rem; border-radius: 50%;
  text-align: center; line-height: 1.7rem; font-weight: 700; }
.verdict p { font-size: 1.15rem; margin: 0; max-width: none; }
.verdict .more { font-size: 1rem; color: var(--soft); margin-top: .3rem; grid-column: 2; }
.good { --tone: var(--good); } .caution { --tone: var(--caution); } .bad { --tone: var(--bad); }
.neutral { --tone: var(--neutral); }
.keys { display: grid; grid-template-columns: repeat(auto-fit, minmax(10.5rem, 1fr)); gap: .8rem; margin: 1.2rem 0; padding: 0; }
.keys div { border: 1px solid var(--line); border-radius: .3rem; padding: .7rem .9rem; }
.keys dt { color: var(--soft); font-size: .85rem; }
.keys dd { margin: 0; }
.keys .value { font-size: 1.45rem; font-weight: 600; line-height: 1.25; font-variant-numeric: tabular-nums; }
.keys .value + dd { color: var(--soft); font-size: .85rem; }
nav ul { list-style: none; display: flex; flex-wrap: wrap; gap: .2rem 1.2rem; padding: 0; margin: .8rem 0; font-size: .92rem; }
a { color: var(--neutral); }
.wide { overflow-x: auto; margin: .9rem 0; position: relative; }
.wide.cut { box-shadow: inset -1.2rem 0 1rem -1rem var(--soft); }
.wide + .hint { display: none; font-size: .85rem; color: var(--soft); margin: -.6rem 0 .9rem; }
.wide.scrolls + .hint { display: block; }
table { border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; padding: 0 0 .4rem; }
caption span { display: inline-block; position: sticky; left: 0; max-width: min(46rem, calc(100vw - 2rem)); }
th, td { padding: .32rem .9rem .32rem 0; text-align: left; vertical-align: top; border-bottom: 1px solid var(--line); }
thead th { border-bottom: 2px solid var(--ink); font-weight: 600; vertical-align: bottom; }
th.number, td.number { text-align: right; } td { white-space: pre-line; } td.short { white-space: pre; } td:not(.number):not(.short) { min-width: 8.5rem; }
tr.marked td { background: var(--mark); }
figure { margin: 1.1rem 0; }
figure img, figure svg { max-width: 100%; height: auto; display: block; }
figure svg { width: 100%; overflow: hidden; stroke-linejoin: round; }
figure svg text { font-family: system-ui, "Segoe UI", "Helvetica Neue", Arial, "DejaVu Sans", sans-serif; }
.plot { position: relative; } .plot.zoomed svg { cursor: grab; touch-action: none; }
.plot .narrow { display: none; }
.plot .zoom { display: flex; justify-content: flex-end; gap: .2rem; opacity: 0; margin-top: .1rem; }
.plot:hover .zoom, .plot:focus-within .zoom, .plot.zoomed .zoom { opacity: 1; }
.zoom button { font: inherit; font-size: .85rem; line-height: 1; min-width: 1.8rem; min-height: 1.8rem; color: var(--ink); background: var(--wash);
  border: 1px solid var(--line); border-radius: .2rem; cursor: pointer; }
@media (hover: none) { .plot .zoom { opacity: .75; } }
@media (max-width: 40rem) { .plot.both .wide-form { display: none; } .plot.both .narrow { display: block; }
  main, footer { padding: 0 1rem; } h1 { font-size: 1.35rem; } .verdict { padding: .8rem .9rem; } .verdict p { font-size: 1.02rem; }
  th, td { padding-right: .7rem; } .wide th:first-child, .wide td:first-child { position: sticky; left: 0; background: var(--paper); min-width: 7.5rem;
  max-width: 40vw; overflow-wrap: anywhere; z-index: 1; } .wide tr.marked td:first-child { background: var(--mark); } footer dl { grid-template-columns: 1fr; }
  footer dt { font-weight: 600; } ul { padding-left: 1.2rem; } li, p { overflow-wrap: anywhere; } }
figcaption { font-size: .9rem; margin-top: .3rem; max-width: 46rem; }
details { margin: .9rem 0; border: 1px solid var(--line); border-radius: .3rem; padding: 0 1rem; }
details[open] { padding-bottom: .6rem; }
summary { cursor: pointer; padding: .55rem 0; font-weight: 600; }
pre { background: var(--wash); padding: .8rem 1rem; overflow-x: auto; font-size: .85rem; border-radius: .3rem; }
footer { margin-top: 3rem; padding-top: .8rem; padding-bottom: 2rem; color: var(--soft); font-size: .85rem; }
footer dl { display: grid; grid-template-columns: max-content 1fr; gap: .1rem 1rem; margin: 0;
  border-top: 1px solid var(--line); padding-top: .8rem; }
footer dd { margin: 0; overflow-wrap: anywhere; }
@media print {
  html { font-size: 10pt; } main, footer { max-width: none; padding: 0; } nav { display: none; }
  h2, h3 { break-after: avoid; } figure, .verdict, .keys div, tr { break-inside: avoid; }
  details { border: 0; padding: 0; } a { color: inherit; text-decoration: none; }
  .verdict { border: 1px solid var(--line); border-left: .35rem solid var(--tone); print-color-adjust: exact; }
}
"""

SCRIPT = """
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach(d => { d.open = true; }));
const tables = document.querySelectorAll(".wide");
const look = () => tables.forEach(t => { const over = t.scrollWidth > t.clientWidth + 2;
  t.classList.toggle("scrolls", over); t.classList.toggle("cut", over && t.scrollLeft + t.clientWidth < t.scrollWidth - 2);
  if (over) { t.tabIndex = 0; } });
tables.forEach(t => t.addEventListener("scroll", look)); addEventListener("resize", look);
document.querySelectorAll("details").forEach(d => d.addEventListener("toggle", look)); look();
document.querySelectorAll(".plot").forEach(plot => {
  const drawings = [...plot.querySelectorAll("svg")].map(svg => ({ svg, home: svg.getAttribute("viewBox").split(" ").map(Number) }));
  let scale = 1, x = 0.5, y = 0.5;                       // how far in, and the middle of what is seen, as shares of the whole
  const show = () => { const half = 0.5 / scale; x = Math.min(Math.max(x, half), 1 - half); y = Math.min(Math.max(y, half), 1 - half);
    drawings.forEach(({ svg, home }) => svg.setAttribute("viewBox", [home[0] + (x - half) * home[2], home[1] + (y - half) * home[3],
      home[2] / scale, home[3] / scale].join(" "))); plot.classList.toggle("zoomed", scale > 1); };
  const zoom = (factor, px = 0.5, py = 0.5) => { const next = Math.min(Math.max(scale * factor, 1), 20);
    x += (px - 0.5) * (1 / scale - 1 / next); y += (py - 0.5) * (1 / scale - 1 / next); scale = next; show(); };
  const place = event => { const box = plot.getBoundingClientRect(); return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height]; };
  const bar = document.createElement("div"); bar.className = "zoom";
  [["+", "zoom in", () => zoom(1.6)], ["\u2212", "zoom out", () => zoom(1 / 1.6)], ["1:1", "whole plot", () => { scale = 1; show(); }]].forEach(([sign, name, act]) => {
    const button = document.createElement("button"); button.type = "button"; button.textContent = sign; button.title = name;
    button.setAttribute("aria-label", name); button.onclick = act; bar.append(button); });
  plot.append(bar);
  plot.addEventListener("wheel", event => { if (event.ctrlKey || scale > 1) { event.preventDefault(); zoom(event.deltaY < 0 ? 1.25 : 0.8, ...place(event)); } }, { passive: false });
  plot.addEventListener("dblclick", event => { if (!event.target.closest(".zoom")) { zoom(2, ...place(event)); } });
  let from = null;
  plot.addEventListener("pointerdown", event => { if (scale > 1 && !event.target.closest(".zoom")) { from = place(event); plot.setPointerCapture(event.pointerId); } });
  plot.addEventListener("pointermove", event => { if (from) { const [px, py] = place(event); x -= (px - from[0]) / scale; y -= (py - from[1]) / scale; from = [px, py]; show(); } });
  ["pointerup", "pointercancel"].forEach(kind => plot.addEventListener(kind, () => { from = null; }));
});
"""

PAGE = """
{%- macro block(part) -%}
{%- if part.kind == 'text' %}<p{% if part.note %} class="note"{% endif %}>{{ part.text }}</p>
{%- elif part.kind == 'heading' %}<h3>{{ part.text }}</h3>
{%- elif part.kind == 'code' %}<pre>{{ part.text }}</pre>
{%- elif part.kind == 'list' %}<ul>{% for item in part.entries %}<li>{{ item }}</li>{% endfor %}</ul>
{%- elif part.kind == 'keys' %}<dl class="keys">{% for name, value, remark in part.entries %}<div><dt>{{ name }}</dt>
<dd class="value">{{ value }}</dd>{% if remark %}<dd>{{ remark }}</dd>{% endif %}</div>{% endfor %}</dl>
{%- elif part.kind == 'table' %}<div class="wide"><table>{% if part.caption %}<caption><span>{{ part.caption }}</span></caption>{% endif %}
<thead><tr>{% for head in part.header %}<th scope="col"{% if part.numeric[loop.index0] %} class="number"{% endif %}>{{ head|breakable }}</th>
{%- endfor %}</tr></thead><tbody>
{%- for row in part.rows %}<tr{% if loop.index0 in part.marked %} class="marked"{% endif %}>{% for cell in row %}
<td{% if part.numeric[loop.index0] or cell|short %} class="{{ "number " if part.numeric[loop.index0] }}{{ "short" if cell|short }}"{% endif %}>{{ cell|breakable }}</td>{% endfor %}</tr>{% endfor %}</tbody></table></div><p class="hint" aria-hidden="true">The table goes on to the right: scroll it sideways.</p>
{%- elif part.kind == 'figure' %}<figure>{% if part.source %}<img src="{{ part.source }}" alt="{{ part.alt }}" width="{{ part.width }}">
{%- else %}<div class="plot{% if part.narrow %} both{% endif %}" role="img" aria-label="{{ part.alt }}" style="max-width: {{ part.width }}px">
<div class="wide-form">{{ part.wide }}</div>{% if part.narrow %}<div class="narrow">{{ part.narrow }}</div>{% endif %}</div>{% endif %}
{%- if part.caption %}<figcaption>{{ part.caption }}</figcaption>{% endif %}</figure>
{%- elif part.kind == 'details' %}<details><summary>{{ part.title }}</summary>{% for inner in part.parts %}{{ block(inner) }}
{% endfor %}</details>{% endif %}
{%- endmacro -%}
<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ title }}</title><style>{{ style }}</style></head><body><main>
<header><h1>{{ title }}</h1>{% if subtitle %}<p class="subtitle">{{ subtitle }}</p>{% endif %}</header>
{%- if verdict %}<div class="verdict {{ verdict.tone }}" role="status"><span class="mark" aria-hidden="true">{{ verdict.mark }}</span>
<p>{{ verdict.sentence }}</p>{% if verdict.more %}<p class="more">{{ verdict.more }}</p>{% endif %}</div>{% endif %}
{%- for part in lead %}{{ block(part) }}
{% endfor %}
{%- if sections|length > 3 %}<nav aria-label="Contents"><ul>{% for section in sections %}<li><a href="#s{{ loop.index }}">{{ section.title }}</a></li>
{%- endfor %}</ul></nav>{% endif %}
{%- for section in sections %}<section id="s{{ loop.index }}"><h2>{{ section.title }}</h2>
{% for part in section.parts %}{{ block(part) }}
{% endfor %}</section>
{% endfor %}</main>
<footer><dl>{% for name, value in about %}<dt>{{ name }}</dt><dd>{{ value }}</dd>{% endfor %}</dl></footer>
<script>{{ script }}</script>
</body></html>
"""
