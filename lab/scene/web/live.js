"use strict";
// The live page: frames by server-sent events, drawn once a picture of the screen; buttons ask the server.
const KEPT_S = 60;
async function startLive() {
  const token = new URLSearchParams(location.search).get("token"), ask = path => `${path}?token=${encodeURIComponent(token)}`;
  document.querySelector("h1").textContent = document.title;
  const data = await (await fetch(ask("/head"))).json(), home = document.getElementById("live"), state = document.getElementById("state");
  let frame = null, fresh = false, marks = data.marks, epoch = null, trail = { base: [], ghost: [] }, drawn = [];
  const stage = new Stage(home, data.head, () => { fresh = true; }), index = Object.fromEntries(data.head.values.map((v, i) => [v.name, i]));
  const charts = new Charts(document.getElementById("charts"));
  const chart = (title, unit, names, more = {}) => charts.add({ title, unit, ...more, series: names.map(([name, text, colour, width]) => ({ source: name, name: text, colour, width, t: [], y: [] })) });
  chart("Static stability margin, mm", "mm", [["margin_measured", "measured CoM", "#e07b1a", 1], ["margin", "planned CoM", "#2a9d63", 1.8]], { limits: [{ value: 0, text: "edge of the support region" }] });
  chart("Velocity forward, m/s", "m/s", [["speed", "estimated", "#8fc0ea", 3], ["speed_true", "true", "#1c2733", 0.9]]);
  chart("Tilt, deg", "deg", [["tilt", "", "#1f6fb2"]], { zero: true }); chart("Odometry error, cm", "cm", [["drift", "horizontal", "#e07b1a"]], { zero: true });
  const take = f => {
    if (epoch !== f.epoch) { if (epoch !== null) { marks = []; trail = { base: [], ghost: [] }; for (const c of charts.all) for (const s of c.spec.series) { s.t = []; s.y = []; } } epoch = f.epoch; }
    marks = marks.concat(f.new).slice(-3000); if (f.status) report(f.status); window.live.age_ms = f.age_ms;
    if (f.points === undefined) return;
    const fall = stage.view.height(f.base[0], f.base[1]), g = ghostOf(f, data.head.styles); trail.base.push(f.base[0], f.base[1], fall); if (g) trail.ghost.push(g[0], g[1], fall);
    for (const path of Object.values(trail)) if (path.length > 9000) path.splice(0, 3000);
    for (const c of charts.all) for (const s of c.spec.series) { const v = f.values[index[s.source]]; if (v == null) continue; if (s.t.length && f.t <= s.t[s.t.length - 1]) continue; s.t.push(f.t); s.y.push(v); while (s.t[0] < f.t - KEPT_S) { s.t.shift(); s.y.shift(); } }
    frame = f; fresh = true; window.live.frames++; window.live.frame = f;
  };
  const report = status => {
    const well = status.services.length && status.services.every(s => !s.silent && !Object.keys(s.late || {}).length);
    state.textContent = status.services.length ? (well ? "well" : "look") : "silent"; state.className = "chip " + (well ? "pass" : "fail"); state.title = status.time;
    stage.words.title = status.time; const table = document.getElementById("services"); table.replaceChildren();
    const head = element("tr", table); for (const text of ["service", "state", "tick us p50 / p99", "MB", "remarks"]) element("th", head, text);
    for (const s of status.services) {
      const row = element("tr", table), late = Object.entries(s.late || {}).map(([k, v]) => `${k} silent for ${v.toFixed(1)} s`);
      for (const text of [s.service, s.silent ? "silent" : s.doing || s.state || "", `${(s.tick_p50_us || 0).toFixed(0)} / ${(s.tick_p99_us || 0).toFixed(0)}`, (s.rss_mb || 0).toFixed(0), late.join(", ")]) element("td", row, text || "-");
      row.className = s.silent || late.length ? "bad" : "";
    }
    const time = element("tr", table); element("td", time, "time"); element("td", time, status.time).colSpan = 4;
    const log = document.getElementById("log"); log.replaceChildren(); for (const text of status.log) element("li", log, text);
  };
  const answer = document.getElementById("answer");
  const act = async (action, fields = {}) => {
    const reply = await fetch(ask("/do"), { method: "POST", body: JSON.stringify({ action, fields }) }), text = await reply.text(); let found;
    try { found = JSON.parse(text); } catch { found = { accepted: false, reason: text }; }
    answer.textContent = `${action}: ${found.accepted ? "done" : "refused"}${found.reason ? ", " + found.reason : ""}`; answer.className = found.accepted ? "" : "bad"; return found;
  };
  for (const b of home.querySelectorAll("[data-do]")) b.onclick = () => act(b.dataset.do, JSON.parse(b.dataset.fields || "{}"));
  home.querySelector("#speed").onchange = e => act("speed", { rtf: +e.target.value });
  const faults = home.querySelector("#fault"); for (const kind of ["imu_drop", "joints_drop", "contacts_drop", "imu_freeze", "joints_freeze", "packet_loss"]) element("option", faults, kind);
  home.querySelector("#break").onclick = () => act("fault", { kind: faults.value, duration: 2, ...(faults.value == "packet_loss" ? { value: 0.3 } : {}) });
  window.live = { frames: 0, frame: null, fps: 0, age_ms: null, act, stage, charts };
  const stream = new EventSource(ask("/events")); stream.onmessage = e => take(JSON.parse(e.data)); stream.onerror = () => { state.textContent = "no connection"; state.className = "chip fail"; };
  let last = 0; const paint = now => {
    if (fresh && frame) { fresh = false; stage.show(frame, marks, trail); if (now - last > 200) { last = now; charts.drawAll(); } drawn.push(now); while (drawn[0] < now - 2000) drawn.shift(); window.live.fps = drawn.length / 2; document.body.dataset.ready = "1"; }
    requestAnimationFrame(paint);
  }; requestAnimationFrame(paint);
}
