//! Names of the library's options in Python. The module is that of `radarllm-py`, whose own tests are written in Python.

#[path = "../../../py/src/keywords.rs"]
mod python;

use python::{RENAMED, keyword};

#[test]
fn options_of_the_library_become_keywords() {
    assert_eq!(keyword("frame_rate"), "`frame_rate_hz`");
    assert_eq!(keyword("iq"), "`iq`");
    assert_eq!(keyword("overwrite"), "`overwrite=True`");
    let error = radarllm::Error::input("room.dat: no frame rate")
        .with_hint(radarllm_base::message::option("frame_rate").text(" sets it"));
    let hint = error.hint.unwrap().with_options(keyword);
    assert_eq!(hint, "`frame_rate_hz` sets it");
}

/// A keyword that is renamed must be renamed in the table too: hints would name one that does not exist.
#[test]
fn every_renamed_keyword_exists() {
    let signatures = [
        include_str!("../../../../python/radarllm/_capture.py"),
        include_str!("../../../../python/radarllm/_native.pyi"),
    ];
    for (_, keyword) in RENAMED.iter().chain(&[("overwrite", "overwrite")]) {
        let declared = format!(" {keyword}: ");
        let exists = signatures.iter().any(|text| text.contains(&declared));
        assert!(exists, "{keyword}");
    }
}
