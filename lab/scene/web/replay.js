"use strict";
// The report's page: replay, slider, plots and worst moments share one time.
async function unpack(id) {
  const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), c => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).json();
}
// Buttons, legend and numbers around a picture; the live view has them too.
class Stage {
  constructor(home, head, changed) {
    this.head = head; this.view = new View(home.querySelector("canvas"), head); this.view.changed = changed; this.numbers = {};
    const numbers = home.querySelector(".numbers"), layers = home.querySelector(".layers"), looks = home.querySelector(".looks");
    this.clock = home.querySelector(".clock"); this.words = home.querySelector(".words");
    for (const v of head.values) { const row = element("div", numbers); element("span", row, v.title); this.numbers[v.name] = element("b", row); }
    for (const [name, title] of [["3d", "3-D"], ["top", "top"], ["side", "side"], ["front", "front"]]) element("button", looks, title).onclick = () => { this.view.look(name); changed(); };
    const follow = this.check(looks, "follow", true, on => { this.view.follow = on; changed(); }); this.follow = follow;
    for (const layer of new Set([...head.styles.map(s => s.layer), "trail"])) {
      const colour = (head.styles.find(s => s.layer == layer) || { colour: "#1f6fb2" }).colour, title = head.styles.filter(s => s.layer == layer).map(s => s.title).join("; ");
      const label = this.check(layers, layer, true, on => { on ? this.view.hidden.delete(layer) : this.view.hidden.add(layer); changed(); }); label.style.setProperty("--c", colour); label.title = title;
    }
  }
  check(home, text, on, done) {
    const label = element("label", home), box = element("input", label); box.type = "checkbox"; box.checked = on; element("span", label, text);
    box.onchange = () => done(box.checked); return label;
  }
  show(frame, marks, trail) {
    this.view.trail = trail; this.view.draw(frame, marks); if (!frame) return;
    this.follow.firstChild.checked = this.view.follow;
    this.clock.textContent = frame.t.toFixed(2) + " s"; this.words.textContent = (frame.fallen ? "FALLEN  " : "") + frame.text;
    this.words.classList.toggle("bad", !!frame.fallen);
    this.head.values.forEach((v, i) => { const x = frame.values[i], e = this.numbers[v.name]; e.textContent = x == null ? "-" : x.toFixed(v.digits) + (v.unit ? " " + v.unit : ""); e.parentNode.hidden = x == null && !this.seen?.has(i); if (x != null) (this.seen ||= new Set()).add(i); });
  }
}
function ghostOf(frame, styles) { // middle of the estimated trunk
  const item = frame.items.find(i => styles[i[0]].name == "ghost"); if (!item) return null;
  let m = [0, 0, 0]; const n = (item.length - 1) / 3; for (let i = 1; i < item.length; i++) m[(i - 1) % 3] += item[i] / n; return m;
}
class Replay {
  constructor(home, data) {
    this.frames = data.frames; this.marks = data.marks; this.playing = false; this.speed = 1; this.at = 0;
    this.stage = new Stage(home, data.head, () => this.show()); this.slider = home.querySelector("input[type=range]"); this.button = home.querySelector(".play");
    const view = this.stage.view; this.trails = { base: [], ghost: [] };
    for (const f of this.frames) { this.trails.base.push(f.base[0], f.base[1], view.height(f.base[0], f.base[1])); const g = ghostOf(f, data.head.styles); if (g) this.trails.ghost.push(g[0], g[1], view.height(g[0], g[1])); else this.trails.ghost.push(NaN, NaN, NaN); }
    this.begin = this.frames[0].t; this.end = this.frames[this.frames.length - 1].t; this.time = this.begin; this.moved = () => {};
    this.slider.min = this.begin; this.slider.max = this.end; this.slider.step = 0.01;
    this.slider.oninput = () => this.go(+this.slider.value); this.button.onclick = () => this.play(!this.playing);
    home.querySelector(".speed").onchange = e => { this.speed = +e.target.value; };
    home.querySelector(".back").onclick = () => this.go(this.frames[Math.max(0, this.at - 1)].t); home.querySelector(".on").onclick = () => this.go(this.frames[Math.min(this.frames.length - 1, this.at + 1)].t);
    document.addEventListener("keydown", e => { if (e.target.tagName == "SELECT") return; if (e.key == " ") { e.preventDefault(); this.play(!this.playing); } if (e.key == "ArrowRight") this.go(this.time + 0.2); if (e.key == "ArrowLeft") this.go(this.time - 0.2); });
    new ResizeObserver(() => this.show()).observe(view.canvas);
  }
  play(on) {
    this.playing = on; this.button.textContent = on ? "\u275a\u275a" : "\u25b6"; if (!on) return;
    if (this.time >= this.end) this.time = this.begin; let last = performance.now();
    const step = now => { if (!this.playing) return; this.time = Math.min(this.end, this.time + this.speed * (now - last) / 1000); last = now; this.show(); if (this.time < this.end) requestAnimationFrame(step); else this.play(false); };
    requestAnimationFrame(step);
  }
  go(t) { this.play(false); this.time = Math.min(this.end, Math.max(this.begin, t)); this.show(); }
  show() {
    let a = 0, b = this.frames.length - 1; while (a < b) { const m = (a + b + 1) >> 1; this.frames[m].t <= this.time ? a = m : b = m - 1; } this.at = a;
    const f = this.frames[a], g = this.frames[a + 1], cut = 3 * (a + 1);
    const ghost = this.trails.ghost.slice(0, cut).filter(x => !isNaN(x)), shown = between(f, g, g ? (this.time - f.t) / (g.t - f.t) : 0);
    this.stage.show({ ...shown, t: this.time }, this.marks.filter(m => m[0] <= this.time), { base: this.trails.base.slice(0, cut), ghost });
    this.slider.value = this.time; this.moved(this.time);
  }
}
async function startReport() {
  const data = await unpack("data"), home = document.getElementById("replay"), replay = data.film ? new Replay(home, data.film) : null;
  const charts = new Charts(document.getElementById("charts"), t => { if (replay) replay.go(t); else charts.setNow(t); });
  for (const spec of data.charts) charts.add(spec);
  const go = t => { if (replay) replay.go(t); else charts.setNow(t); };
  if (replay) { replay.moved = t => charts.setNow(t); replay.go(replay.begin); }
  charts.drawAll(); new ResizeObserver(() => charts.drawAll()).observe(document.body);
  for (const e of document.querySelectorAll("[data-t]")) e.onclick = () => { go(+e.dataset.t); if (replay) home.scrollIntoView({ behavior: "smooth", block: "start" }); };
  const hash = /^#t=([\d.]+)$/.exec(location.hash); if (hash) go(+hash[1]);
  window.report = { replay, charts }; document.body.dataset.ready = "1";
}
