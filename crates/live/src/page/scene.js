"use strict";

const TRAIL_S = 2; // Points stay for this long.
const PATH_S = 300; // Paths of people stay for this long.
const PATH_STEP_S = 0.5; // Places of a path are this far apart.
const ABOVE = { yaw: 0, pitch: 1.5 }, SIDE = { yaw: 0.5, pitch: 0.42 };
const POINT_NUMBERS = 5;
const FULL_VELOCITY_MPS = 2; // The colour does not change any more above this speed.

// Little-endian i16 in base64: x, y, z in mm, velocity in cm/s, intensity in 0.1 dB. Bytes after the last whole point are left out.
function decodePoints(text) {
  const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const view = new DataView(bytes.buffer), points = [];
  for (let at = 0; at + 2 * POINT_NUMBERS <= bytes.length; at += 2 * POINT_NUMBERS) {
    const number = i => view.getInt16(at + 2 * i, true);
    points.push([number(0) / 1000, number(1) / 1000, number(2) / 1000, number(3) / 100, number(4) / 10]);
  }
  return points;
}

// Draws a room on a canvas. It is drawn when something changes, and at most once for each frame of the screen.
function makeScene(canvas, button) {
  const camera = { ...ABOVE, distance: 7.5 };
  let about = { radar_height_m: 1, zones: [], synthetic: false }, frames = [], paths = new Map(), colours = {}, isAsked = false;

  function readColours() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["ink", "dim", "grid", "still", "near", "far", "radar", "mark", "mark-ground"]) colours[name] = style.getPropertyValue(`--${name}`).trim();
  }

  // The camera looks at the middle of the room; x is right of the radar, y away from it, z up.
  function projector(w, h) {
    const f = 1.15 * Math.min(w, h), target = [0, 2.8, 0.6 - about.radar_height_m];
    const cy = Math.cos(camera.yaw), sy = Math.sin(camera.yaw), cp = Math.cos(camera.pitch), sp = Math.sin(camera.pitch);
    return (x, y, z) => {
      const dx = x - target[0], dy = y - target[1], dz = z - target[2];
      const rx = cy * dx + sy * dy, ry = -sy * dx + cy * dy;
      const depth = camera.distance + cp * ry - sp * dz, up = cp * dz + sp * ry;
      return [w / 2 + f * rx / depth, h / 2 - f * up / depth, depth];
    };
  }

  function line(g, corners) {
    if (corners.some(p => p[2] < 0.2)) return;
    g.beginPath();
    corners.forEach((p, i) => i ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1]));
    g.stroke();
  }

  function drawRoom(g, project, floor) {
    g.strokeStyle = colours.grid; g.lineWidth = 1;
    for (let i = -3; i <= 3; i++) line(g, [project(i, 0, floor), project(i, 6, floor)]);
    for (let i = 0; i <= 6; i++) line(g, [project(-3, i, floor), project(3, i, floor)]);
    g.font = `${Math.round(12 * (window.devicePixelRatio || 1))}px system-ui, sans-serif`;
    g.fillStyle = colours.dim;
    for (let i = 2; i <= 6; i += 2) {
      const [x, y, depth] = project(3, i, floor);
      if (depth > 0.2) g.fillText(`${i} m`, x + 6, y + 4);
    }
    for (const zone of about.zones) {
      const corners = zone.polygon_m.map(([x, y]) => project(x, y, floor));
      if (corners.length < 3) continue;
      g.strokeStyle = g.fillStyle = colours.dim; g.lineWidth = 2;
      line(g, [...corners, corners[0]]);
      const kind = zone.below_m ? `${zone.kind} below ${zone.below_m} m` : zone.kind;
      g.fillText(`${zone.name} (${kind})`, corners[0][0] + 4, corners[0][1] - 4);
    }
    const radar = project(0, 0, 0);
    if (radar[2] > 0.2) { g.fillStyle = colours.radar; g.fillRect(radar[0] - 5, radar[1] - 5, 10, 10); }
  }

  function pointColour(v) {
    return Math.abs(v) < 0.1 ? colours.still : v < 0 ? colours.near : colours.far;
  }

  function drawPoints(g, project, w, newest_s) {
    for (const frame of frames) {
      const age = (newest_s - frame.t_s) / TRAIL_S;
      if (age > 1) continue;
      for (const [x, y, z, v, db] of frame.points) {
        const p = project(x, y, z);
        if (p[2] < 0.2) continue;
        const speed = Math.min(1, Math.abs(v) / FULL_VELOCITY_MPS);
        g.globalAlpha = (age < 0.02 ? 1 : 0.4 * (1 - age)) * (0.6 + 0.4 * speed);
        g.fillStyle = pointColour(v);
        const radius = Math.max(1.5, Math.min(3, 1.5 + 0.04 * db) * w / (110 * p[2]));
        g.beginPath(); g.arc(p[0], p[1], radius, 0, 2 * Math.PI); g.fill();
      }
    }
    g.globalAlpha = 1;
  }

  // Where people were, also those who have left: the older, the fainter.
  function drawPaths(g, project, floor, newest) {
    g.strokeStyle = colours.ink; g.lineWidth = 2;
    for (const path of paths.values()) {
      for (let i = 1; i < path.length; i++) {
        g.globalAlpha = 0.05 + 0.5 * Math.max(0, 1 - (newest.t_s - path[i].t_s) / PATH_S);
        line(g, [path[i - 1], path[i]].map(p => project(p.x_m, p.y_m, floor)));
      }
    }
    g.globalAlpha = 1;
  }

  function addToPaths({ t_s, people }) {
    for (const { id, x_m, y_m } of people) {
      if (!paths.has(id)) paths.set(id, []);
      const path = paths.get(id), last = path[path.length - 1];
      if (!last || t_s - last.t_s >= PATH_STEP_S) path.push({ t_s, x_m, y_m });
    }
    for (const [id, path] of paths) {
      while (path.length && t_s - path[0].t_s > PATH_S) path.shift();
      if (!path.length) paths.delete(id);
    }
  }

  function drawPeople(g, project, floor, newest) {
    g.strokeStyle = g.fillStyle = colours.ink; g.lineWidth = 2;
    for (const person of newest.people) {
      const ring = [];
      for (let i = 0; i <= 24; i++) ring.push(project(person.x_m + 0.3 * Math.cos(i * Math.PI / 12), person.y_m + 0.3 * Math.sin(i * Math.PI / 12), floor));
      line(g, ring);
      const label = project(person.x_m, person.y_m, floor + (person.height_m || 1.7) + 0.15);
      if (label[2] > 0.2) g.fillText(`person ${person.id}`, label[0] + 6, label[1]);
    }
  }

  function draw() {
    isAsked = false;
    const scale = window.devicePixelRatio || 1;
    const w = Math.round(canvas.clientWidth * scale), h = Math.round(canvas.clientHeight * scale);
    if (!w || !h) return;
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    const g = canvas.getContext("2d"), project = projector(w, h), floor = -about.radar_height_m;
    g.clearRect(0, 0, w, h);
    drawRoom(g, project, floor);
    const newest = frames[frames.length - 1];
    if (newest) { drawPaths(g, project, floor, newest); drawPoints(g, project, w, newest.t_s); drawPeople(g, project, floor, newest); }
    if (about.synthetic) {
      const text = "SIMULATED";
      g.font = `bold ${Math.round(15 * scale)}px system-ui, sans-serif`;
      g.fillStyle = colours["mark-ground"]; g.fillRect(10 * scale, 10 * scale, g.measureText(text).width + 16 * scale, 24 * scale);
      g.fillStyle = colours.mark; g.fillText(text, 18 * scale, 27 * scale);
    }
  }

  function ask() { if (!isAsked) { isAsked = true; requestAnimationFrame(draw); } }
  const isAbove = () => camera.pitch === ABOVE.pitch && camera.yaw === ABOVE.yaw;
  function tellView() { button.textContent = isAbove() ? "Show from the side" : "Show from above"; ask(); }
  function turn(yaw, pitch) { camera.yaw += yaw; camera.pitch = Math.max(-0.2, Math.min(1.5, camera.pitch + pitch)); tellView(); }
  function zoom(factor) { camera.distance = Math.max(2, Math.min(20, camera.distance * factor)); ask(); }

  button.addEventListener("click", () => { Object.assign(camera, isAbove() ? SIDE : ABOVE); tellView(); });
  canvas.addEventListener("pointermove", e => { if (e.buttons) turn(-e.movementX * 0.008, e.pointerType === "touch" ? 0 : e.movementY * 0.008); });
  canvas.addEventListener("wheel", e => { e.preventDefault(); zoom(Math.exp(e.deltaY * 0.001)); }, { passive: false });
  canvas.addEventListener("keydown", e => {
    const act = { ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, 0.1), ArrowDown: () => turn(0, -0.1), "+": () => zoom(0.9), "=": () => zoom(0.9), "-": () => zoom(1.1) }[e.key];
    if (act) { e.preventDefault(); act(); }
  });
  new ResizeObserver(ask).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { readColours(); ask(); });
  readColours();
  return {
    describe(next) { about = next; ask(); },
    clear() { frames = []; paths.clear(); ask(); },
    add(frame) {
      // A stream that begins anew has smaller times.
      if (frames.length && frame.t_s < frames[frames.length - 1].t_s) { frames = []; paths.clear(); }
      frames.push(frame);
      while (frames.length > 600 || frame.t_s - frames[0].t_s > TRAIL_S) frames.shift();
      addToPaths(frame);
      ask();
    },
  };
}
