//! Recorded bytes and radar descriptions from outside: bytes in, no sockets, no files.
//!
//! What enters is text or bytes that anybody may have written; what leaves is a
//! [`radarllm_base::RadarConfig`] that can exist, recorded points, or cubes, or an error that names the
//! place. Nothing here panics on its input or allocates by a number found in it.
//!
//! Reading order: [`ti_cfg`] (chirp files of TI's SDK), [`boards`] (where antennas are),
//! [`radar_toml`] (our own format), [`span`] (places in both), [`builtin`], [`mod@lint`], [`calibration`] (channel gains);
//! [`adc`] (raw samples), [`dca1000`] and [`pcap`] (packets of them); [`recordings`] and [`tables`] (others' points),
//! [`uart`] (what a board sends), [`mod@detect`] (which of them a file is), [`mounting`] (into the
//! project's axes).

pub mod adc;
pub mod boards;
pub mod builtin;
pub mod calibration;
pub mod dca1000;
pub mod detect;
pub mod lint;
pub mod mounting;
pub mod pcap;
pub mod radar_toml;
pub mod recordings;
pub mod span;
pub mod tables;
pub mod ti_cfg;
pub mod uart;

pub use adc::{
    AdcError, AdcReader, CubeShape, FrameDecoder, FrameSource, SampleLayout, check_capture,
};
pub use boards::Board;
pub use builtin::{BUILTIN_NAMES, builtin_radar, builtin_radars};
pub use calibration::{CalibratedChannel, Calibration, CalibrationError};
pub use detect::{DetectError, Detected, Format, detect};
pub use lint::{Finding, ModelExpectations, Severity, lint, lint_radar_toml, lint_ti_cfg};
pub use mounting::Mounting;
pub use radar_toml::{RadarTomlError, radar_from_toml, radar_to_toml};
pub use recordings::{RecordingError, read_mars_points, read_radhar_points};
pub use span::Span;
pub use ti_cfg::{TiCfg, TiCfgError, radar_from_ti_cfg};
pub use uart::{UartError, UartParser, UartReport};
