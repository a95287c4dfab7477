//! SQLite databases of ROS 2 bags: the tables `topics` and `messages`.
//!
//! The database is opened for reading alone. No code in its definitions is trusted, and only plain tables are read.

use std::{ffi::OsString, fs, path::Path};

use radarllm_formats::recordings::{Place, RosEncoding, RosMessages, ros::MAX_CHUNK_BYTES};
use rusqlite::{Connection, OpenFlags, config::DbConfig, limits::Limit};

use super::{mcap::seconds, reading::plain};
use crate::error::{Error, Result};

/// Adds the messages of a file, which lies unpacked at `readable`. `base` is added to the numbers of its topics.
pub(super) fn read(path: &Path, readable: &Path, base: u64, messages: &mut RosMessages) -> Result {
    let wrong = |e: rusqlite::Error| Error::wrap_in_file(path, e);
    let connection = open(readable).map_err(wrong)?;
    for table in ["topics", "messages"] {
        let is_plain: rusqlite::Result<bool> = connection.query_row(
            "SELECT count(*) = 1 FROM sqlite_schema
             WHERE name = ?1 AND type = 'table' AND sql NOT LIKE 'CREATE VIRTUAL%'",
            [table],
            |row| row.get(0),
        );
        if !is_plain.map_err(wrong)? {
            return Err(Error::in_file(
                path,
                format!("not a ROS 2 bag: an SQLite database without a table `{table}`"),
            ));
        }
    }
    let mut topics = connection
        .prepare("SELECT id, name, type, serialization_format FROM topics")
        .map_err(wrong)?;
    let mut rows = topics.query([]).map_err(wrong)?;
    while let Some(row) = rows.next().map_err(wrong)? {
        let id: u32 = row.get(0).map_err(wrong)?;
        let text = |column: usize| row.get::<_, String>(column).map_err(wrong);
        let encoding = (text(3)? == "cdr").then_some(RosEncoding::Cdr);
        messages
            .connect(
                Place::Row(id as usize),
                base + u64::from(id),
                &text(1)?,
                &text(2)?,
                encoding,
                None,
            )
            .map_err(|e| Error::wrap_in_file(path, e))?;
    }
    // In the order of the table. The data stand last, so that those of other topics are not read.
    let mut all = connection
        .prepare("SELECT topic_id, timestamp, data FROM messages")
        .map_err(wrong)?;
    let mut rows = all.query([]).map_err(wrong)?;
    let mut n = 0;
    while let Some(row) = rows.next().map_err(wrong)? {
        let at = Place::Row(n);
        n += 1;
        let id = base + u64::from(row.get::<_, u32>(0).map_err(wrong)?);
        let time_ns: i64 = row.get(1).map_err(wrong)?;
        let recorded_s = u64::try_from(time_ns).ok().map(seconds);
        let data = match messages.is_wanted(id) {
            true => row.get_ref(2).map_err(wrong)?.as_blob().map_err(|e| {
                Error::in_file(path, format!("{at}: {e}, expected the bytes of a message"))
            })?,
            false => &[],
        };
        plain(at, data)
            .and_then(|data| messages.message(at, id, recorded_s, &data))
            .map_err(|e| Error::wrap_in_file(path, e))?;
    }
    Ok(())
}

fn open(path: &Path) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    // A relative path that begins with `file:` would be a URI with options.
    let path = std::path::absolute(path).unwrap_or_else(|_| path.into());
    // Without a log that belongs to it, the file is read as it lies there, so that no file is made beside it: recordings may
    // lie in folders that cannot be written.
    let connection = match (has_log(&path), unchanging(&path)) {
        (false, Some(uri)) => Connection::open_with_flags(uri, flags | OpenFlags::SQLITE_OPEN_URI)?,
        _ => Connection::open_with_flags(&path, flags)?,
    };
    connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, MAX_CHUNK_BYTES as i32)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
    connection.execute_batch("PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0;")?;
    Ok(connection)
}

/// Whether the recorder left a log with messages that are not in the file yet.
fn has_log(path: &Path) -> bool {
    let mut log = OsString::from(path);
    log.push("-wal");
    fs::metadata(log).is_ok_and(|log| log.len() > 0)
}

/// The URI of a file that nobody changes; `None` if its path is not text.
fn unchanging(path: &Path) -> Option<String> {
    let path = path.to_str()?.replace('\\', "/");
    let mut uri = String::from(if path.starts_with('/') {
        "file:"
    } else {
        "file:/"
    });
    for byte in path.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'.' | b'-' | b'_' | b':' => {
                uri.push(char::from(byte));
            }
            _ => uri.push_str(&format!("%{byte:02X}")),
        }
    }
    Some(uri + "?immutable=1")
}
