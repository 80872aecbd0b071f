"""The one template of all report pages, with its style: no files beside it, no network."""

STYLE = """
:root { --ink: #1d2329; --soft: #59636e; --line: #d8dde3; --paper: #ffffff; --wash: #f5f7f9;
  --good: #1b6e3c; --caution: #8a5a00; --bad: #a4262c; --neutral: #1f5f99; }
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
.verdict .mark { color: #fff; background: var(--tone); width: 1.7rem; height: 1.7rem; border-radius: 50%;
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
.wide { overflow-x: auto; margin: .9rem 0; }
table { border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; padding: 0 0 .4rem; }
th, td { padding: .32rem .9rem .32rem 0; text-align: left; vertical-align: top; border-bottom: 1px solid var(--line); }
thead th { border-bottom: 2px solid var(--ink); font-weight: 600; vertical-align: bottom; }
th.number, td.number { text-align: right; }
tr.marked td { background: #fff6da; }
figure { margin: 1.1rem 0; }
figure img { max-width: 100%; height: auto; display: block; }
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

PAGE = """
{%- macro block(part) -%}
{%- if part.kind == 'text' %}<p{% if part.note %} class="note"{% endif %}>{{ part.text }}</p>
{%- elif part.kind == 'heading' %}<h3>{{ part.text }}</h3>
{%- elif part.kind == 'code' %}<pre>{{ part.text }}</pre>
{%- elif part.kind == 'list' %}<ul>{% for item in part.entries %}<li>{{ item }}</li>{% endfor %}</ul>
{%- elif part.kind == 'keys' %}<dl class="keys">{% for name, value, remark in part.entries %}<div><dt>{{ name }}</dt>
<dd class="value">{{ value }}</dd>{% if remark %}<dd>{{ remark }}</dd>{% endif %}</div>{% endfor %}</dl>
{%- elif part.kind == 'table' %}<div class="wide"><table>{% if part.caption %}<caption>{{ part.caption }}</caption>{% endif %}
<thead><tr>{% for head in part.header %}<th scope="col"{% if part.numeric[loop.index0] %} class="number"{% endif %}>{{ head }}</th>
{%- endfor %}</tr></thead><tbody>
{%- for row in part.rows %}<tr{% if loop.index0 in part.marked %} class="marked"{% endif %}>{% for cell in row %}
<td{% if part.numeric[loop.index0] %} class="number"{% endif %}>{{ cell }}</td>{% endfor %}</tr>{% endfor %}</tbody></table></div>
{%- elif part.kind == 'figure' %}<figure><img src="{{ part.source }}" alt="{{ part.alt }}" width="{{ part.width }}">
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
<script>addEventListener("beforeprint", () => document.querySelectorAll("details").forEach(d => { d.open = true; }));</script>
</body></html>
"""
