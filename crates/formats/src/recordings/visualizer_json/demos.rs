//! What TI's visualizer does with the points of its demos before it stores them.
//!
//! Source: the Applications Visualizer of TI's Radar Toolbox, in the copy of kirtirajsinhparmar1's
//! "Multi-Person-Tracking-Posture-Sensing-and-Vital-Sign-Monitoring-via-mmWave-Radar-" at 0bf9ba3 (`ti_style_vendor/common`):
//!
//! - `demo_defines.py` has the names, and `gui_core.py` the class that displays each;
//! - `plot_3d.py` (`updatePointCloud`) and `people_tracking_6844.py` turn the points by the tilts of `sensorPosition` and
//!   add its height, in place, in the array that is stored afterwards. All classes that inherit from them do so;
//! - `parseTLVs.py` fills the SNR: compressed points (TLV 1020 and 3001) have a ratio and no noise, side information
//!   (TLV 7) and points of the low-power boards (TLV 301) have dB, with a noise beside it.

/// Unit of the SNR in the files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SnrUnit {
    /// A linear ratio.
    Ratio,
    /// Decibels.
    Decibels,
}

/// Unit of the SNR of a demo.
#[derive(Clone, Copy)]
enum Snr {
    /// A ratio on every device.
    Ratio,
    /// A ratio, and decibels on low-power devices.
    RatioOrLowPower,
    /// A ratio unless there is noise beside it, and decibels on low-power devices.
    ByNoiseOrLowPower,
    /// Decibels on every device.
    Decibels,
}

/// A demo of the visualizer.
pub(super) struct Demo {
    name: &'static str,
    /// Whether the visualizer turns and raises its points by `sensorPosition`.
    pub levels: bool,
    snr: Snr,
}

const fn demo(name: &'static str, levels: bool, snr: Snr) -> Demo {
    Demo { name, levels, snr }
}

/// Demos whose display is known. Others are named in a warning.
const DEMOS: [Demo; 18] = [
    demo("3D People Tracking", true, Snr::RatioOrLowPower),
    demo("3D People Tracking 6844", true, Snr::Ratio),
    demo(
        "Vital Signs with People Tracking",
        true,
        Snr::RatioOrLowPower,
    ),
    demo("Long Range People Detection", true, Snr::ByNoiseOrLowPower),
    demo("Mobile Tracker", true, Snr::ByNoiseOrLowPower),
    demo("Small Obstacle Detection", true, Snr::ByNoiseOrLowPower),
    demo("Exterior Intrusion Monitoring", true, Snr::Decibels),
    demo("x843 Out of Box Demo", true, Snr::Decibels),
    demo("x432 Out of Box Demo", true, Snr::Decibels),
    demo("x844 Out of Box Demo", true, Snr::Decibels),
    demo("Point Cloud Classification", true, Snr::Decibels),
    demo("Sleep Monitoring", true, Snr::Decibels),
    // Without a view in three dimensions.
    demo("Level Sensing", false, Snr::Decibels),
    demo("True Ground Speed", false, Snr::Decibels),
    demo("Kick to Open", false, Snr::Decibels),
    demo("Calibration", false, Snr::Decibels),
    demo("Intruder Detection", false, Snr::Decibels),
    demo("Debug Plots", false, Snr::Decibels),
];

impl Demo {
    /// The demo of this name, if it is known.
    pub(super) fn named(name: &str) -> Option<&'static Self> {
        DEMOS.iter().find(|demo| demo.name == name)
    }

    /// Unit of the SNR on a device; `None` if the name does not tell it.
    pub(super) fn snr_unit(&self, device: Option<&str>) -> Option<SnrUnit> {
        let is_low_power = device.is_some_and(|d| d.to_ascii_uppercase().contains("WRL"));
        match (self.snr, is_low_power) {
            (Snr::Decibels, _) | (Snr::RatioOrLowPower | Snr::ByNoiseOrLowPower, true) => {
                Some(SnrUnit::Decibels)
            }
            (Snr::Ratio, _) | (Snr::RatioOrLowPower, false) => Some(SnrUnit::Ratio),
            (Snr::ByNoiseOrLowPower, false) => None,
        }
    }
}
