//! Damaged files give errors: no panic, no abort, no endless loop.

use radarllm_base::{BoardReport, BoardTrack};
use radarllm_dataset::shard::ShardReader;
use radarllm_dataset::{Columns, Overwrite, PointsMeta, build, write_points};

use crate::support::{Draw, frames, make, options, plan, read_both};

/// One random damage: flipped bits, a truncation, or a run of one byte.
fn damage(bytes: &mut Vec<u8>, draw: &mut Draw) {
    let at = draw.below(bytes.len() as u64) as usize;
    match draw.below(4) {
        0 => bytes.truncate(at),
        1 => {
            let end = (at + 1 + draw.below(16) as usize).min(bytes.len());
            let fill = [0x00, 0xff, 0x7f, 0x80][draw.below(4) as usize];
            bytes[at..end].fill(fill);
        }
        _ => {
            for _ in 0..1 + draw.below(4) {
                let i = draw.below(bytes.len() as u64) as usize;
                bytes[i] ^= 1 << draw.below(8);
            }
        }
    }
}

#[test]
fn damaged_points_files_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("p.parquet");
    let meta = PointsMeta {
        radar: "r".into(),
        source: "s".into(),
        seed: None,
        version: "0".into(),
        radar_height_m: None,
        frame_rate_hz: 10.0,
        has_speeds: true,
    };
    let mut frames = frames(&mut Draw::new(1), 20);
    // Half of the frames have a report of the board, one with a track in a plane.
    for frame in frames.iter_mut().step_by(2) {
        let track = BoardTrack {
            id: frame.frame,
            place_m: [0.5, 2.0],
            height_m: (frame.frame > 3).then_some(0.4),
            velocity_mps: [0.1, 0.2, 0.3],
        };
        frame.board = Some(BoardReport {
            tracks: vec![track; frame.frame as usize % 3],
            is_present: Some(true),
        });
    }
    write_points(&path, &meta, &frames, Overwrite::Refuse).unwrap();
    let sound = std::fs::read(&path).unwrap();
    let mut n_errors = 0;
    for seed in 0..1500 {
        let mut bytes = sound.clone();
        damage(&mut bytes, &mut Draw::new(seed));
        std::fs::write(&path, bytes).unwrap();
        // Either answer is right (a flipped bit of a value is still a value); returning is the test.
        n_errors += usize::from(read_both(&path).is_err());
    }
    assert!(
        n_errors > 500,
        "only {n_errors} of 1500 damaged files were noticed"
    );
}

#[test]
fn damaged_shards_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    let report = build(dir.path(), &plan(20), options(1), make, |_| {}).unwrap();
    let sound = std::fs::read(report.manifest.shards[0].path(dir.path())).unwrap();
    let path = dir.path().join("damaged.parquet");
    let mut n_errors = 0;
    for seed in 0..600 {
        let mut bytes = sound.clone();
        damage(&mut bytes, &mut Draw::new(seed));
        std::fs::write(&path, bytes).unwrap();
        let result =
            ShardReader::open(&path, Columns::All).and_then(|r| r.collect::<Result<Vec<_>, _>>());
        n_errors += usize::from(result.is_err());
    }
    assert!(
        n_errors > 100,
        "only {n_errors} of 600 damaged shards were noticed"
    );
}

#[test]
fn what_is_not_parquet_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("p.parquet");
    let mut huge_footer = b"PAR1".to_vec();
    huge_footer.extend([0xff; 8]);
    huge_footer.extend(*b"PAR1");
    for bytes in [
        &b""[..],
        b"PAR1",
        b"PAR1PAR1PAR1",
        &[0; 4096],
        &huge_footer,
        b"x,y,z\n1,2,3\n1,2,3\n",
    ] {
        std::fs::write(&path, bytes).unwrap();
        assert!(read_both(&path).is_err());
        assert!(ShardReader::open(&path, Columns::All).is_err());
    }
    assert!(read_both(dir.path()).is_err(), "a directory");
    assert!(read_both(&dir.path().join("absent")).is_err());
}
