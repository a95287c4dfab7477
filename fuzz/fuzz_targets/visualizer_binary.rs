//! Pieces of a UART stream in a folder: how they are cut changes nothing, unless they are of several runs. Every run can be
//! read.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::{
    recordings::{
        PiecesError, VisualizerBinaryError, read_visualizer_binary, read_visualizer_binary_run,
    },
    uart::Dialect,
};

fuzz_target!(|bytes: &[u8]| {
    for dialect in Dialect::ALL {
        let whole =
            read_visualizer_binary(vec![(1, bytes)], Some(dialect)).expect("a dialect is named");
        let (first, second) = bytes.split_at(bytes.len() / 3);
        let pieces = vec![(10, second), (9, first)];
        match read_visualizer_binary(pieces.clone(), Some(dialect)) {
            Ok(joined) => {
                assert_eq!(whole.report, joined.report);
                assert_eq!(whole.frames.len(), joined.frames.len());
            }
            Err(VisualizerBinaryError::Pieces(PiecesError::SeveralRuns { runs, .. })) => {
                for run in 1..=runs.len() {
                    read_visualizer_binary_run(pieces.clone(), Some(dialect), Some(run))
                        .expect("the run is listed");
                }
            }
            Err(error) => panic!("{error}"),
        }
        let kept = (whole.report.packets + whole.report.short_packets) as usize;
        assert!(whole.frames.len() <= kept);
    }
    let _ = read_visualizer_binary(vec![(1, bytes)], None);
});
