"""Parts of the web pages that show a scene: a self-contained HTML document, and the picture with its controls."""

import html
from collections.abc import Iterable
from functools import cache
from pathlib import Path

WEB = Path(__file__).with_name("web")
LAYOUT = "lichtblick.json"
"""Name of the file with the layout for Foxglove and Lichtblick, which the pages offer."""
POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; connect-src 'self'; img-src data:"
"""Content security policy of the pages: they may load from themselves and connect to the server they came from."""

REPLAY_BAR = """<button class="play" title="space">&#9654;</button>
<button class="back" title="one frame back">&#9664;</button><button class="on" title="one frame on">&#9654;|</button>
<input type="range" aria-label="time">
<select class="speed" aria-label="speed"><option value="0.1">0.1x</option><option value="0.25">0.25x</option>
<option value="0.5">0.5x</option><option value="1" selected>1x</option><option value="2">2x</option>
<option value="5">5x</option></select>"""


@cache
def asset(name: str) -> str:
    """Return the text of a script or style sheet of the web pages."""
    return (WEB / name).read_text(encoding="utf-8")


def page(title: str, body: str, scripts: Iterable[str], start: str) -> str:
    """Return an HTML document with title, body, scripts and styles inside; `start`: JavaScript that is run last."""
    code = "\n".join(asset(name) for name in scripts)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{asset('page.css')}</style></head>\n"
        f"<body>{body}<script>{code}\n{start}</script></body></html>\n"
    )


def stage(name: str, bar: str) -> str:
    """Return the HTML of the scene's picture with its numbers, views and layers; `bar`: HTML of the controls."""
    return (
        f'<section class="stage" id="{name}"><div class="picture"><canvas></canvas><div class="clock"></div>'
        '<div class="words"></div><div class="numbers"></div><div class="looks"></div>'
        '<div class="hint">drag to turn, shift-drag to move, wheel to zoom</div></div>'
        f'<div class="bar">{bar}</div><div class="layers"></div></section>'
    )
