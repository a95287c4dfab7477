//! Raw words: the first byte chooses the layout, the rest is the file.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::adc::{
    AdcReader, AdcStats, CubeShape, FrameDecoder, FrameSource, IqCheck, IqOrder, LvdsLanes,
    SampleKind, SampleLayout, iq::compare_layouts,
};

const SHAPE: CubeShape = CubeShape {
    n_loops: 2,
    n_tx: 2,
    n_rx: 4,
    n_samples: 32,
};

fuzz_target!(|input: &[u8]| {
    let Some((choice, file)) = input.split_first() else {
        return;
    };
    let layout = SampleLayout {
        lanes: match choice & 1 {
            0 => LvdsLanes::Two,
            _ => LvdsLanes::Four {
                receivers: choice >> 4,
            },
        },
        data: match choice >> 1 & 3 {
            0 => SampleKind::Complex {
                order: IqOrder::IFirst,
            },
            1 => SampleKind::Complex {
                order: IqOrder::QFirst,
            },
            _ => SampleKind::Real,
        },
    };
    let _ = compare_layouts(file, SHAPE);
    let Ok(decoder) = FrameDecoder::new(SHAPE, layout) else {
        return;
    };
    let frame_bytes = decoder.frame_bytes();
    let mut reader = AdcReader::new(file, decoder);
    let mut cube = SHAPE.zeros().expect("small");
    let (mut check, mut stats) = (IqCheck::new(SHAPE.n_samples), AdcStats::new(SHAPE.n_rx, 16));
    let mut n = 0;
    while let Ok(Some(_)) = reader.next_frame(&mut cube) {
        check.push(&cube);
        stats.push(&cube);
        n += 1;
    }
    assert_eq!(n * frame_bytes + reader.trailing_bytes(), file.len());
    assert!(check.verdict().positive_over_negative_db.is_finite());
    let _ = stats.problems();
});
