"""HTML page of the live view of a running system: picture, buttons, plots, services, log."""

from ..scene.pages import LAYOUT, page, stage

BAR = """<span class="group" data-needs="pause"><button data-do="pause">pause</button>
<button data-do="resume" data-fields='{"ticks":null}'>go on</button>
<button data-do="step" data-fields='{"ticks":1}' title="10 ms of simulated time">1 tick</button>
<button data-do="step" data-fields='{"ticks":20}' title="0.2 s of simulated time">20 ticks</button></span>
<span class="group" data-needs="speed"><select id="speed" aria-label="speed"><option value="" selected>speed</option>
<option value="0.1">0.1x</option><option value="0.25">0.25x</option><option value="0.5">0.5x</option>
<option value="1">1x</option><option value="2">2x</option><option value="0">as fast as it goes</option></select></span>
<span class="group" data-needs="push"><input id="force" type="number" min="0" step="any" aria-label="force, N"> N
<button data-push="1,0" title="forward">&#8593;</button><button data-push="-1,0" title="back">&#8595;</button>
<button data-push="0,1" title="to its left">&#8592;</button>
<button data-push="0,-1" title="to its right">&#8594;</button> push</span>
<span class="group" data-needs="fault"><select id="kind" data-kept="0" aria-label="kind of fault"></select>
<select id="target" data-kept="1" aria-label="joint or leg"><option value="">anywhere</option></select>
<input id="size" type="number" step="any" value="0.3" aria-label="size">
<button id="break">break for 2 s</button></span>
<span class="group" data-needs="reset"><button data-do="reset" data-fields='{"keep":true}'>begin anew</button></span>
<button data-do="stop" class="stop" title="emergency stop: the joints are held until a new run begins">STOP</button>
<output id="answer"></output>"""


def live_page(title: str) -> str:
    """Return the HTML page of the live view of a running system, with the given title."""
    body = (
        '<main><header><span class="chip" id="state">...</span><h1></h1><p id="time"></p></header>'
        f'{stage("live", BAR)}<figure id="sight" hidden><figcaption></figcaption><canvas></canvas></figure>'
        '<div id="charts" class="plots"></div>'
        '<section class="columns"><div><h2>Services</h2><table id="services"></table></div>'
        '<div><h2>Log</h2><ul class="events" id="log"></ul></div></section>'
        '<section><p class="note">In other viewers: <code>surefoot bridge foxglove</code> live, '
        "<code>surefoot bag export run.mcap --to foxglove</code> for a recording; "
        f'<a id="layout" download="surefoot-{LAYOUT}">layout</a> for Foxglove and Lichtblick. '
        '<span id="pace"></span></p></section></main>'
    )
    return page(title, body, ("scene.js", "charts.js", "replay.js", "live.js"), "startLive();")
