"""The frame of every HTML page of the harness: page.html around it, and page.css as what all of them look like."""

from __future__ import annotations

from html import escape
from pathlib import Path
from string import Template

_HERE = Path(__file__).parent


def framed(title: str, style: str, body: str, *, policy: str = "", scripts: str = "") -> str:
    """A whole HTML file. `title` is text, `body` markup, `style` CSS that follows page.css and may overrule it.

    `policy`: a Content-Security-Policy, if the page is to have one; `scripts`: markup for its end.
    """
    template = Template((_HERE / "page.html").read_text(encoding="utf-8"))
    common = (_HERE / "page.css").read_text(encoding="utf-8")
    bound = f'<meta http-equiv="Content-Security-Policy" content="{escape(policy)}">\n' if policy else ""
    return template.substitute(title=escape(title), style=common + style, body=body, policy=bound, scripts=scripts)
