"use strict";
// The live page: frames by server-sent events, drawn once a picture of the screen; buttons ask the server.
const KEPT_S = 60, KEPT_PLACES = 9000, KEPT_MARKS = 3000, KEPT_AGES = 600, CHARTS_MS = 200, FPS_MS = 2000;
async function startLive() {
  const $ = id => document.getElementById(id), token = new URLSearchParams(location.search).get("token"), ask = path => `${path}?token=${encodeURIComponent(token)}`;
  document.querySelector("h1").textContent = document.title; $("layout").href = ask("/lichtblick.json");
  const asked = async () => (await fetch(ask("/head"))).json(), home = $("live"), state = $("state"), answer = $("answer");
  let data = await asked(), frame = null, fresh = false, marks = [], epoch = null, world = data.world, trail = { base: [], ghost: [] }, drawn = [], held = false;
  const stage = new Stage(home, data.head, () => { fresh = true; }), index = Object.fromEntries(data.head.values.map((v, i) => [v.name, i]));
  const charts = new Charts($("charts")), chart = (title, unit, names, more = {}) => charts.add({ title, unit, ...more, series: names.map(([name, text, colour, width]) => ({ source: name, name: text, colour, width, t: [], y: [] })) });
  chart("Static stability margin, mm", "mm", [["margin_measured", "measured CoM", "#e07b1a", 1], ["margin", "planned CoM", "#2a9d63", 1.8]], { limits: [{ value: 0, text: "edge of the support region" }] });
  chart("Velocity forward, m/s", "m/s", [["speed", "estimated", "#8fc0ea", 3], ["speed_true", "true", "#1c2733", 0.9]]);
  chart("Tilt, deg", "deg", [["tilt", "of the trunk", "#1f6fb2"]], { zero: true }); chart("Odometry error, cm", "cm", [["drift", "horizontal", "#e07b1a"]], { zero: true });
  const forget = () => { marks = []; trail = { base: [], ghost: [] }; for (const c of charts.all) for (const s of c.spec.series) { s.t = []; s.y = []; } };
  const offer = () => {
    for (const part of home.querySelectorAll("[data-needs]")) part.hidden = !data.actions.includes(part.dataset.needs);
    const fill = (list, words) => { const before = list.value; while (list.options.length > list.dataset.kept) list.remove(list.dataset.kept); for (const word of words) element("option", list, word); list.value = before; if (list.selectedIndex < 0) list.selectedIndex = 0; };
    fill($("kind"), data.faults); fill($("target"), data.targets); if (!$("force").value) $("force").value = data.push_n; sized();
  };
  const sized = () => { $("size").hidden = !data.sized.includes($("kind").value); }; $("kind").onchange = sized;
  const renew = async number => { world = number; data = await asked(); world = data.world; stage.view.setHead(data.head); offer(); fresh = true; }; // another ground or driver
  const sight = s => { // the last image that vision read: features orange, matches and their gates green
    const home = $("sight"), canvas = home.querySelector("canvas"), pen = canvas.getContext("2d"), picture = new Image();
    picture.onload = () => {
      canvas.width = s.width; canvas.height = s.height; pen.drawImage(picture, 0, 0); pen.fillStyle = "#e07b1a"; pen.strokeStyle = "#2a9d63";
      const line = p => { pen.beginPath(); for (let i = 0; i < p.length; i += 2) pen.lineTo(p[i], p[i + 1]); pen.closePath(); pen.stroke(); };
      for (let i = 0; i < s.features.length; i += 2) pen.fillRect(s.features[i] - 1, s.features[i + 1] - 1, 2, 2);
      pen.lineWidth = 0.5; for (const gate of s.gates) line(gate);
      pen.lineWidth = 1.2; for (let i = 0; i < s.matches.length; i += 2) { pen.beginPath(); pen.arc(s.matches[i], s.matches[i + 1], 3, 0, 7); pen.stroke(); }
      home.querySelector("figcaption").textContent = `What it saw, ${s.text}`; home.hidden = false; window.live.sight = s;
    };
    picture.src = `data:image/jpeg;base64,${s.jpeg}`;
  };
  const take = ({ epoch: now, world: ground, at, new: more, status, sight: seen, frame: f }) => {
    if (epoch !== now) { forget(); epoch = now; $("sight").hidden = true; }
    if (seen) sight(seen);
    if (ground !== world) renew(ground);
    marks = marks.concat(more).slice(-KEPT_MARKS); if (status) report(status); if (!f) return;
    const fall = stage.view.height(f.base[0], f.base[1]), g = ghostOf(f, data.head.styles); trail.base.push(f.base[0], f.base[1], fall); if (g) trail.ghost.push(g[0], g[1], fall);
    for (const path of Object.values(trail)) if (path.length > KEPT_PLACES) path.splice(0, KEPT_PLACES / 3);
    for (const c of charts.all) for (const s of c.spec.series) { const v = f.values[index[s.source]]; if (v == null || s.t.length && f.t <= s.t[s.t.length - 1]) continue; s.t.push(f.t); s.y.push(v); while (s.t[0] < f.t - KEPT_S) { s.t.shift(); s.y.shift(); } }
    f.at = at; frame = f; fresh = true; window.live.frames++; window.live.frame = f;
  };
  const remarks = s => [...(s.silent ? ["no report on its health"] : []), ...(s.waiting_for || []).map(k => `waits for ${k}`), ...Object.entries(s.late || {}).map(([k, v]) => `${k} silent for ${v.toFixed(1)} s`), ...Object.entries(s.dropped || {}).map(([k, n]) => `${n}x ${k} dropped`)];
  const report = status => {
    const ill = status.services.filter(s => s.silent || Object.keys(s.late || {}).length); held = !!(status.time && status.time.held);
    state.textContent = !status.services.length ? "no services" : ill.length ? "look at " + ill.map(s => s.service).join(", ") : held ? "stopped" : "healthy"; state.className = "chip " + (status.services.length && !ill.length && !held ? "pass" : "fail");
    $("time").textContent = status.time ? status.time.words : "no simulated time: the driver of a real robot"; const table = $("services"); table.replaceChildren();
    const head = element("tr", table); for (const text of ["service", "state", "tick us p50 / p99", "MB", "remarks"]) element("th", head, text);
    for (const s of status.services) {
      const row = element("tr", table), notes = remarks(s), tick = s.tick_p50_us ? `${s.tick_p50_us.toFixed(0)} / ${s.tick_p99_us.toFixed(0)}` : "";
      for (const text of [s.service, s.silent ? "silent" : s.doing, tick, (s.rss_mb || 0).toFixed(0), notes.join(", ")]) element("td", row, text || "-");
      row.className = ill.includes(s) ? "bad" : "";
    }
    const log = $("log"); log.replaceChildren(); for (const [level, text] of status.log) element("li", log, text, level == "error" || level == "warning" ? "bad" : ""); if (!status.log.length) element("li", log, "nothing yet");
    window.live.status = status; while (drawn[0] < performance.now() - FPS_MS) drawn.shift(); $("pace").textContent = `${(1000 * drawn.length / FPS_MS).toFixed(0)} pictures/s.`;
  };
  const act = async (action, fields = {}) => {
    let found; try { const reply = await fetch(ask("/do"), { method: "POST", body: JSON.stringify({ action, fields }) }), text = await reply.text(); try { found = JSON.parse(text); } catch { found = { accepted: false, reason: text }; } } catch { found = { accepted: false, reason: "the view has ended" }; }
    answer.textContent = `${action}: ${found.accepted ? "done" : "refused"}${found.reason ? ", " + found.reason : ""}`; answer.className = found.accepted ? "" : "bad"; return found;
  };
  offer();
  for (const b of home.querySelectorAll("[data-do]")) b.onclick = () => act(b.dataset.do, JSON.parse(b.dataset.fields || "{}"));
  for (const b of home.querySelectorAll("[data-push]")) b.onclick = () => act("push", { force: [...b.dataset.push.split(",").map(x => x * $("force").value), 0], duration: 0.2 });
  $("speed").onchange = e => { if (e.target.value) act("speed", { rtf: +e.target.value }); };
  $("break").onclick = () => act("fault", { kind: $("kind").value, target: $("target").value, duration: 2, ...($("size").hidden ? {} : { value: +$("size").value }) });
  window.live = { frames: 0, frame: null, status: null, fps: 0, painted: [], act, stage, charts };
  const stream = new EventSource(ask("/events")); stream.onmessage = e => take(JSON.parse(e.data));
  stream.onerror = () => { state.textContent = stream.readyState == EventSource.CLOSED ? "the view has ended; start it again" : "no connection"; state.className = "chip fail"; };
  let last = 0; const paint = now => {
    if (fresh && frame) {
      fresh = false; stage.show(frame, marks, trail); if (now - last > CHARTS_MS) { last = now; charts.drawAll(); }
      drawn.push(now); while (drawn[0] < now - FPS_MS) drawn.shift(); const { live } = window; live.fps = 1000 * drawn.length / FPS_MS;
      if (frame.at) { live.painted.push([frame.t, Date.now(), Date.now() - frame.at]); frame.at = 0; if (live.painted.length > KEPT_AGES) live.painted.shift(); }
      document.body.dataset.ready = "1";
    }
    requestAnimationFrame(paint);
  }; requestAnimationFrame(paint);
}
