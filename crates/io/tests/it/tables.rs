//! Tables of points with the options of their readers.

use std::fs;

use radarllm_io::{CaptureOptions, Error, PointOptions, Recording, read_recording};

fn read(name: &str, text: &str, points: PointOptions) -> Result<Recording, Error> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    let options = CaptureOptions {
        points,
        ..CaptureOptions::default()
    };
    read_recording(&[path], &options)
}

/// Frames with two points each: a number, a time and the rest.
fn table(header: &str, time: impl Fn(u32) -> String) -> String {
    let mut text = header.to_owned() + "\n";
    for n in 0..40 {
        for x in [0.5, 1.0] {
            text += &format!("{n},{},{x},2,0,0.25,15\n", time(n));
        }
    }
    text
}

const HEADER: &str = "frame,timestamp,x,y,z,velocity,snr";

fn with_rate(frame_rate_hz: f64) -> PointOptions {
    PointOptions {
        frame_rate_hz: Some(frame_rate_hz),
        ..PointOptions::default()
    }
}

#[test]
fn a_clock_in_milliseconds_gives_the_frame_rate() {
    let text = table(HEADER, |n| (100 * n).to_string());
    let recording = read("log.csv", &text, PointOptions::default()).unwrap();
    assert!((recording.clip.frame_rate_hz - 10.0).abs() < 1e-9);
    assert_eq!(recording.clip.frames.len(), 40);
    assert!((recording.clip.frames[39].time_s - 3.9).abs() < 1e-9);
    assert!(
        recording
            .notes
            .iter()
            .any(|n| n.contains("are milliseconds"))
    );
    assert_eq!(recording.warnings, [""; 0]);
}

/// A clock that is not used is compared with what is.
#[test]
fn a_clock_that_contradicts_the_frame_rate_is_a_warning() {
    let text = table(HEADER, |n| (100 * n).to_string());
    let recording = read("log.csv", &text, with_rate(10.0)).unwrap();
    assert_eq!(recording.warnings, [""; 0]);
    let recording = read("log.csv", &text, with_rate(20.0)).unwrap();
    assert_eq!(recording.clip.frame_rate_hz, 20.0);
    assert_eq!(
        recording.warnings,
        [
            "the clock of the recording has 3.9 s from the first to the last frame, the frame numbers at 20 Hz have 1.9 \
             s, which are used"
        ]
    );
    // A pause that the numbers do not show, and a clock that goes back.
    let pause = table(HEADER, |n| {
        (100 * n + if n < 20 { 0 } else { 180_000 }).to_string()
    });
    let recording = read("log.csv", &pause, with_rate(10.0)).unwrap();
    assert!(
        recording.warnings[0].contains("183.9 s"),
        "{:?}",
        recording.warnings
    );
    let back = table(HEADER, |n| {
        (100 * n + if n < 20 { 180_000 } else { 0 }).to_string()
    });
    for options in [with_rate(10.0), PointOptions::default()] {
        let recording = read("log.csv", &back, options).unwrap();
        assert!(
            recording.warnings[0].contains("went back 1 times, first by 179.900 s at frame 20"),
            "{:?}",
            recording.warnings
        );
        assert!((recording.clip.frames[39].time_s - 3.9).abs() < 1e-6);
    }
}

#[test]
fn an_unclear_clock_is_an_error_unless_a_frame_rate_is_named() {
    let text = table(HEADER, |n| {
        (1_734_343_200_000_i64 + 5000 * i64::from(n)).to_string()
    });
    let error = read("log.csv", &text, PointOptions::default()).unwrap_err();
    assert!(
        error.to_string().contains("a median step of 5000"),
        "{error}"
    );
    assert!(error.hint.unwrap().to_string().contains("`frame_rate` HZ"));
    let recording = read("log.csv", &text, with_rate(10.0)).unwrap();
    assert!(recording.warnings[0].contains("times of the table are not used"));
    assert!((recording.clip.frames[39].time_s - 3.9).abs() < 1e-9);
}

#[test]
fn restarted_frame_numbers_are_said_once() {
    let number = |n: u32| if n < 15 { n + 90 } else { n };
    let mut text = String::from("frame,t_s,x,y,z,v,snr\n");
    let mut without = String::from("frame,x,y,z,v,snr\n");
    for n in 0..40 {
        text += &format!("{},{},1,2,0,0.5,15\n", number(n), f64::from(n) / 10.0);
        without += &format!("{},1,2,0,0.5,15\n", number(n));
    }
    let recording = read("log.csv", &text, PointOptions::default()).unwrap();
    assert!(
        recording
            .notes
            .contains(&"frame numbers went back 1 times: the clock gives the times".into()),
        "{:?}",
        recording.notes
    );
    let recording = read("log.csv", &without, with_rate(10.0)).unwrap();
    assert_eq!(
        recording.warnings,
        ["frame numbers went back 1 times: the frames follow on"]
    );
}

#[test]
fn columns_make_a_table_of_any_file() {
    let text = table(HEADER, |n| (100 * n).to_string());
    let body = text.split_once('\n').unwrap().1;
    for name in ["log.csv", "log.txt", "log"] {
        let options = PointOptions {
            columns: Some("frame,t_ms,x,y,z,v,snr".into()),
            ..PointOptions::default()
        };
        let recording = read(name, body, options).unwrap();
        assert!((recording.clip.frame_rate_hz - 10.0).abs() < 1e-9);
        assert_eq!(recording.clip.frames[0].points[0].velocity_mps, 0.25);
    }
    for text in [body.to_owned(), table("nr,t,a,b,c,d,e", |n| n.to_string())] {
        let error = read("log.csv", &text, PointOptions::default()).unwrap_err();
        assert!(error.to_string().contains("a table without"), "{error}");
        assert!(
            error
                .hint
                .unwrap()
                .to_string()
                .starts_with("`columns` names them")
        );
    }
}

/// Tables of tracks and bags have intensities, too.
#[test]
fn an_impossible_snr_is_a_warning_in_tables_of_tracks() {
    let rows = |snr: f64| {
        let mut text = String::from(
            "frame,tid,posx,posy,posz,velx,vely,velz,pointx0,pointy0,pointz0,doppler0,snr0\n",
        );
        for n in 0..20 {
            text += &format!("{n},1,0,2,0,0,0,0,0.5,2,0,0.1,{snr}\n");
        }
        text
    };
    let recording = read("log.csv", &rows(15.0), with_rate(10.0)).unwrap();
    assert_eq!(recording.warnings, [""; 0]);
    let recording = read("log.csv", &rows(150.0), with_rate(10.0)).unwrap();
    assert!(
        recording.warnings[0].contains("the median of `snrN` is 150 dB"),
        "{:?}",
        recording.warnings
    );
}
