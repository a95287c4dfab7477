const MAX_ROWS = 500; // Rows on the page.
const PAGE_ROWS = 100; // Rows of one request.
const REFRESH_MS = 4000;

const EVENTS = {
  present: "somebody is there", absent: "nobody is there any more",
  suspected: "fall suspected", confirmed: "fall confirmed", dismissed: "fall dismissed", recovered: "recovered from the fall",
  source_lost: "the radar is silent", source_back: "the radar is heard again", clock_step: "the clock was set",
};
const eventText = row => row.data && row.data.acknowledged ? "fall acknowledged" : EVENTS[row.kind] || words(row.kind);

const byId = id => document.getElementById(id);

// An element with a class and children; texts are inserted as texts, never as HTML.
function element(name, className, ...children) {
  const made = document.createElement(name);
  if (className) made.className = className;
  made.append(...children);
  return made;
}
const simulated = () => element("strong", "simulated", "SIMULATED");
const percent = confidence => confidence == null ? "" : `confidence ${Math.round(100 * confidence)} %`;
const who = person => person == null ? "" : person === 0 ? "not tracked" : `person ${person}`;
const words = name => name.replaceAll("_", " ");

async function askServer(path, parameters, method = "GET") {
  const query = new URLSearchParams(Object.entries(parameters).filter(([, value]) => value !== "" && value != null));
  const reply = await fetch(`${path}?${query}`, { method });
  const body = await reply.json().catch(() => ({}));
  if (!reply.ok) throw Object.assign(new Error(body.error || `the server answered ${reply.status}`), { status: reply.status });
  return body;
}

// The timeline: rows by their key, the newest first.
function makeTimeline() {
  const list = byId("rows"), rows = new Map();
  const lanes = makeLanes(byId("lanes"), showTime);
  let isLive = true, isFirst = true, isSimulated = false, next = null, asked = 0, refresh = 0;

  const keyOf = row => row.kind ? `event ${row.id}` : `activity ${row.id}`;
  const timeOf = row => row.kind ? row.at_ms : row.start_ms;

  function clockText(ms) {
    const at = new Date(ms), isToday = at.toDateString() === new Date().toDateString();
    const time = at.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", second: "2-digit" });
    return isToday ? time : `${at.toLocaleDateString([], { year: "numeric", month: "2-digit", day: "2-digit" })} ${time}`;
  }

  function item(row) {
    const time = element("time", "", clockText(timeOf(row)));
    time.dateTime = new Date(timeOf(row)).toISOString();
    const what = element("span", !row.kind ? "what" : ["suspected", "confirmed"].includes(row.kind) ? "what event fall" : "what event", row.kind ? eventText(row) : row.caption || words(row.action));
    // What is simulated on a page of a radar that is not; otherwise the card says so.
    if (row.origin.synthetic && !isSimulated) what.append(" ", simulated());
    const seconds = row.kind ? "" : `${Math.max(1, Math.round((row.end_ms - row.start_ms) / 1000))} s`;
    const sure = row.confidence == null ? "" : `${Math.round(100 * row.confidence)} %`;
    const notes = [who(row.person), seconds, sure].filter(Boolean).join(" \u00b7 ");
    const made = element("li", "", time, element("span", "dim", notes), what);
    made.title = [row.kind ? "" : words(row.action), percent(row.confidence), row.origin.source, row.origin.radar, `model ${row.origin.model}`].filter(Boolean).join(" \u00b7 ");
    return made;
  }

  function put(row) {
    const old = rows.get(keyOf(row)), entry = { row, li: item(row) };
    rows.set(keyOf(row), entry);
    if (old) { old.li.replaceWith(entry.li); return; }
    let after = null;
    for (const li of list.children) if (+li.dataset.ms <= timeOf(row)) { after = li; break; }
    entry.li.dataset.ms = timeOf(row);
    list.insertBefore(entry.li, after);
    if (row.action && byId("actions").children.length < 100 && ![...byId("actions").children].some(o => o.value === row.action)) {
      const option = element("option"); option.value = row.action; byId("actions").append(option);
    }
  }

  // Too many rows leave at the end that the reader is not looking at.
  function bound(dropNewest) {
    while (rows.size > MAX_ROWS) {
      const li = dropNewest ? list.firstElementChild : list.lastElementChild;
      for (const [key, entry] of rows) if (entry.li === li) { rows.delete(key); break; }
      li.remove();
      if (dropNewest) isLive = false;
    }
  }

  function clear() { rows.clear(); list.replaceChildren(); next = null; }
  const toMs = input => input.value === "" ? "" : new Date(input.value).getTime();
  function parameters() {
    return { from: toMs(byId("from")), to: toMs(byId("to")), person: byId("person").value, action: byId("action").value.trim(), q: byId("words").value.trim() };
  }
  function tell() {
    byId("older").hidden = !next;
    byId("found").textContent = `${rows.size} ${rows.size === 1 ? "row" : "rows"}${next ? ", and older ones" : ""}${isLive ? ", live" : ""}`;
  }

  async function load(before) {
    const mine = ++asked, filter = parameters();
    try {
      const page = await askServer("/api/history", { ...filter, limit: PAGE_ROWS, before });
      if (mine !== asked) return;
      if (!before) { clear(); isLive = filter.to === "" && filter.person === "" && !filter.action && !filter.q; }
      page.rows.forEach(put); page.events.forEach(put);
      next = page.next; bound(Boolean(before)); tell();
      if (!before) lanes.load(filter.from, filter.to);
    } catch (error) {
      if (mine !== asked) return;
      // Without a database the rows of the last hour are what there is.
      if (error.status === 404) { isLive = true; tell(); byId("found").textContent += ", of the last hour: no memory is kept"; }
      else byId("found").textContent = `The timeline cannot be shown: ${error.message}.`;
    }
  }

  // The row at a time, or the last one before it.
  function showTime(ms) {
    const li = [...list.children].find(li => +li.dataset.ms <= ms + 500) || list.lastElementChild;
    if (!li) return;
    for (const marked of list.querySelectorAll(".found")) marked.classList.remove("found");
    li.classList.add("found"); li.scrollIntoView({ block: "nearest" });
  }

  function localText(date) {
    const two = n => String(n).padStart(2, "0");
    return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}T${two(date.getHours())}:${two(date.getMinutes())}`;
  }
  function showDay(offset) {
    const day = byId("from").value ? new Date(byId("from").value) : new Date();
    day.setHours(0, 0, 0, 0); day.setDate(day.getDate() + offset);
    const after = new Date(day); after.setDate(after.getDate() + 1);
    byId("from").value = localText(day);
    byId("to").value = after > new Date() ? "" : localText(after);
    return load();
  }
  function showToday() { byId("from").value = ""; return showDay(0); }

  byId("range").addEventListener("submit", e => { e.preventDefault(); load(); });
  byId("day-before").addEventListener("click", () => showDay(-1));
  byId("day-after").addEventListener("click", () => showDay(1));
  byId("today").addEventListener("click", () => { for (const id of ["person", "action", "words"]) byId(id).value = ""; showToday(); });
  byId("older").addEventListener("click", () => load(next));
  byId("forget").addEventListener("click", async () => {
    const { from, to } = parameters(), until = to === "" ? Date.now() + 1000 : to;
    const range = `${from === "" ? "the beginning" : new Date(from).toLocaleString()} to ${new Date(until).toLocaleString()}`;
    if (!confirm(`Delete all activities, events and points from ${range}? Persons, actions and words above do not limit this. It cannot be undone.`)) return;
    try {
      const { deleted } = await askServer("/api/history", { from: from === "" ? 0 : from, to: until }, "DELETE");
      await load();
      byId("found").textContent = `Forgotten: ${deleted.activities} activities, ${deleted.events} events.`;
    } catch (error) { byId("found").textContent = `Nothing was forgotten: ${error.message}.`; }
  });
  byId("ask").addEventListener("submit", async e => {
    e.preventDefault();
    const question = byId("question").value.trim(), answer = byId("answer");
    if (!question) return;
    try {
      const reply = await askServer("/api/ask", { q: question });
      answer.replaceChildren(reply.answer, ...(reply.synthetic && !isSimulated ? [" ", simulated()] : []));
    } catch (error) { answer.textContent = `No answer: ${error.message}.`; }
  });

  return {
    // Rows of a new connection, without those that were forgotten meanwhile.
    restart(newRows, synthetic) {
      isSimulated = synthetic;
      if (isLive) { clear(); newRows.forEach(put); bound(false); tell(); }
      if (isFirst) { isFirst = false; showToday(); } else load();
    },
    // Events reach the timeline by the memory, which keeps them within seconds.
    refreshSoon() { clearTimeout(refresh); refresh = setTimeout(() => { if (isLive) load(); }, REFRESH_MS); },
    add(row) { if (isLive) { put(row); bound(false); tell(); } },
  };
}
