const QUIET_MS = 3000; // After so long without a frame the picture is old.
const COME_BACK_MS = 5000; // A refused connection is tried again after this time.
const NOW_MS = 15000; // A sentence that is not renewed is not the newest one for ever.

// The token came with the address; the cookie has it now.
if (location.search) history.replaceState(null, "", location.pathname);

const scene = makeScene(byId("scene"), byId("view"));
const timeline = makeTimeline();
const falls = new Map(), sentences = new Map();
let hello = null, lastFrameAt = 0, isLinked = false, presence = null, health = null, shownFall = null;

function meet(message) {
  hello = message;
  const { name, source, radar, model, decoder, version, synthetic } = message;
  byId("name").textContent = name;
  for (const mark of document.querySelectorAll("[data-simulated]")) mark.hidden = !synthetic;
  byId("provenance").textContent = `${synthetic ? "Simulated" : "Recorded"} points of ${radar} (source ${source}); sentences by model ${model} (${decoder}), version ${version}.`;
  scene.describe(message); scene.clear();
  falls.clear(); sentences.clear();
  for (const fall of message.falls) hearFall(fall, Date.parse(message.utc));
  for (const now of message.now) hearNow(now);
  presence = message.presence; health = message.health;
  showNow(); showPresence(); showHealth(); showAlarm();
  timeline.restart(message.rows, synthetic);
}

function hearFrame({ t_s, points, people, left_out }) {
  lastFrameAt = performance.now();
  const decoded = decodePoints(points);
  scene.add({ t_s, points: decoded, people });
  byId("points").textContent = `${decoded.length} points in this frame${left_out ? `, ${left_out} left out` : ""}.`;
  const items = people.map(p => {
    const height = p.height_m == null ? "" : `, ${p.height_m.toFixed(1)} m high`;
    const side = `${Math.abs(p.x_m).toFixed(1)} m to the ${p.x_m < 0 ? "left" : "right"}`;
    return element("li", "number", `Person ${p.id}: ${p.y_m.toFixed(1)} m away, ${side}, ${Math.hypot(p.vx_mps, p.vy_mps).toFixed(1)} m/s${height}`);
  });
  byId("people").replaceChildren(...(items.length ? items : [element("li", "dim", "Nobody is seen.")]));
}

function hearNow(now) {
  for (const person of [...sentences.keys()]) if ((person == null) !== (now.person == null)) sentences.delete(person);
  sentences.set(now.person, { now, heardAt: performance.now() });
}

const NOTHING = { nobody: "Nobody is there.", unseen: "Somebody is there, but too little is seen for a sentence.", unsure: "Somebody is there; no sentence yet." };
let shownNow = "";
function showNow() {
  for (const [person, { heardAt }] of sentences) if (performance.now() - heardAt > NOW_MS) sentences.delete(person);
  const told = [...sentences.values()].map(s => s.now).sort((a, b) => a.person - b.person);
  const text = JSON.stringify(told.map(n => [n.person, n.caption, n.label, n.confidence, n.reason, n.synthetic]));
  // A screen reader hears of changes alone.
  if (text === shownNow) return;
  shownNow = text;
  const blocks = told.map(now => {
    const isSilent = now.person == null && now.label !== "nobody";
    const said = element("p", "said", now.caption || (isSilent ? "The radar is silent." : NOTHING[now.label]) || words(now.label));
    const notes = [who(now.person), now.caption ? words(now.label) : now.reason, percent(now.confidence), now.window_s ? `last ${now.window_s.toFixed(1)} s` : "", "provisional"];
    const note = element("p", "small dim", notes.filter(Boolean).join(" \u00b7 "));
    return element("div", "", said, note);
  });
  byId("now").replaceChildren(...(blocks.length ? blocks : [element("p", "dim", "No sentence at present.")]));
}

// A fall and when the person went down, in the time of the server and in that of this page.
function hearFall(fall, serverNow_ms) {
  if (fall.state === "dismissed" || fall.state === "recovered") { falls.delete(fall.id); return; }
  const told_ms = Date.parse(fall.utc), down_ms = told_ms - 1000 * fall.dwell_s;
  falls.set(fall.id, { ...fall, down_ms, downAt: performance.now() - (serverNow_ms - down_ms) });
}
const dwellText = seconds => `${Math.floor(seconds / 60)} min ${String(Math.floor(seconds % 60)).padStart(2, "0")} s`;

function showAlarm() {
  const open = [...falls.values()], fall = open.find(f => f.state === "confirmed") || open[0] || null, alarm = byId("alarm");
  document.title = `${fall ? "Fall! " : ""}${hello && hello.synthetic ? "SIMULATED " : ""}${hello ? hello.name : "RadarLLM"}`;
  if (!fall || !shownFall || fall.id !== shownFall.id) byId("alarm-problem").textContent = "";
  shownFall = fall;
  // The button must not lose the focus to nothing.
  if (!fall && alarm.contains(document.activeElement)) byId("timeline").focus({ preventScroll: true });
  alarm.hidden = !fall;
  if (!fall) return;
  alarm.className = fall.state;
  const name = fall.person == null ? "Somebody" : `Person ${fall.person}`, isConfirmed = fall.state === "confirmed";
  const text = isConfirmed ? `${name} fell and has not got up.` : `${name} may have fallen.`;
  if (byId("alarm-text").textContent !== text) byId("alarm-text").textContent = text;
  byId("acknowledge").textContent = isConfirmed ? "Acknowledge" : "Not a fall";
  byId("dwell").textContent = `Down for ${dwellText(Math.max(0, (performance.now() - fall.downAt) / 1000))}.`;
}
// The fall ends for all who look: the server tells them, and this page as well.
byId("acknowledge").addEventListener("click", async () => {
  if (!shownFall) return;
  const { id } = shownFall;
  try { await askServer(`/api/falls/${id}/acknowledge`, {}, "POST"); } catch (error) {
    if (error.status === 404) { falls.delete(id); showAlarm(); } else byId("alarm-problem").textContent = `Not acknowledged: ${error.message}.`;
  }
});

function showPresence() {
  const isKnown = isLinked && presence && !(health && health.source === "lost");
  const state = isKnown ? presence.state : "unknown";
  const text = { absent: "nobody there", present: "somebody there", held: "somebody there, not seen at present", unknown: "presence unknown" }[state] || state;
  byId("presence").textContent = isKnown && presence.people > 1 ? `${text} (${presence.people})` : text;
  byId("why").textContent = isKnown && presence.why ? `Why: ${presence.why}.` : "";
}

function showHealth() {
  if (!health) return;
  const facts = [
    ["Radar", health.source === "ok" ? "heard" : "silent"],
    ["Frames", `${health.frames_used} used, ${health.frames_lost} lost, ${health.frames_dropped} dropped`],
    ...(health.degraded ? [["Less often", health.degraded]] : []),
    ...health.problems.map(problem => ["Problem", problem]),
  ];
  byId("health").replaceChildren(...facts.flatMap(([term, text]) => [element("dt", "", term), element("dd", "", text)]));
}

function showLink() {
  const isQuiet = isLinked && performance.now() - lastFrameAt > QUIET_MS;
  const text = !isLinked ? "not connected" : isQuiet ? "no frames" : "live";
  const link = byId("link");
  if (link.textContent !== text) link.textContent = text;
  link.classList.toggle("bad", text !== "live");
}

const hear = {
  hello: meet,
  frame: hearFrame,
  now: message => { hearNow(message); showNow(); },
  activity: message => timeline.add(message),
  presence: message => { presence = message; showPresence(); timeline.refreshSoon(); },
  fall: message => { hearFall(message, Date.parse(message.utc)); showAlarm(); timeline.refreshSoon(); },
  health: message => { health = message; showHealth(); showPresence(); },
  lag: message => { byId("points").textContent = `This page was too slow for ${message.dropped} frames.`; },
};

function connect() {
  const events = new EventSource("/api/live");
  events.onopen = () => { isLinked = true; showLink(); showPresence(); };
  events.onerror = () => {
    isLinked = false; showLink(); showPresence();
    // A refusal is final for the browser, but not for us: a place may become free.
    if (events.readyState === EventSource.CLOSED) setTimeout(connect, COME_BACK_MS);
  };
  events.onmessage = event => {
    const message = JSON.parse(event.data);
    if (message.v === 1 && Object.hasOwn(hear, message.type)) hear[message.type](message);
  };
}
connect();
setInterval(() => { showLink(); showAlarm(); showNow(); }, 500);
