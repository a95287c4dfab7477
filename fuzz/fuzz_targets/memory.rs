//! The file of taught activities, and a recording that is compared with it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_fuzz::{moving_up_and_down, temporary};
use radarllm_teach::{Memory, Recogniser};

fuzz_target!(|bytes: &[u8]| {
    let file = temporary(bytes);
    let Ok(memory) = Memory::load(file.path()) else {
        return;
    };
    let _ = memory.overview();
    if let Some(recogniser) = Recogniser::new(&memory) {
        let _ = recogniser.recognise(&moving_up_and_down(3.1, 0.3));
    }
    memory.save(file.path()).expect("a temporary file");
    assert!(Memory::load(file.path()).is_ok_and(|again| again == memory));
});
