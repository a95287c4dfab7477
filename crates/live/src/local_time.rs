//! The clock and the time zone of the computer.

/// The present time, milliseconds since 1970 in UTC.
pub fn now_ms() -> i64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    now.map_or(0, |d| i64::try_from(d.as_millis()).unwrap_or(i64::MAX))
}

/// Offset of the local time from UTC at a time, s east of Greenwich; 0 where the system does not know.
pub fn offset_s(utc_ms: i64) -> i32 {
    #[cfg(unix)]
    {
        let time: libc::time_t = utc_ms.div_euclid(1_000);
        // SAFETY: `tm` is plain data for which all zeros is a valid value.
        let mut local: libc::tm = unsafe { std::mem::zeroed() };
        // SAFETY: both pointers are valid during the call, and `localtime_r` keeps neither.
        let found = unsafe { libc::localtime_r(&time, &mut local) };
        match found.is_null() {
            true => 0,
            false => i32::try_from(local.tm_gmtoff).unwrap_or(0),
        }
    }
    #[cfg(not(unix))]
    {
        let _ = utc_ms;
        0
    }
}
