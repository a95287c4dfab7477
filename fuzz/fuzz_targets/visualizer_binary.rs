//! Pieces of a UART stream in a folder: how they are cut changes nothing.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::{recordings::read_visualizer_binary, uart::Dialect};

fuzz_target!(|bytes: &[u8]| {
    for dialect in Dialect::ALL {
        let whole =
            read_visualizer_binary(vec![(1, bytes)], Some(dialect)).expect("a dialect is named");
        let (first, second) = bytes.split_at(bytes.len() / 3);
        let pieces = vec![(10, second), (9, first)];
        let joined = read_visualizer_binary(pieces, Some(dialect)).expect("a dialect is named");
        assert_eq!(whole.report, joined.report);
        assert_eq!(whole.frames.len(), joined.frames.len());
        let kept = (whole.report.packets + whole.report.short_packets) as usize;
        assert!(whole.frames.len() <= kept);
    }
    let _ = read_visualizer_binary(vec![(1, bytes)], None);
});
