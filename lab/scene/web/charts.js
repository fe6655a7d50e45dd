"use strict";
// Charts over one axis of time: drag to zoom all of them, double click for the whole, click to go to a time.
class Charts {
  constructor(home, seek = () => {}) { this.home = home; this.seek = seek; this.all = []; this.range = null; this.now = null; }
  add(spec) { // {title, unit, series: [{name, colour, t, y, lo, hi, dots, width, dash}], limits: [{value, text}], marks: [{t, y, text}], log, zero, note}
    const figure = element("figure", this.home), caption = element("figcaption", figure, spec.title), legend = element("div", figure, "", "legend"), canvas = element("canvas", figure);
    const chart = { spec, canvas, legend, caption, hidden: new Set() };
    for (const [i, s] of spec.series.entries()) {
      const key = element("button", legend); element("i", key).style.background = s.colour; element("span", key, s.name); chart["value" + i] = element("b", key);
      key.onclick = () => { chart.hidden.has(i) ? chart.hidden.delete(i) : chart.hidden.add(i); key.classList.toggle("off"); this.draw(chart); };
    }
    if (spec.note) element("p", figure, spec.note, "note");
    this.all.push(chart); this.listen(chart); return chart;
  }
  full() {
    let lo = Infinity, hi = -Infinity;
    for (const { spec } of this.all) for (const s of spec.series) if (s.t.length) { lo = Math.min(lo, s.t[0]); hi = Math.max(hi, s.t[s.t.length - 1]); }
    return lo < hi ? [lo, hi] : [0, 1];
  }
  drawAll() { for (const chart of this.all) this.draw(chart); }
  setNow(t) { this.now = t; this.drawAll(); }
  listen(chart) {
    const c = chart.canvas, time = e => { const b = chart.box; return b.t0 + (e.offsetX - b.left) / (b.right - b.left) * (b.t1 - b.t0); }; let from = null;
    c.addEventListener("pointerdown", e => { from = e.offsetX; chart.from = time(e); c.setPointerCapture(e.pointerId); });
    c.addEventListener("pointermove", e => { this.hover = time(e); chart.to = from != null && Math.abs(e.offsetX - from) > 5 ? time(e) : null; this.drawAll(); });
    c.addEventListener("pointerup", e => {
      if (chart.to != null) { const [a, b] = [chart.from, time(e)].sort((x, y) => x - y), all = this.full(); this.range = [Math.max(a, all[0]), Math.min(b, all[1])]; if (this.range[1] - this.range[0] < 0.02) this.range = null; }
      else if (from != null) this.seek(time(e));
      from = chart.to = null; this.drawAll();
    });
    c.addEventListener("pointerleave", () => { if (from == null) { this.hover = null; this.drawAll(); } });
    c.addEventListener("dblclick", () => { this.range = null; this.drawAll(); });
  }
  draw(chart) {
    const { spec, canvas } = chart, ratio = Math.min(2, window.devicePixelRatio || 1), W = canvas.clientWidth, H = canvas.clientHeight; if (!W) return;
    if (canvas.width != Math.round(W * ratio)) { canvas.width = Math.round(W * ratio); canvas.height = Math.round(H * ratio); }
    const ctx = canvas.getContext("2d"); ctx.setTransform(ratio, 0, 0, ratio, 0, 0); ctx.clearRect(0, 0, W, H); ctx.font = "11px system-ui,sans-serif";
    const [t0, t1] = this.range || this.full(), box = chart.box = { left: 52, right: W - 8, top: 6, bottom: H - 20, t0, t1 };
    const [y0, y1] = this.scale(chart, t0, t1), form = spec.log ? v => Math.log10(Math.max(v, 1e-9)) : v => v;
    const X = t => box.left + (t - t0) / (t1 - t0) * (box.right - box.left), Y = v => box.bottom - (form(v) - y0) / (y1 - y0) * (box.bottom - box.top);
    this.axes(ctx, spec, box, y0, y1, X, Y);
    ctx.save(); ctx.beginPath(); ctx.rect(box.left, box.top - 2, box.right - box.left, box.bottom - box.top + 4); ctx.clip();
    spec.series.forEach((s, i) => { if (!chart.hidden.has(i)) this.curve(ctx, s, X, Y, t0, t1); });
    for (const limit of spec.limits || []) {
      const v = form(limit.value); ctx.fillStyle = ctx.strokeStyle = "#cc3b3b";
      if (v >= y0 && v <= y1) { ctx.setLineDash([6, 4]); ctx.lineWidth = 1; line(ctx, box.left, Y(limit.value), box.right, Y(limit.value)); ctx.setLineDash([]); ctx.textAlign = "right"; ctx.fillText(limit.text, box.right - 4, Y(limit.value) - 4); }
      else { ctx.textAlign = "right"; ctx.fillText(limit.text + (v > y1 ? " \u2191" : " \u2193"), box.right - 4, v > y1 ? box.top + 9 : box.bottom - 4); }
    }
    for (const m of spec.marks || []) { ctx.fillStyle = "#cc3b3b"; ctx.beginPath(); ctx.arc(X(m.t), Y(m.y), 4, 0, 7); ctx.fill(); }
    if (chart.to != null) { ctx.fillStyle = "rgba(31,111,178,.15)"; ctx.fillRect(X(chart.from), box.top, X(chart.to) - X(chart.from), box.bottom - box.top); }
    if (this.now != null) { ctx.strokeStyle = "#1c2733"; ctx.lineWidth = 1.2; line(ctx, X(this.now), box.top, X(this.now), box.bottom); }
    if (this.hover != null) { ctx.strokeStyle = "rgba(28,39,51,.35)"; line(ctx, X(this.hover), box.top, X(this.hover), box.bottom); }
    ctx.restore();
    const at = this.hover ?? this.now;
    spec.series.forEach((s, i) => { const v = at == null ? null : nearest(s, at); chart["value" + i].textContent = v == null ? "" : short(v) + (spec.unit ? " " + spec.unit : ""); });
  }
  scale(chart, t0, t1) { // to the curves that can be seen, not to bands or limits
    const { spec } = chart; let lo = spec.zero ? 0 : Infinity, hi = -Infinity;
    spec.series.forEach((s, k) => { if (!chart.hidden.has(k)) for (let i = 0; i < s.t.length; i++) { const v = s.y[i]; if (v != null && s.t[i] >= t0 && s.t[i] <= t1) { lo = Math.min(lo, v); hi = Math.max(hi, v); } } });
    if (lo > hi) [lo, hi] = [0, 1];
    if (spec.log) { lo = Math.log10(Math.max(lo, 1e-4)); hi = Math.log10(Math.max(hi, 1e-4)); }
    else for (const limit of spec.limits || []) { const span = Math.max(hi - lo, 1e-9); if (limit.value > hi && limit.value - hi < 0.6 * span) hi = limit.value; if (limit.value < lo && lo - limit.value < 0.6 * span) lo = limit.value; }
    const pad = 0.08 * Math.max(hi - lo, 1e-6 + 1e-3 * Math.abs(hi)); return [spec.zero && !spec.log ? 0 : lo - pad, hi + pad];
  }
  axes(ctx, spec, box, y0, y1, X, Y) {
    ctx.fillStyle = "#5d6b78"; ctx.strokeStyle = "#e6ebef"; ctx.lineWidth = 1; ctx.textAlign = "right"; ctx.textBaseline = "alphabetic";
    for (const v of ticks(y0, y1, 4, spec.log)) { const value = spec.log ? 10 ** v : v, y = Math.round(Y(value)) + 0.5; line(ctx, box.left, y, box.right, y); ctx.fillText(short(value), box.left - 6, y + 3.5); }
    ctx.textAlign = "center";
    for (const t of ticks(box.t0, box.t1, 8)) { const x = Math.round(X(t)) + 0.5; line(ctx, x, box.top, x, box.bottom); ctx.fillText(short(t) + " s", x, box.bottom + 14); }
  }
  curve(ctx, s, X, Y, t0, t1) {
    let a = 0, b = s.t.length; while (a < b - 1 && s.t[a + 1] < t0) a++; while (b > a + 1 && s.t[b - 2] > t1) b--;
    if (s.hi) {
      ctx.fillStyle = s.colour; ctx.globalAlpha = 0.16; ctx.beginPath();
      for (let i = a; i < b; i++) if (s.hi[i] != null) ctx.lineTo(X(s.t[i]), Y(s.hi[i]));
      for (let i = b - 1; i >= a; i--) if (s.lo[i] != null) ctx.lineTo(X(s.t[i]), Y(s.lo[i])); ctx.fill(); ctx.globalAlpha = 1;
    }
    ctx.strokeStyle = ctx.fillStyle = s.colour; ctx.lineWidth = s.width || 1.4; ctx.setLineDash(s.dash || []); ctx.beginPath(); let pen = false;
    for (let i = a; i < b; i++) {
      const v = s.y[i]; if (v == null) { pen = false; continue; }
      const x = X(s.t[i]), y = Y(v);
      if (s.dots) { ctx.moveTo(x + 3, y); ctx.arc(x, y, 3, 0, 7); } else if (pen) ctx.lineTo(x, y); else ctx.moveTo(x, y);
      pen = true;
    }
    s.dots ? ctx.fill() : ctx.stroke(); ctx.setLineDash([]);
  }
}
function element(tag, home, text = "", css = "") { const e = document.createElement(tag); if (text) e.textContent = text; if (css) e.className = css; home.append(e); return e; }
function line(ctx, x0, y0, x1, y1) { ctx.beginPath(); ctx.moveTo(x0, y0); ctx.lineTo(x1, y1); ctx.stroke(); }
function nearest(s, t) { // value at a time; null far from every sample
  let a = 0, b = s.t.length - 1; if (b < 0) return null;
  while (a < b) { const m = (a + b) >> 1; s.t[m] < t ? a = m + 1 : b = m; }
  if (a > 0 && t - s.t[a - 1] < s.t[a] - t) a--;
  return Math.abs(s.t[a] - t) < (s.dots ? 0.3 : 0.5) ? s.y[a] : null;
}
function ticks(lo, hi, most, whole = false) {
  const raw = (hi - lo) / most, power = 10 ** Math.floor(Math.log10(raw || 1)); let step = [1, 2, 5, 10].map(k => k * power).find(s => s >= raw) || raw;
  if (whole) step = Math.max(1, Math.round(step));
  const out = []; for (let v = Math.ceil(lo / step) * step; v <= hi + 1e-9 * step; v += step) out.push(Math.abs(v) < 1e-9 * step ? 0 : v); return out;
}
function short(v) { return v == null ? "-" : Math.abs(v) >= 100 ? v.toFixed(0) : String(+v.toPrecision(3)); }
