//! Limits of what the memory keeps.

use radarllm_monitor::rows::{Activity, Growth, Origin};

use crate::error::StoreError;

/// Largest time that is kept, milliseconds since 1970 in UTC: the end of the year 9999.
pub const MAX_TIME_MS: i64 = 253_402_300_799_999;
/// Longest activity, ms. The caller begins a new row after it. Because of this limit, a query by time reads one day of
/// rows before its range and not all of them.
pub const MAX_ACTIVITY_MS: i64 = 86_400_000;
/// Longest caption, bytes.
pub const MAX_CAPTION_BYTES: usize = 2_000;
/// Longest name of an action, bytes.
pub const MAX_ACTION_BYTES: usize = 250;
/// Longest text of an origin, bytes: that of a path.
pub const MAX_ORIGIN_BYTES: usize = 4_096;
/// Longest data of an event, bytes of JSON.
pub const MAX_DATA_BYTES: usize = 4_096;
/// Largest distance of a place from the radar along either axis, m.
pub const MAX_PLACE_M: f64 = 1_000.0;

/// Checks an activity.
pub(super) fn check_activity(activity: &Activity) -> Result<(), StoreError> {
    check_time("start_ms", activity.start_ms)?;
    check_end(activity.start_ms, activity.end_ms)?;
    if activity.action.is_empty() {
        return Err(StoreError::invalid("action", "a name", &activity.action));
    }
    check_text("action", &activity.action, MAX_ACTION_BYTES)?;
    check_what_grows(&activity.caption, activity.confidence, activity.place_m)
}

/// Checks all but the end, which depends on the row.
pub(super) fn check_growth(growth: &Growth) -> Result<(), StoreError> {
    check_what_grows(&growth.caption, growth.confidence, growth.place_m)
}

/// Checks an origin.
pub(super) fn check_origin(origin: &Origin) -> Result<(), StoreError> {
    check_text("source", &origin.source, MAX_ORIGIN_BYTES)?;
    check_text("radar", &origin.radar, MAX_ORIGIN_BYTES)?;
    check_text("model", &origin.model, MAX_ORIGIN_BYTES)?;
    check_text("decoder", &origin.decoder, MAX_ORIGIN_BYTES)?;
    check_text("version", &origin.version, MAX_ORIGIN_BYTES)
}

fn check_what_grows(
    caption: &str,
    confidence: Option<f64>,
    place_m: Option<[f64; 2]>,
) -> Result<(), StoreError> {
    check_text("caption", caption, MAX_CAPTION_BYTES)?;
    if let Some(confidence) = confidence.filter(|c| !(0.0..=1.0).contains(c)) {
        return Err(StoreError::invalid("confidence", "0 to 1", confidence));
    }
    let is_far = |m: &f64| !(-MAX_PLACE_M..=MAX_PLACE_M).contains(m);
    match place_m.iter().flatten().find(|m| is_far(m)) {
        Some(m) => Err(StoreError::invalid("place_m", "-1000 to 1000", m)),
        None => Ok(()),
    }
}

pub(super) fn check_end(start_ms: i64, end_ms: i64) -> Result<(), StoreError> {
    check_time("end_ms", end_ms)?;
    match end_ms.checked_sub(start_ms) {
        Some(0..=MAX_ACTIVITY_MS) => Ok(()),
        _ => Err(StoreError::invalid(
            "end_ms",
            "a time from the start to one day later",
            end_ms,
        )),
    }
}

pub(crate) fn check_time(field: &'static str, ms: i64) -> Result<(), StoreError> {
    match ms {
        0..=MAX_TIME_MS => Ok(()),
        _ => Err(StoreError::invalid(
            field,
            "milliseconds since 1970, up to the year 9999",
            ms,
        )),
    }
}

fn check_text(field: &'static str, text: &str, max_bytes: usize) -> Result<(), StoreError> {
    if text.len() > max_bytes {
        return Err(StoreError::invalid(
            field,
            "a shorter text",
            format!("{} bytes", text.len()),
        ));
    }
    if text.contains(char::is_control) {
        return Err(StoreError::invalid(
            field,
            "a text without control characters",
            text,
        ));
    }
    Ok(())
}
