//! Parsers for all external input: chirp files and radars, raw samples, packets, and recorded points.
//!
//! This crate opens no file, port or socket. A function takes untrusted text or bytes, and names of files where these
//! matter. It returns a [`radarllm_base::RadarConfig`], cubes of samples or recorded points, or an error that names the
//! position. No input makes it panic, and no number found in an input determines an allocation.
//!
//! Reads the chirp file of TI's SDK and computes its range resolution:
//!
//! ```
//! let text = "% Platform:xWR18xx
//! channelCfg 15 5 0
//! adcCfg 2 1
//! profileCfg 0 77 7 6 65 0 0 60.012 1 256 4400 0 0 30
//! chirpCfg 0 0 0 0 0 0 0 1
//! chirpCfg 1 1 0 0 0 0 0 4
//! frameCfg 0 1 64 0 100 1 0";
//! let cfg = radarllm_formats::TiCfg::parse(text, None)?;
//! println!("range resolution {:.3} m", cfg.radar.range_resolution_m());
//! assert_eq!(cfg.slots, [1, 3]);
//! assert!((cfg.radar.range_resolution_m() - 0.0429).abs() < 1e-4);
//! # Ok::<(), radarllm_formats::TiCfgError>(())
//! ```
//!
//! Reads the points of a UART stream, whose dialect is detected from its first packets:
//!
//! ```
//! use radarllm_formats::uart::{MAGIC, UartParser, recorded_frames};
//!
//! // One packet: a header of 40 bytes, a TLV of type 1 with one point, padding to 96 bytes.
//! let mut packet = MAGIC.to_vec();
//! for word in [0x0306_0000_u32, 96, 0xA6843, 7, 0, 1, 1, 0, 1, 16] {
//!     packet.extend(word.to_le_bytes());
//! }
//! for value in [0.5_f32, 2.0, 0.25, -1.0] {
//!     packet.extend(value.to_le_bytes());
//! }
//! packet.resize(96, 0);
//!
//! let mut parser = UartParser::new(None);
//! let mut packets = parser.push(&packet)?;
//! let (last, report, _) = parser.finish()?;
//! packets.extend(last);
//! let frames = recorded_frames(packets);
//! assert_eq!((frames[0].number, frames[0].points[0].y_m), (7, 2.0));
//! assert_eq!((report.packets, report.skipped_bytes), (1, 0));
//! # Ok::<(), radarllm_formats::UartError>(())
//! ```
//!
//! Reads the points of a table, whose columns are found by their names:
//!
//! ```
//! use radarllm_formats::{recordings::Axes, tables::read_points_csv};
//!
//! let table = "frame,t_s,x,y,z,velocity,intensity\n0,0.0,0.5,2.0,0.0,0.25,20\n1,0.1,0.5,2.1,0.0,0.25,20\n";
//! let frames = read_points_csv(table, Axes::RightForwardUp, None)?.frames;
//! assert_eq!((frames.len(), frames[1].stamp_s), (2, Some(0.1)));
//! # Ok::<(), radarllm_formats::RecordingError>(())
//! ```
//!
//! Modules by input:
//!
//! | to parse | modules |
//! |---|---|
//! | a radar | [`ti_cfg`] (chirp files of TI's SDKs), [`point_radar`] (what points need of one), [`ti_detection`] (their on-chip detection), [`radar_toml`] (the project's format), [`builtin`] (by name), [`boards`] (places of antennas), [`mod@lint`] (errors and warnings), [`span`] (places in files) |
//! | how it is mounted and calibrated | [`sensor_position`], [`mounting`] (into the project's axes), [`calibration`] (channel gains) |
//! | raw samples | [`adc`], [`dca1000`] and [`pcap`] (packets) |
//! | recorded points | [`recordings`] (data sets, bags, visualizers, MATLAB), [`tables`] (CSV, npy), [`uart`] (what a board sends) |
//! | an unknown file or folder | [`mod@detect`], [`folder`] |

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod adc;
pub mod boards;
pub mod builtin;
pub mod calibration;
pub mod dca1000;
pub mod detect;
pub mod folder;
pub mod lint;
mod low_power;
pub mod mounting;
pub mod pcap;
pub mod point_radar;
pub mod radar_toml;
pub mod recordings;
pub mod sensor_position;
pub mod span;
pub mod tables;
pub mod ti_cfg;
pub mod ti_detection;
pub mod uart;

pub use adc::{
    AdcError, AdcReader, CubeShape, FrameDecoder, FrameSource, SampleLayout, check_capture,
};
pub use boards::Board;
pub use builtin::{BUILTIN_NAMES, NameError, builtin_radar, builtin_radars, find_builtin};
pub use calibration::{CalibratedChannel, Calibration, CalibrationError};
pub use detect::{DetectError, Detected, RecordingFormat, SampleFormat, detect};
pub use folder::{CfgChoice, VisualizerFolder, choose_cfg, visualizer_folder};
pub use lint::{
    Finding, ModelExpectations, Severity, lint, lint_radar_toml, lint_ti_cfg, lint_ti_cfg_named,
};
pub use mounting::Mounting;
pub use point_radar::{ChirpDialect, PointRadar};
pub use radar_toml::{RadarTomlError, radar_from_toml, radar_to_toml};
pub use recordings::{RecordingError, read_mars_points, read_radhar_points};
pub use sensor_position::SensorPosition;
pub use span::Span;
pub use ti_cfg::{BoardEvidence, TiCfg, TiCfgError, radar_from_ti_cfg};
pub use ti_detection::{TiDetection, TiPeopleDetection};
pub use uart::{UartError, UartParser, UartReport};
