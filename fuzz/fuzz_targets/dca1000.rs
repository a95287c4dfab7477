//! Packets: the first two bytes are the frame size, then records as mmWave Studio writes them.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::dca1000::{Assembler, PacketSource, RecordReader};

fuzz_target!(|input: &[u8]| {
    let Some((size, file)) = input.split_first_chunk::<2>() else {
        return;
    };
    let Ok(mut assembler) = Assembler::new(usize::from(u16::from_le_bytes(*size))) else {
        return;
    };
    let mut records = RecordReader::new(file);
    let mut frames = Vec::new();
    while let Ok(Some(packet)) = records.next_packet() {
        frames.extend(assembler.push(&packet));
    }
    frames.extend(assembler.finish());
    for frame in &frames {
        assert!(frame.integrity.missing_bytes() < frame.bytes.len());
    }
    assert_eq!(assembler.summary().frames, frames.len() as u64);
    // What was given out can be no more than what came and the zeros around it.
    let arrived: usize = frames
        .iter()
        .map(|f| f.bytes.len() - f.integrity.missing_bytes())
        .sum();
    assert!(arrived + assembler.summary().trailing_bytes <= file.len());
});
