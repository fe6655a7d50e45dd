"use strict";
// Draws a scene on a canvas: orthographic, painter's order. All lengths in the whole units of its header.
class View {
  constructor(canvas, head) {
    this.canvas = canvas; this.ctx = canvas.getContext("2d"); this.setHead(head);
    this.hidden = new Set(); this.follow = true; this.target = [0, 0, 0]; this.trail = { base: [], ghost: [] };
    this.look("3d"); this.changed = () => {}; this.listen();
  }
  setHead(head) {
    this.head = head; this.m = head.unit; this.ground = head.ground || this.plain(); this.picture = null;
  }
  plain() {
    const n = 81, cell = 0.1 * this.m, half = -0.5 * (n - 1) * cell;
    return { rows: n, cols: n, cell, origin: [half, half], z: new Array(n * n).fill(0) };
  }
  look(name) {
    [this.azimuth, this.elevation] = { "3d": [-0.95, 0.5], top: [-Math.PI / 2, Math.PI / 2], side: [-Math.PI / 2, 0.09], front: [0, 0.15] }[name];
    this.zoom = 0.27 * (name == "top" ? 1.15 : 1); this.picture = null;
  }
  listen() {
    const c = this.canvas; let from = null;
    c.addEventListener("pointerdown", e => { from = [e.clientX, e.clientY, e.shiftKey || e.button == 2]; c.setPointerCapture(e.pointerId); });
    c.addEventListener("pointermove", e => {
      if (!from) return;
      const dx = e.clientX - from[0], dy = e.clientY - from[1]; from[0] = e.clientX; from[1] = e.clientY;
      if (from[2]) {
        const k = 1 / this.scale, [sa, ca] = [Math.sin(this.azimuth), Math.cos(this.azimuth)], up = dy * k / Math.max(0.2, Math.sin(this.elevation));
        this.follow = false; this.target[0] += sa * dx * k - ca * up; this.target[1] += -ca * dx * k - sa * up;
      } else {
        this.azimuth -= 0.008 * dx; this.elevation = Math.min(Math.PI / 2, Math.max(0.05, this.elevation + 0.008 * dy)); this.picture = null; this.coarse = true;
      }
      this.changed();
    });
    c.addEventListener("pointerup", () => { from = null; if (this.coarse) { this.coarse = false; this.picture = null; this.changed(); } });
    c.addEventListener("contextmenu", e => e.preventDefault());
    c.addEventListener("wheel", e => { e.preventDefault(); this.zoom = Math.min(3, Math.max(0.01, this.zoom * Math.exp(-0.0012 * e.deltaY))); this.picture = null; this.changed(); }, { passive: false });
  }
  size() {
    const c = this.canvas, ratio = Math.min(2, window.devicePixelRatio || 1), w = Math.round(c.clientWidth * ratio), h = Math.round(c.clientHeight * ratio);
    if (c.width != w || c.height != h) { c.width = w; c.height = h; this.picture = null; }
    this.ratio = ratio; this.scale = this.zoom * Math.min(w, 1.8 * h) / this.head.extent; this.w = w; this.h = h;
    const [sa, ca, se, ce] = [Math.sin(this.azimuth), Math.cos(this.azimuth), Math.sin(this.elevation), Math.cos(this.elevation)];
    this.right = [-sa, ca, 0]; this.up = [-se * ca, -se * sa, ce]; this.near = [ce * ca, ce * sa, se];
  }
  x(p, i = 0) { return this.w / 2 + this.scale * ((p[i] - this.target[0]) * this.right[0] + (p[i + 1] - this.target[1]) * this.right[1]); }
  y(p, i = 0) { return 0.54 * this.h - this.scale * ((p[i] - this.target[0]) * this.up[0] + (p[i + 1] - this.target[1]) * this.up[1] + (p[i + 2] - this.target[2]) * this.up[2]); }
  depth(p, i = 0) { return p[i] * this.near[0] + p[i + 1] * this.near[1] + p[i + 2] * this.near[2]; }
  height(x, y) {
    const g = this.ground, c = Math.round((x - g.origin[0]) / g.cell), r = Math.round((y - g.origin[1]) / g.cell);
    if (c < 0 || r < 0 || c >= g.cols || r >= g.rows) return 0;
    const z = g.z[r * g.cols + c]; return z < -50 * this.m ? 0 : z;
  }
  // The ground is painted once a view; a moving robot only shifts it.
  paintGround() {
    const g = this.ground, step = this.coarse ? 3 : 1, s = this.scale, R = this.right, U = this.up, base = -0.05 * this.m;
    const at = (r, c, z) => { const x = g.origin[0] + c * g.cell, y = g.origin[1] + r * g.cell; return [s * (x * R[0] + y * R[1]), -s * (x * U[0] + y * U[1] + z * U[2])]; };
    let lo = Infinity, hi = -Infinity; for (const z of g.z) if (z > -50 * this.m) { lo = Math.min(lo, z); hi = Math.max(hi, z); }
    if (lo > hi) { lo = hi = 0; }
    const floor = Math.min(lo, 0) + base, box = [Infinity, Infinity, -Infinity, -Infinity];
    for (const [r, c] of [[0, 0], [0, g.cols - 1], [g.rows - 1, 0], [g.rows - 1, g.cols - 1]]) for (const z of [floor, hi]) {
      const [x, y] = at(r, c, z); box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y); box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y);
    }
    const most = 3600, k = Math.min(1, most / (box[2] - box[0] + 4), most / (box[3] - box[1] + 4)), image = document.createElement("canvas");
    image.width = Math.ceil(k * (box[2] - box[0])) + 4; image.height = Math.ceil(k * (box[3] - box[1])) + 4;
    const ctx = image.getContext("2d"); ctx.scale(k, k); ctx.translate(2 / k - box[0], 2 / k - box[1]);
    const light = [-0.42, -0.38, 0.82], span = Math.max(hi - lo, 0.04 * this.m), tile = 0.1 * this.m;
    const rows = [], cols = []; for (let r = 0; r + step < g.rows; r += step) rows.push(r); for (let c = 0; c + step < g.cols; c += step) cols.push(c);
    if (this.near[1] < 0) rows.reverse(); if (this.near[0] < 0) cols.reverse();
    const z = (r, c) => g.z[r * g.cols + c], run = step * g.cell;
    ctx.lineWidth = 0.8 / k; ctx.lineJoin = "round";
    for (const r of rows) for (const c of cols) {
      const q = [z(r, c), z(r, c + step), z(r + step, c + step), z(r + step, c)]; if (Math.min(...q) < -50 * this.m) continue;
      const nx = -(q[1] + q[2] - q[0] - q[3]) / (2 * run), ny = -(q[2] + q[3] - q[0] - q[1]) / (2 * run), n = Math.hypot(nx, ny, 1);
      const shade = Math.max(0, (nx * light[0] + ny * light[1] + light[2]) / n) / 0.82, t = ((q[0] + q[2]) / 2 - lo) / span;
      const check = (Math.floor((g.origin[0] + (c + step / 2) * g.cell) / tile) + Math.floor((g.origin[1] + (r + step / 2) * g.cell) / tile)) & 1 ? 1 : 0.965;
      const f = (0.42 + 0.58 * shade) * check, rgb = [196 + 34 * t, 200 + 22 * t, 192 + 2 * t].map(v => Math.round(Math.min(255, v * f)));
      ctx.fillStyle = ctx.strokeStyle = `rgb(${rgb})`; ctx.beginPath();
      [[r, c, q[0]], [r, c + step, q[1]], [r + step, c + step, q[2]], [r + step, c, q[3]]].forEach((p, i) => { const [X, Y] = at(...p); i ? ctx.lineTo(X, Y) : ctx.moveTo(X, Y); });
      ctx.fill(); ctx.stroke();
    }
    const lastR = rows.length ? Math.max(...rows) + step : 0, lastC = cols.length ? Math.max(...cols) + step : 0;
    const skirt = (path, colour) => {
      const known = path.filter(([r, c]) => z(r, c) > -50 * this.m); if (known.length < 2) return;
      ctx.fillStyle = colour; ctx.beginPath(); known.forEach(([r, c], i) => { const [X, Y] = at(r, c, z(r, c)); i ? ctx.lineTo(X, Y) : ctx.moveTo(X, Y); });
      for (const [r, c] of known.reverse()) ctx.lineTo(...at(r, c, floor)); ctx.fill();
    };
    if (this.elevation < 1.5) {
      const cs = [...cols, lastC].sort((a, b) => a - b), rs = [...rows, lastR].sort((a, b) => a - b);
      skirt(cs.map(c => [this.near[1] < 0 ? 0 : lastR, c]), "#8d938c"); skirt(rs.map(r => [r, this.near[0] < 0 ? 0 : lastC]), "#7b827c");
    }
    this.picture = { image, k, left: box[0] - 2 / k, top: box[1] - 2 / k };
  }
  // frame: as of `frame` in film.py; marks: all so far; trails: arrays of x, y, z.
  draw(frame, marks = []) {
    this.size(); const ctx = this.ctx;
    if (this.follow && frame) this.target = [frame.base[0], frame.base[1], 0.6 * frame.base[2]];
    if (!this.picture) this.paintGround();
    const sky = ctx.createLinearGradient(0, 0, 0, this.h); sky.addColorStop(0, "#dfe8f0"); sky.addColorStop(1, "#f7f9fb");
    ctx.fillStyle = sky; ctx.fillRect(0, 0, this.w, this.h);
    const p = this.picture, o = [0, 0, 0];
    ctx.drawImage(p.image, this.x(o) + p.left, this.y(o) + p.top, p.image.width / p.k, p.image.height / p.k);
    ctx.lineJoin = ctx.lineCap = "round";
    if (!this.hidden.has("trail")) { this.path(this.trail.base, "rgba(31,111,178,.75)", 2.2); this.path(this.trail.ghost, "rgba(122,79,181,.8)", 1.4, [5, 4]); }
    for (const mark of marks) this.item(mark, 1);
    if (!frame) return;
    for (const item of frame.items) if (this.flat(item)) this.item(item, 0);
    this.shadow(frame.points); this.robot(frame);
    for (const item of frame.items) if (!this.flat(item)) this.item(item, 0);
  }
  flat(item) { const kind = this.head.styles[item[0]].kind; return kind == "fill" || kind == "ring"; }
  path(points, colour, width, dash = []) {
    const ctx = this.ctx; if (points.length < 6) return;
    ctx.strokeStyle = colour; ctx.lineWidth = width * this.ratio; ctx.setLineDash(dash.map(d => d * this.ratio)); ctx.beginPath();
    for (let i = 0; i < points.length; i += 3) ctx.lineTo(this.x(points, i), this.y(points, i));
    ctx.stroke(); ctx.setLineDash([]);
  }
  item(item, first) { // first: place of the style's number; a mark has its time before it
    const style = this.head.styles[item[first]], ctx = this.ctx, r = Math.max(1.2 * this.ratio, style.size * this.head.extent * this.scale), p = item, begin = first + 1;
    if (this.hidden.has(style.layer)) return;
    ctx.strokeStyle = ctx.fillStyle = style.colour;
    if (style.kind == "line" || style.kind == "fill") {
      ctx.beginPath(); for (let i = begin; i < p.length; i += 3) ctx.lineTo(this.x(p, i), this.y(p, i));
      if (style.kind == "fill") { ctx.closePath(); ctx.globalAlpha = 0.3; ctx.fill(); ctx.globalAlpha = 1; }
      ctx.lineWidth = Math.min(r, 2.4 * this.ratio); ctx.stroke();
    } else if (style.kind == "dot") for (let i = begin; i < p.length; i += 3) this.sphere(this.x(p, i), this.y(p, i), r, style.colour);
    else if (style.kind == "ring") {
      ctx.lineWidth = Math.max(1.5 * this.ratio, 0.2 * r);
      for (let i = begin; i < p.length; i += 3) {
        ctx.beginPath(); ctx.ellipse(this.x(p, i), this.y(p, i), r, Math.max(0.25 * r, r * Math.abs(this.near[2])), 0, 0, 7); ctx.globalAlpha = 0.25; ctx.fill(); ctx.globalAlpha = 1; ctx.stroke();
      }
    } else if (style.kind == "label") {
      ctx.font = `600 ${Math.max(10 * this.ratio, r)}px system-ui,sans-serif`; ctx.textAlign = "left"; ctx.lineWidth = 3 * this.ratio; ctx.strokeStyle = "rgba(247,249,251,.85)";
      const at = [p[begin + 3], this.x(p, begin) + r, this.y(p, begin) + 1.6 * r]; ctx.strokeText(...at); ctx.fillText(...at);
    } else for (let i = begin; i + 5 < p.length; i += 6) this.arrow(this.x(p, i), this.y(p, i), this.x(p, i + 3), this.y(p, i + 3), r);
  }
  arrow(x0, y0, x1, y1, r) {
    const ctx = this.ctx, length = Math.hypot(x1 - x0, y1 - y0), head = Math.min(3.2 * r, 0.6 * length); if (length < 1) return;
    const ux = (x1 - x0) / length, uy = (y1 - y0) / length; ctx.lineWidth = r;
    ctx.beginPath(); ctx.moveTo(x0, y0); ctx.lineTo(x1 - ux * head, y1 - uy * head); ctx.stroke();
    ctx.beginPath(); ctx.moveTo(x1, y1); ctx.lineTo(x1 - ux * head - uy * head * 0.5, y1 - uy * head + ux * head * 0.5); ctx.lineTo(x1 - ux * head + uy * head * 0.5, y1 - uy * head - ux * head * 0.5); ctx.fill();
  }
  sphere(x, y, r, colour) {
    const ctx = this.ctx; ctx.fillStyle = shaded(colour, 0.72); ctx.beginPath(); ctx.arc(x, y, r, 0, 7); ctx.fill();
    ctx.fillStyle = colour; ctx.beginPath(); ctx.arc(x - 0.1 * r, y - 0.12 * r, 0.84 * r, 0, 7); ctx.fill();
    ctx.fillStyle = shaded(colour, 1.35); ctx.beginPath(); ctx.arc(x - 0.3 * r, y - 0.34 * r, 0.36 * r, 0, 7); ctx.fill();
  }
  shadow(points) {
    const ctx = this.ctx, on = i => { const x = points[3 * i], y = points[3 * i + 1]; return [x, y, this.height(x, y)]; };
    ctx.strokeStyle = ctx.fillStyle = "rgba(20,30,40,.17)"; ctx.beginPath(); let width = 0;
    for (const [a, b, r] of this.head.limbs) { const A = on(a), B = on(b); ctx.moveTo(this.x(A), this.y(A)); ctx.lineTo(this.x(B), this.y(B)); width += 2 * r / this.head.limbs.length; }
    ctx.lineWidth = width * this.scale; ctx.stroke();
    const top = this.head.faces[0]; if (top) { ctx.beginPath(); for (const i of top[0]) { const A = on(i); ctx.lineTo(this.x(A), this.y(A)); } ctx.fill(); }
    ctx.beginPath(); // one path of triangles that face up: none of them cancels or darkens another
    for (const mesh of this.head.meshes) {
      const q = this.placed(mesh, points); for (let i = 0; i < q.length; i += 3) q[i + 2] = this.height(q[i], q[i + 1]);
      this.triangles(mesh, q, (a, b, c) => {
        if ((q[b] - q[a]) * (q[c + 1] - q[a + 1]) - (q[b + 1] - q[a + 1]) * (q[c] - q[a]) > 0) for (const i of [a, b, c]) i == a ? ctx.moveTo(this.x(q, i), this.y(q, i)) : ctx.lineTo(this.x(q, i), this.y(q, i));
      });
    }
    ctx.fill();
  }
  // Vertices of a mesh in the world: its frame is four points, the link's origin and 1 m along its axes.
  placed([[o, x, y, z], vertices], p) {
    const q = new Float64Array(vertices.length), m = this.m;
    for (let k = 0; k < 3; k++) {
      const at = p[3 * o + k], X = (p[3 * x + k] - at) / m, Y = (p[3 * y + k] - at) / m, Z = (p[3 * z + k] - at) / m;
      for (let i = 0; i < q.length; i += 3) q[i + k] = at + X * vertices[i] + Y * vertices[i + 1] + Z * vertices[i + 2];
    }
    return q;
  }
  triangles([, , corners], q, each) { for (let i = 0; i < corners.length; i += 3) each(3 * corners[i], 3 * corners[i + 1], 3 * corners[i + 2]); }
  mesh(mesh, p, parts) {
    const q = this.placed(mesh, p), n = this.near;
    this.triangles(mesh, q, (a, b, c) => {
      const ex = q[b] - q[a], ey = q[b + 1] - q[a + 1], ez = q[b + 2] - q[a + 2], fx = q[c] - q[a], fy = q[c + 1] - q[a + 1], fz = q[c + 2] - q[a + 2];
      const nx = ey * fz - ez * fy, ny = ez * fx - ex * fz, nz = ex * fy - ey * fx;
      if (nx * n[0] + ny * n[1] + nz * n[2] <= 0) return;
      const lit = Math.max(0, (-0.35 * nx - 0.5 * ny + 0.79 * nz) / (Math.hypot(nx, ny, nz) || 1));
      parts.push([(this.depth(q, a) + this.depth(q, b) + this.depth(q, c)) / 3, 3, [q, a, b, c, shaded(mesh[3], 0.7 + 0.5 * lit)]]);
    });
  }
  robot(frame) {
    const p = frame.points, ctx = this.ctx, parts = [], s = this.scale;
    for (const limb of this.head.limbs) parts.push([0.5 * (this.depth(p, 3 * limb[0]) + this.depth(p, 3 * limb[1])), 0, limb]);
    for (const ball of this.head.balls) parts.push([this.depth(p, 3 * ball[0]) + 0.5 * ball[1], 1, ball]);
    for (const face of this.head.faces) { let d = 0; for (const i of face[0]) d += this.depth(p, 3 * i); parts.push([d / face[0].length, 2, face]); }
    for (const mesh of this.head.meshes) this.mesh(mesh, p, parts);
    parts.sort((a, b) => a[0] - b[0]);
    for (const [, kind, part] of parts) {
      if (kind == 0) {
        const [a, b, r, colour] = part, w = Math.max(2, 2 * r * s), ax = this.x(p, 3 * a), ay = this.y(p, 3 * a), bx = this.x(p, 3 * b), by = this.y(p, 3 * b);
        const n = Math.hypot(bx - ax, by - ay) || 1, side = (by - ay) > 0 ? 1 : -1, ox = side * (by - ay) / n * -0.2 * w * -1, oy = side * (bx - ax) / n * -0.2 * w;
        for (const [c, width, dx, dy] of [[shaded(colour, 0.55), w + 1.4 * this.ratio, 0, 0], [shaded(colour, 0.86), w, 0, 0], [colour, 0.62 * w, ox * 0.6, oy * 0.6], [shaded(colour, 1.18), 0.22 * w, ox, oy]]) {
          ctx.strokeStyle = c; ctx.lineWidth = width; ctx.beginPath(); ctx.moveTo(ax + dx, ay + dy); ctx.lineTo(bx + dx, by + dy); ctx.stroke();
        }
      } else if (kind == 1) this.sphere(this.x(p, 3 * part[0]), this.y(p, 3 * part[0]), Math.max(1.5, part[1] * s), part[2]);
      else if (kind == 2) this.face(p, part);
      else {
        const [q, a, b, c, colour] = part; ctx.fillStyle = ctx.strokeStyle = colour; ctx.lineWidth = 0.6 * this.ratio;
        ctx.beginPath(); ctx.moveTo(this.x(q, a), this.y(q, a)); ctx.lineTo(this.x(q, b), this.y(q, b)); ctx.lineTo(this.x(q, c), this.y(q, c)); ctx.closePath(); ctx.fill(); ctx.stroke();
      }
    }
  }
  face(p, [corners, colour]) {
    const ctx = this.ctx, v = k => { const i = 3 * corners[k]; return [p[i], p[i + 1], p[i + 2]]; }, [a, b, c] = [v(0), v(1), v(2)];
    const e = [b[0] - a[0], b[1] - a[1], b[2] - a[2]], f = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
    const n = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]], length = Math.hypot(...n) || 1;
    if (n[0] * this.near[0] + n[1] * this.near[1] + n[2] * this.near[2] < 0) return;
    const lit = Math.max(0, (-0.35 * n[0] - 0.5 * n[1] + 0.79 * n[2]) / length);
    ctx.fillStyle = shaded(colour, 0.7 + 0.5 * lit); ctx.strokeStyle = shaded(colour, 0.55); ctx.lineWidth = this.ratio; ctx.beginPath();
    for (const i of corners) ctx.lineTo(this.x(p, 3 * i), this.y(p, 3 * i)); ctx.closePath(); ctx.fill(); ctx.stroke();
  }
}
const shades = new Map();
function shaded(colour, f) {
  const key = colour + f.toFixed(2); let found = shades.get(key);
  if (!found) {
    const rgb = [1, 3, 5].map(i => parseInt(colour.slice(i, i + 2), 16)).map(c => Math.round(f <= 1 ? c * f : c + (255 - c) * Math.min(1, f - 1) * 1.6));
    shades.set(key, found = `rgb(${rgb.map(c => Math.min(255, c))})`);
  }
  return found;
}
function between(a, b, f) { // a frame between two, of the robot's points and base
  const mix = (p, q) => p.map((x, i) => x + f * (q[i] - x));
  return f > 0 && b && a.points.length == b.points.length ? { ...a, points: mix(a.points, b.points), base: mix(a.base, b.base) } : a;
}
