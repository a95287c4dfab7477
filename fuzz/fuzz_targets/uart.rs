//! A UART stream in every dialect and with a guessed one: counts add up, points are possible, and pieces do not matter.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::uart::{Dialect, UartFrame, UartParser, UartReport, recorded_frames};

fn read(dialect: Option<Dialect>, pieces: &[&[u8]]) -> Option<(Vec<UartFrame>, UartReport)> {
    let mut parser = UartParser::new(dialect).with_doppler_step(0.1);
    let mut frames = Vec::new();
    for piece in pieces {
        frames.extend(parser.push(piece).ok()?);
    }
    let (last, report, _) = parser.finish().ok()?;
    frames.extend(last);
    Some((frames, report))
}

fuzz_target!(|bytes: &[u8]| {
    for dialect in Dialect::ALL.map(Some).into_iter().chain([None]) {
        let whole = read(dialect, &[bytes]);
        // Two pieces, so that packets are cut.
        let (first, second) = bytes.split_at(bytes.len() / 3);
        assert_eq!(read(dialect, &[first, second]), whole);
        let Some((frames, report)) = whole else {
            continue;
        };
        assert_eq!(
            report.bytes,
            report.packet_bytes + report.skipped_bytes + report.trailing_bytes
        );
        assert_eq!(frames.len() as u64, report.packets + report.short_packets);
        let _ = report.no_points_because();
        for point in recorded_frames(frames).iter().flat_map(|f| &f.points) {
            assert!(point.range_m <= 300.0 && point.intensity_db.is_finite());
        }
    }
});
