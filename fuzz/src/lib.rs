//! What the fuzz targets of files share: temporary files, and inputs of several named pieces.
//!
//! Archives and checkpoints carry checksums, which random bytes never match. Their targets therefore take the pieces that
//! lie inside, and pack them with correct checksums.

use std::io::{Cursor, Write};
use std::path::Path;

use radarllm_base::{Clip, Clutter, PointFrame, RadarPoint};
use radarllm_memory::Store;
use radarllm_memory::store::{PointsOf, Run};
use radarllm_monitor::messages::About;
use radarllm_monitor::points::FramePoints;
use radarllm_monitor::rows::{Activity, Event, EventKind, Origin};
use tempfile::NamedTempFile;
use zip::write::SimpleFileOptions;

/// A file with these bytes. It is removed when it is dropped.
pub fn temporary(bytes: &[u8]) -> NamedTempFile {
    let mut file = NamedTempFile::new().expect("a temporary file");
    file.write_all(bytes).expect("a temporary file");
    file
}

/// Lets panics of other people's decoders reach the guard that catches them. A panic in our own code still ends the
/// target, also where the guard would hide it.
pub fn only_our_panics() {
    let abort = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let is_foreign = panic.location().is_some_and(|l| {
            let file = l.file();
            file.contains("/registry/") || file.contains("/rustc/") || file.contains("/library/")
        });
        if !is_foreign {
            abort(panic);
        }
    }));
}

/// Named pieces: a byte with the length of the name, the name, four bytes with the length of the piece (little endian) and
/// the piece. A length beyond the end means all of the rest.
pub fn pieces(mut bytes: &[u8]) -> Vec<(String, &[u8])> {
    let mut found = Vec::new();
    while let Some((&n, rest)) = bytes.split_first() {
        let (name, rest) = rest.split_at(usize::from(n).min(rest.len()));
        let Some((length, rest)) = rest.split_first_chunk() else {
            break;
        };
        let n = usize::try_from(u32::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let (piece, rest) = rest.split_at(n.min(rest.len()));
        found.push((String::from_utf8_lossy(name).into_owned(), piece));
        bytes = rest;
    }
    found
}

/// The reverse of [`pieces`].
pub fn pack<'a>(pieces: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> Vec<u8> {
    let mut packed = Vec::new();
    for (name, piece) in pieces {
        packed.push(u8::try_from(name.len()).expect("a short name"));
        packed.extend(name.as_bytes());
        packed.extend(
            u32::try_from(piece.len())
                .expect("a short piece")
                .to_le_bytes(),
        );
        packed.extend(piece);
    }
    packed
}

/// A zip archive of pieces, as they are or deflated.
pub fn archive(pieces: &[(String, &[u8])], is_deflated: bool) -> Option<Vec<u8>> {
    let method = match is_deflated {
        true => zip::CompressionMethod::Deflated,
        false => zip::CompressionMethod::Stored,
    };
    let options = SimpleFileOptions::default().compression_method(method);
    let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, piece) in pieces {
        // A name that occurs twice is refused.
        writer.start_file(name.as_str(), options).ok()?;
        writer.write_all(piece).ok()?;
    }
    Some(writer.finish().ok()?.into_inner())
}

/// 2026-11-23 17:38:12 UTC, milliseconds since 1970.
pub const NOW_MS: i64 = 1_795_455_492_000;

/// A radar that is not simulated.
pub fn origin() -> Origin {
    Origin {
        source: "/dev/ttyUSB1".into(),
        radar: "awr1843boost".into(),
        model: "default".into(),
        decoder: "greedy".into(),
        version: "0.1.0".into(),
        synthetic: false,
    }
}

/// Six seconds of somebody whose height goes up and down, with `radians_per_s`, and whose points have a speed, m/s.
pub fn moving_up_and_down(radians_per_s: f32, velocity_mps: f32) -> Clip {
    let frame = |i: u32| {
        let time_s = i as f32 / 10.0;
        let point = RadarPoint {
            y_m: 2.0,
            z_m: 0.3 * (radians_per_s * time_s).sin(),
            range_m: 2.0,
            velocity_mps,
            ..RadarPoint::default()
        };
        PointFrame {
            frame: i,
            time_s: time_s.into(),
            points: vec![point; 5],
            board: None,
        }
    };
    let Ok(provenance) = "recorded:csv:room.csv".parse();
    Clip {
        frames: (0..60).map(frame).collect(),
        frame_rate_hz: 10.0,
        radar_height_m: 1.0,
        is_height_assumed: false,
        radar: "iwr6843isk".into(),
        provenance,
        clutter: Clutter::Settled,
    }
}

/// What a server and a publisher say of it.
pub fn about() -> About {
    About {
        name: "lounge".into(),
        origin: origin(),
        radar_height_m: 1.2,
        frame_period_s: 0.1,
        zones: Vec::new(),
    }
}

/// Writes a memory with a run, two activities with points and two events.
pub fn write_memory(path: &Path) {
    let mut store = Store::open(path, NOW_MS).expect("a memory").store;
    let activity = |start_ms: i64, action: &str, caption: &str| Activity {
        start_ms,
        end_ms: start_ms + 4_000,
        person: 1,
        action: action.into(),
        caption: caption.into(),
        confidence: Some(0.7),
        windows: 2,
        points: 130,
        place_m: Some([0.4, 2.1]),
    };
    let point = RadarPoint {
        y_m: 2.0,
        range_m: 2.0,
        velocity_mps: 0.5,
        intensity_db: 20.0,
        ..RadarPoint::default()
    };
    let frame = |offset_ms| FramePoints {
        offset_ms,
        points: vec![point; 3],
    };
    let points = [frame(0), frame(100)];
    let event = |at_ms: i64, kind| Event {
        at_ms,
        kind,
        person: Some(1),
        data: None,
    };
    let written = store.write(|batch| {
        let run = Run {
            start_ms: NOW_MS - 90_000_000,
            end_ms: NOW_MS,
            is_over: false,
        };
        batch.write_run(None, &run)?;
        let origin = origin();
        let up = activity(
            NOW_MS - 60_000,
            "stand_up",
            "a person gets up from the floor",
        );
        let id = batch.insert_activity(&up, &origin)?;
        batch.store_points(PointsOf::Activity(id), up.start_ms, &points)?;
        let walk = activity(NOW_MS - 86_400_000, "walk", "a person walks away");
        batch.insert_activity(&walk, &origin)?;
        batch.insert_event(&event(NOW_MS - 70_000, EventKind::Present), &origin)?;
        batch.insert_event(&event(NOW_MS - 65_000, EventKind::Suspected), &origin)?;
        Ok(())
    });
    written.expect("a memory");
}
