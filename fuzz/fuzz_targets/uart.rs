//! A UART stream in every dialect and with a guessed one: counts add up, points are finite.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::uart::{Dialect, UartParser, recorded_frames};

fuzz_target!(|bytes: &[u8]| {
    for dialect in Dialect::ALL.map(Some).into_iter().chain([None]) {
        let mut parser = UartParser::new(dialect);
        // Two pieces, so that packets are cut.
        let (first, second) = bytes.split_at(bytes.len() / 3);
        let mut frames = Vec::new();
        for piece in [first, second] {
            match parser.push(piece) {
                Ok(more) => frames.extend(more),
                Err(_) => return,
            }
        }
        let Ok((last, report, _)) = parser.finish() else {
            return;
        };
        frames.extend(last);
        assert_eq!(
            report.bytes,
            report.packet_bytes + report.skipped_bytes + report.trailing_bytes
        );
        assert_eq!(frames.len() as u64, report.packets + report.short_packets);
        for point in recorded_frames(frames).iter().flat_map(|f| &f.points) {
            assert!(point.range_m.is_finite() && point.intensity_db.is_finite());
        }
    }
});
