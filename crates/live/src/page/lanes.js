const POSTURES = { stand_still: "stands", sit_still: "sits", lie_still: "lies" };
const WALKING = ["walk", "circle", "pace", "run"];
const LANES_MS = 30000; // The lanes of a range that goes on are drawn anew after this time.
const HOUR_MS = 3600000;
const TICKS = 4; // Most times below the lanes: a time of twelve hours takes a fifth of a phone's lane.

// A range of time as lanes: presence, posture, activity, falls. `choose` is told the time of what is clicked.
function makeLanes(box, choose) {
  let asked = 0, timer = 0;

  // A bar from one time to another, as shares of the range.
  function bar(className, text, start, end, range) {
    const made = element("i", className);
    const width = range.to - range.from;
    made.style.left = `${100 * (start - range.from) / width}%`;
    made.style.width = `${100 * (end - start) / width}%`;
    made.title = text;
    made.addEventListener("click", () => choose(start));
    return made;
  }
  const clock = ms => new Date(ms).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" });
  const span = (start, end) => `${clock(start)} to ${clock(end)}`;
  const lane = (name, bars) => element("div", "lane", element("span", "dim", name), element("div", "bars", ...bars));

  function ticks(range) {
    const steps = [1, 2, 5, 10, 15, 30, 60, 120, 180, 360, 720, 1440, 2880, 7200, 14400].map(min => min * 60000);
    const step = steps.find(ms => (range.to - range.from) / ms <= TICKS) || 31 * 24 * HOUR_MS;
    const zone_ms = new Date(range.from).getTimezoneOffset() * 60000, made = [];
    for (let at = Math.ceil((range.from - zone_ms) / step) * step + zone_ms; at < range.to; at += step) {
      const text = step < 24 * HOUR_MS ? clock(at) : new Date(at).toLocaleDateString([], { month: "2-digit", day: "2-digit" });
      const tick = element("span", "tick number", text);
      const share = (at - range.from) / (range.to - range.from);
      tick.style.left = `${100 * share}%`;
      // Not over the edge of the screen.
      if (share < 0.77) made.push(tick);
    }
    return element("div", "lane", element("span"), element("div", "ticks", ...made));
  }

  function show(data, range) {
    const { presence, actions, falls, silence } = data;
    const starts = [...presence, ...actions, ...silence].map(s => s.start_ms).concat(falls.map(f => f.at_ms));
    if (!starts.length) { box.hidden = true; return; }
    // Empty hours before the first of all are left out.
    range = { ...range, from: Math.max(range.from, Math.floor(Math.min(...starts) / HOUR_MS) * HOUR_MS) };
    const of = (stretches, className, text) => stretches.map(s => bar(className, `${text}, ${span(s.start_ms, s.end_ms)}`, s.start_ms, s.end_ms, range));
    const named = (isWanted, className, name) => actions.filter(a => isWanted(a.action)).map(a => bar(className(a.action), `${name(a.action)}, ${span(a.start_ms, a.end_ms)}`, a.start_ms, a.end_ms, range));
    const isPosture = action => Object.hasOwn(POSTURES, action);
    const isOther = action => !isPosture(action) && action !== "fall" && action !== "nothing";
    const alarms = falls.map(f => bar(f.is_confirmed ? "fall confirmed" : "fall", `${f.is_confirmed ? "fall confirmed" : "fall suspected"}, ${clock(f.at_ms)}`, f.at_ms, f.at_ms, range));
    const told = actions.filter(a => a.action === "fall").map(a => bar("fall", `a sentence tells a fall, ${span(a.start_ms, a.end_ms)}`, a.start_ms, a.end_ms, range));
    const key = Object.entries(POSTURES).map(([action, word]) => element("span", `key ${action}`, word));
    box.replaceChildren(
      lane("Presence", [...of(presence, "present", "somebody there"), ...of(silence, "silent", "the radar is silent")]),
      lane("Posture", named(isPosture, action => action, action => POSTURES[action])),
      lane("Activity", named(isOther, action => WALKING.includes(action) ? "walk" : "other", words)),
      lane("Falls", [...told, ...alarms]),
      ticks(range),
      element("p", "small dim", ...key, element("span", "key walk", "walks or runs"), element("span", "key other", "another activity"), element("span", "key fall", "fall")));
    const present_min = Math.round(presence.reduce((sum, s) => sum + s.end_ms - Math.max(s.start_ms, range.from), 0) / 60000);
    const n_falls = falls.filter(f => f.is_confirmed).length;
    box.ariaLabel = `From ${clock(range.from)} to ${clock(range.to)}: somebody there for ${present_min} min, ${n_falls} ${n_falls === 1 ? "fall" : "falls"} confirmed.`;
    box.hidden = false;
  }

  async function load(from, to) {
    const mine = ++asked;
    clearTimeout(timer);
    const range = { from: from === "" ? Date.now() - 24 * HOUR_MS : from, to: to === "" ? Date.now() : to };
    try {
      const data = await askServer("/api/lanes", range);
      if (mine === asked) show(data, range);
    } catch { if (mine === asked) box.hidden = true; }
    if (mine === asked && to === "") timer = setTimeout(() => load(from, to), LANES_MS);
  }
  return { load };
}
