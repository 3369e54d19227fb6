"""What a page holds for its scripts: the numbers of images, the colours of maps, and the scripts themselves."""

from __future__ import annotations

import base64
import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from harness.report.figures.pictures import DIFFERENCE_MAP, FLIP_MAP, palette
from harness.report.pixels import Pixels

# In this order they are one script.
SCRIPTS = ("numbers.js", "viewer.js", "page.js")
# A page that says so may load nothing and send nothing, whatever is put into it.
POLICY = ("default-src 'none'; img-src data:; font-src data:; style-src 'unsafe-inline'; "
          "script-src 'unsafe-inline'")


def scripts() -> str:
    """The page's scripts, for its end."""
    folder = Path(__file__).parent
    return "\n".join(f"<script>\n{(folder / name).read_text(encoding='utf-8')}</script>" for name in SCRIPTS)


def pixels_script(pixels: Pixels) -> str:
    """The numbers as a script element that nothing runs: JSON in which each plane's `data` is `Plane.content` in
    base64."""
    return f'<script type="application/json" class="pixels">{_json(_plain(pixels))}</script>'


def palettes_script() -> str:
    """The colours of the page's maps, each three bytes, in base64."""
    maps = {"signed": DIFFERENCE_MAP, "flip": FLIP_MAP}
    held = {name: base64.b64encode(palette(chosen)).decode() for name, chosen in maps.items()}
    return f'<script type="application/json" id="palettes">{_json(held)}</script>'


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return {"data" if each.name == "content" else each.name: _plain(getattr(value, each.name))
                for each in fields(value)}
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return base64.b64encode(value).decode() if isinstance(value, bytes) else value


def _json(value: Any) -> str:
    """JSON that cannot end the element that it stands in."""
    return json.dumps(value, allow_nan=False).replace("<", "\\u003c")
