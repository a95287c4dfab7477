"use strict";

// Little-endian int16 millimetres, base64: [frame][vertex][xyz].
function decodeInt16(text) {
  const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  return new Int16Array(bytes.buffer);
}

// Plays one clip on the elements `at`: canvases points and (where there is a mesh) mesh, a button play, a
// slider time, a line clock; onFrame is called with every frame that is drawn. Only what is on the screen is drawn.
function player(clip, at) {
  const mesh = clip.mesh && { faces: clip.mesh.triangles, n: clip.mesh.n_vertices, mm: decodeInt16(clip.mesh.vertices_mm) };
  const floorZ = -clip.radar_height_m;
  const target = clip.centre_m;
  const camera = { yaw: 0.6, pitch: 0.28, distance: 4.6 };
  let frame = 0, playing = true, shown = true, last = 0;

  // Camera looks at `target`; x right, y away from the radar, z up.
  function projector(canvas) {
    const w = canvas.width, h = canvas.height, f = 1.15 * Math.min(w, h);
    const cy = Math.cos(camera.yaw), sy = Math.sin(camera.yaw), cp = Math.cos(camera.pitch), sp = Math.sin(camera.pitch);
    return (x, y, z) => {
      const dx = x - target[0], dy = y - target[1], dz = z - target[2];
      const rx = cy * dx + sy * dy, ry = -sy * dx + cy * dy;
      const depth = camera.distance + cp * ry - sp * dz, up = cp * dz + sp * ry;
      return [w / 2 + f * rx / depth, h / 2 - f * up / depth, depth];
    };
  }

  function drawFloor(g, project) {
    g.strokeStyle = "#323a45"; g.lineWidth = 1;
    const line = (a, b) => {
      const p = project(...a), q = project(...b);
      if (p[2] < 0.2 || q[2] < 0.2) return;
      g.beginPath(); g.moveTo(p[0], p[1]); g.lineTo(q[0], q[1]); g.stroke();
    };
    const x0 = Math.round(target[0]), y0 = Math.round(target[1]);
    for (let i = -3; i <= 3; i++) {
      line([x0 + i, y0 - 3, floorZ], [x0 + i, y0 + 3, floorZ]);
      line([x0 - 3, y0 + i, floorZ], [x0 + 3, y0 + i, floorZ]);
    }
    const radar = project(0, 0, 0);
    if (radar[2] > 0.2) { g.fillStyle = "#facc15"; g.fillRect(radar[0] - 5, radar[1] - 5, 10, 10); }
  }

  function velocityColour(v) {
    const t = Math.max(-1, Math.min(1, v / clip.velocity_scale_mps)), a = Math.abs(t);
    const end = t < 0 ? [59, 130, 246] : [239, 68, 68];
    return `rgb(${end.map(c => Math.round(215 + (c - 215) * a)).join(",")})`;
  }

  function prepare(canvas) {
    const scale = window.devicePixelRatio || 1;
    const w = Math.round(canvas.clientWidth * scale), h = Math.round(canvas.clientHeight * scale);
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    const g = canvas.getContext("2d");
    g.clearRect(0, 0, w, h);
    return g;
  }

  function drawPoints() {
    const canvas = at.points, g = prepare(canvas), project = projector(canvas);
    drawFloor(g, project);
    // Two earlier frames stay as a fading trail: a single radar frame is very sparse.
    for (let age = 2; age >= 0; age--) {
      const points = clip.frames[frame - age];
      if (!points) continue;
      g.globalAlpha = [1, 0.35, 0.15][age];
      for (const [x, y, z, v, db] of points) {
        const p = project(x, y, z);
        if (p[2] < 0.2) continue;
        const radius = Math.max(1.5, (2.2 + 0.09 * (db - clip.intensity_db[0])) * canvas.width / (150 * p[2]));
        g.fillStyle = velocityColour(v);
        g.beginPath(); g.arc(p[0], p[1], radius, 0, 2 * Math.PI); g.fill();
      }
    }
    g.globalAlpha = 1;
  }

  function drawMesh() {
    if (!mesh) return;
    const canvas = at.mesh, g = prepare(canvas), project = projector(canvas);
    drawFloor(g, project);
    const first = Math.min(frame, mesh.mm.length / (3 * mesh.n) - 1) * mesh.n * 3;
    const xyz = i => [0, 1, 2].map(k => mesh.mm[first + 3 * i + k] / 1000);
    const vertices = Array.from({ length: mesh.n }, (_, i) => xyz(i));
    const screen = vertices.map(v => project(...v));
    const triangles = mesh.faces
      .map(f => ({ f, depth: screen[f[0]][2] + screen[f[1]][2] + screen[f[2]][2] }))
      .sort((a, b) => b.depth - a.depth);
    for (const { f } of triangles) {
      const [a, b, c] = f.map(i => vertices[i]), [p, q, r] = f.map(i => screen[i]);
      if ((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]) > 0 || p[2] < 0.2) continue;
      const u = b.map((value, k) => value - a[k]), v = c.map((value, k) => value - a[k]);
      const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      const length = Math.hypot(...n) || 1;
      const light = 0.35 + 0.65 * Math.max(0, (0.35 * n[0] - 0.6 * n[1] + 0.7 * n[2]) / length);
      g.fillStyle = g.strokeStyle = `rgb(${[203, 178, 160].map(k => Math.round(k * light)).join(",")})`;
      g.beginPath(); g.moveTo(p[0], p[1]); g.lineTo(q[0], q[1]); g.lineTo(r[0], r[1]); g.closePath(); g.fill(); g.stroke();
    }
  }

  function draw() {
    drawPoints(); drawMesh();
    at.time.value = frame;
    if (at.onFrame) at.onFrame(frame);
    at.clock.textContent = `${(frame / clip.frame_rate_hz).toFixed(1)} s \u00b7 ${(clip.frames[frame] || []).length} points`;
  }
  function setPlaying(value) { playing = value; at.play.textContent = playing ? "Pause" : "Play"; }
  function pauseAt(wanted) { frame = Math.max(0, Math.min(wanted, clip.frames.length - 1)); setPlaying(false); draw(); }
  at.time.max = Math.max(0, clip.frames.length - 1);
  at.time.oninput = e => pauseAt(+e.target.value);
  at.play.onclick = () => setPlaying(!playing);
  for (const canvas of [at.points, mesh && at.mesh]) {
    if (!canvas) continue;
    canvas.onpointermove = e => {
      if (!e.buttons) return;
      camera.yaw -= e.movementX * 0.008;
      camera.pitch = Math.max(-0.2, Math.min(1.5, camera.pitch + e.movementY * 0.008));
      draw();
    };
    canvas.onwheel = e => { e.preventDefault(); camera.distance = Math.max(1.5, Math.min(15, camera.distance * Math.exp(e.deltaY * 0.001))); draw(); };
  }
  window.addEventListener("resize", draw);
  new IntersectionObserver(entries => { shown = entries[entries.length - 1].isIntersecting; if (shown) draw(); }).observe(at.points);
  function tick(now) {
    if (playing && shown && now - last > 1000 / clip.frame_rate_hz && clip.frames.length) { last = now; frame = (frame + 1) % clip.frames.length; draw(); }
    requestAnimationFrame(tick);
  }
  draw();
  requestAnimationFrame(tick);
  return { pauseAt };
}
