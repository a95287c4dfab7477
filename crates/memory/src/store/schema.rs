//! Tables of the database, and their versions.

use rusqlite::{Connection, Row};

/// Marks the file as ours: "RLLM". SQLite keeps it in the header of the file.
pub(super) const APPLICATION_ID: i64 = 0x524c_4c4d;

/// What each version adds to the one before. A published version is never changed; a new one is appended.
const MIGRATIONS: [&str; 2] = ["
CREATE TABLE origin (
    id INTEGER PRIMARY KEY,
    source TEXT NOT NULL,
    radar TEXT NOT NULL,
    model TEXT NOT NULL,
    decoder TEXT NOT NULL,
    version TEXT NOT NULL,
    synthetic INTEGER NOT NULL,
    UNIQUE (source, radar, model, decoder, version, synthetic)
);
-- AUTOINCREMENT: a page that shows row 7 must not find another activity under 7 after a deletion.
CREATE TABLE activity (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    start_ms INTEGER NOT NULL,
    end_ms INTEGER NOT NULL,
    person INTEGER NOT NULL,
    action TEXT NOT NULL,
    caption TEXT NOT NULL,
    confidence REAL,
    windows INTEGER NOT NULL,
    points INTEGER NOT NULL,
    place TEXT,
    origin INTEGER NOT NULL REFERENCES origin (id)
);
CREATE INDEX activity_by_start ON activity (start_ms, id);
CREATE INDEX activity_by_action ON activity (action, start_ms, id);
CREATE INDEX activity_by_origin ON activity (origin);
CREATE TABLE event (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    at_ms INTEGER NOT NULL,
    kind TEXT NOT NULL,
    person INTEGER,
    data TEXT,
    origin INTEGER NOT NULL REFERENCES origin (id)
);
CREATE INDEX event_by_time ON event (at_ms, id);
CREATE INDEX event_by_kind ON event (kind, at_ms, id);
CREATE INDEX event_by_origin ON event (origin);
-- The points of an activity, or those around an event.
CREATE TABLE points (
    id INTEGER PRIMARY KEY,
    start_ms INTEGER NOT NULL,
    end_ms INTEGER NOT NULL,
    activity INTEGER UNIQUE REFERENCES activity (id) ON DELETE CASCADE,
    event INTEGER UNIQUE REFERENCES event (id) ON DELETE CASCADE,
    blob BLOB NOT NULL,
    CHECK ((activity IS NULL) <> (event IS NULL))
);
CREATE INDEX points_by_start ON points (start_ms);
CREATE VIRTUAL TABLE activity_fts USING fts5 (
    caption, action, content = 'activity', content_rowid = 'id', tokenize = 'porter unicode61'
);
-- Without it the words of deleted rows remain in the index until its parts happen to be merged.
INSERT INTO activity_fts (activity_fts, rank) VALUES ('secure-delete', 1);
CREATE TRIGGER activity_inserted AFTER INSERT ON activity BEGIN
    INSERT INTO activity_fts (rowid, caption, action) VALUES (new.id, new.caption, new.action);
END;
CREATE TRIGGER activity_deleted AFTER DELETE ON activity BEGIN
    INSERT INTO activity_fts (activity_fts, rowid, caption, action)
    VALUES ('delete', old.id, old.caption, old.action);
END;
CREATE TRIGGER activity_updated AFTER UPDATE OF caption, action ON activity
WHEN old.caption <> new.caption OR old.action <> new.action BEGIN
    INSERT INTO activity_fts (activity_fts, rowid, caption, action)
    VALUES ('delete', old.id, old.caption, old.action);
    INSERT INTO activity_fts (rowid, caption, action) VALUES (new.id, new.caption, new.action);
END;
", "
-- When a radar was watched: nothing is known of the time outside of all runs.
CREATE TABLE run (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    start_ms INTEGER NOT NULL,
    -- The last sign of life.
    end_ms INTEGER NOT NULL,
    -- Whether the run ended in order.
    is_over INTEGER NOT NULL,
    -- Activities before this time were deleted.
    activities_ms INTEGER NOT NULL DEFAULT 0
);
CREATE INDEX run_by_end ON run (end_ms, id);
-- Before this version, nothing was written of runs. An hour without any entry counts as time in which none was.
INSERT INTO run (start_ms, end_ms, is_over)
SELECT min(s), max(e), 1 FROM (
    SELECT s, e, sum(is_new) OVER (ORDER BY s, e ROWS UNBOUNDED PRECEDING) AS n FROM (
        SELECT s, e, s > 3600000 + coalesce(
            max(e) OVER (ORDER BY s, e ROWS BETWEEN UNBOUNDED PRECEDING AND 1 PRECEDING), s) AS is_new
        FROM (SELECT start_ms AS s, end_ms AS e FROM activity UNION ALL SELECT at_ms, at_ms FROM event)))
GROUP BY n;
"];

/// The newest schema version.
pub(super) const NEWEST: i64 = MIGRATIONS.len() as i64;

/// What a file says about itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// It has no content yet.
    Empty,
    /// It is ours, of this version.
    Ours(i64),
    /// It is a database of another program.
    Foreign,
}

/// Reads what a file says about itself, and changes nothing.
pub(super) fn kind(connection: &Connection) -> rusqlite::Result<Kind> {
    let number = |sql: &str| connection.query_row(sql, [], |row| row.get::<_, i64>(0));
    let version = number("PRAGMA user_version")?;
    let n_objects = number("SELECT count(*) FROM sqlite_schema")?;
    Ok(match (number("PRAGMA application_id")?, version) {
        (APPLICATION_ID, 1..) => Kind::Ours(version),
        (0, 0) if n_objects == 0 => Kind::Empty,
        _ => Kind::Foreign,
    })
}

/// Brings the tables from a version to the newest one. Each step is one transaction.
pub(super) fn migrate(connection: &Connection, from: i64) -> rusqlite::Result<()> {
    for (version, statements) in (1i64..).zip(MIGRATIONS) {
        if version > from {
            connection.execute_batch(&format!(
                "BEGIN IMMEDIATE;
                 {statements}
                 PRAGMA application_id = {APPLICATION_ID};
                 PRAGMA user_version = {version};
                 COMMIT;"
            ))?;
        }
    }
    Ok(())
}

/// Whether the tables, indices and triggers are those that the migrations make.
///
/// A file from elsewhere could have a view or a trigger in place of a table, and with it make a query run for ever. The
/// tables in which FTS5 keeps its index are left out: their definition is SQLite's affair.
pub(super) fn is_genuine(connection: &Connection) -> rusqlite::Result<bool> {
    let reference = Connection::open_in_memory()?;
    migrate(&reference, 0)?;
    let expected = definitions(&reference)?;
    // One more row than expected shows that there are others.
    Ok(definitions_at_most(connection, expected.len() + 1)? == expected)
}

type Definition = (String, String, String);

fn definitions(connection: &Connection) -> rusqlite::Result<Vec<Definition>> {
    definitions_at_most(connection, 1_000)
}

fn definitions_at_most(connection: &Connection, max: usize) -> rusqlite::Result<Vec<Definition>> {
    let mut statement = connection.prepare(
        "SELECT type, name, sql FROM sqlite_schema
         WHERE sql IS NOT NULL AND name NOT GLOB 'activity_fts_*' AND name NOT GLOB 'sqlite_*'
         ORDER BY name, type LIMIT ?1",
    )?;
    let definition = |row: &Row<'_>| Ok((row.get(0)?, row.get(1)?, row.get(2)?));
    statement.query_map([max], definition)?.collect()
}
