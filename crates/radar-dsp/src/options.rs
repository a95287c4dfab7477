//! Options of the signal chain, with their defaults.

use crate::{capon::CaponDetection, window::Window};

/// How the channels (twelve for the reference radar) are combined into one detection map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum MapKind {
    /// D = sum over channels of |.|^2: all directions have equal weight.
    NonCoherent,
    /// D = |sum over channels of the complex values|, as in mmMesh and the RadarLLM paper. This is a beam at boresight:
    /// for the reference radar the gain is -5.6 dB at 10 degrees, with a null near 30.
    Coherent,
    /// ln D = mean over channels of ln |.|^2, the geometric mean of the powers. The detection matrices of TI's demos,
    /// which add log2 magnitudes, are of this kind. Requires [`Detector::LogCfar`] or [`Detector::AlwaysTopK`], whose
    /// thresholds do not assume a sum of powers.
    MeanLog,
}

/// The training cells of [`Detector::LogCfar`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum CfarSides {
    /// Mean of both sides.
    Both,
    /// The larger of the two sides' means: fewer false alarms at the edge of clutter.
    Greater,
    /// The smaller of the two sides' means: a second target on one side does not mask the first.
    Smaller,
}

/// Which cells of the detection map become points; never more than [`DspOptions::max_points`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(
    feature = "serde",
    serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)
)]
pub enum Detector {
    /// The strongest cells without a threshold. A scene without targets yields a full frame of noise.
    #[cfg_attr(feature = "serde", serde(rename = "top_k"))]
    AlwaysTopK,
    /// Cells above a threshold over the frame's own noise floor. The floor is the median of the map, converted to the
    /// mean by the exact distribution of a sum of exponentials. The threshold is the level that noise alone exceeds in
    /// `false_alarms_per_frame` cells of the gated map, on average.
    NoiseFloor {
        /// Expected number of noise cells per frame, > 0.
        false_alarms_per_frame: f64,
    },
    /// Cell-averaging CFAR along range.
    CaCfar {
        /// Guard cells on each side.
        guard: usize,
        /// Training cells on each side.
        train: usize,
        /// Probability that a noise cell passes, in (0, 0.5).
        false_alarm_probability: f64,
    },
    /// Ordered-statistic CFAR along range: robust if there is another target among the training cells.
    OsCfar {
        /// Guard cells on each side.
        guard: usize,
        /// Training cells on each side.
        train: usize,
        /// Which ordered value estimates the noise, as a fraction of the training cells, in (0, 1].
        /// 0.75 is Rohling's choice.
        rank: f64,
        /// Probability that a noise cell passes, in (0, 0.5).
        false_alarm_probability: f64,
    },
    /// CFAR along range over the *logarithms* of the map with a fixed threshold, as in the accelerators of TI's parts.
    /// A cell is detected if its decibels exceed the mean decibels of the training cells by more than `threshold_db`.
    LogCfar {
        /// Guard cells on each side.
        guard: usize,
        /// Training cells on each side.
        train: usize,
        /// How the two sides are combined.
        sides: CfarSides,
        /// Threshold over the mean of the training cells, dB, positive.
        threshold_db: f64,
    },
}

/// A second CFAR of detected cells, along Doppler, which is cyclic, over the logarithms of the map. Firmware of TI's
/// SDK passes cells through both.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct DopplerCfar {
    /// Guard cells on each side.
    pub guard: usize,
    /// Training cells on each side.
    pub train: usize,
    /// Threshold over the mean of the training cells of both sides, dB, positive.
    pub threshold_db: f64,
}

/// The neighbours than which a detected cell must not be weaker. Firmware uses this to keep one point per local maximum
/// of the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum PeakGrouping {
    /// No peak grouping: every cell above the threshold is a point.
    Off,
    /// The two neighbours in range.
    Range,
    /// The two neighbours in Doppler, which is cyclic.
    Doppler,
    /// All eight neighbours.
    Both,
}

/// How clutter is removed: static echoes from each (tx, rx, range) before the Doppler window, or what all receivers have in
/// common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum ClutterFilter {
    /// Keep static echoes: the zero-Doppler column contains the background.
    Off,
    /// Subtract the slow-time mean, as in mmMesh. Exact for static targets. A moving target n Doppler bins from zero
    /// leaves a ghost near zero velocity, with up to 1 / (pi n) of its amplitude (-32 dB at 1 m/s with the reference
    /// radar).
    Mean,
    /// Subtract the mean weighted by the Doppler window. Also exact for static targets. The ghost is only the window's
    /// sidelobe (under -42 dB), but targets one bin from zero lose 1.8 dB.
    WeightedMean,
    /// Subtract the mean over the receivers of a transmitter from each cell of the range-Doppler spectra: the formula that
    /// the RadarLLM paper prints. It removes no static echo as such, but echoes of any speed from the direction in which
    /// the receivers' phases are equal, and requires two receivers.
    ReceiverMean,
}

impl ClutterFilter {
    /// Whether static echoes are removed, whatever their direction.
    pub fn removes_static(self) -> bool {
        matches!(self, Self::Mean | Self::WeightedMean)
    }
}

/// Treatment of a cell whose estimated direction cosines cannot belong to a unit vector with y >= 0 (x^2 + z^2 > R^2).
/// Noise and two targets in one cell can cause this.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImpossibleDirection {
    /// Drop the cell and continue with the next strongest one.
    Drop,
    /// Scale (x, z) back onto the edge of the half space: y = 0.
    Clamp,
}

/// Options of [`crate::PointExtractor`].
#[derive(Clone, Debug, PartialEq)]
pub struct DspOptions {
    /// Detection map.
    pub map: MapKind,
    /// Cell selection.
    pub detector: Detector,
    /// Maximum number of points per frame; the paper's value is 128.
    pub max_points: usize,
    /// Maximum difference to the frame's strongest cell, dB. Weaker cells are dropped. The default is just inside the
    /// -42.7 dB sidelobes of a Hamming window. Without this limit, one strong reflector fills the frame with its own
    /// sidelobes. `None` keeps all cells. Ignored by [`Detector::AlwaysTopK`].
    pub dynamic_range_db: Option<f64>,
    /// Weights of a chirp's samples.
    pub range_window: Window,
    /// Weights of a frame's loops.
    pub doppler_window: Window,
    /// Length of the range FFT. Samples are zero-padded to it, so that bins are closer than the resolution, as in
    /// firmware with power-of-two FFTs. `None` selects the number of samples.
    pub range_fft_len: Option<usize>,
    /// Minimum range, m.
    pub min_range_m: f64,
    /// Maximum range, m. The radar's own maximum applies if it is smaller.
    pub max_range_m: f64,
    /// Clutter removal (static echoes).
    pub clutter: ClutterFilter,
    /// Whether to apply TDM compensation, which removes the phase that a moving target accumulates between slots.
    /// `false` exists to demonstrate the error.
    pub compensate_tdm: bool,
    /// Refine the azimuth peak between FFT bins with a parabola through the log power.
    pub refine_azimuth: bool,
    /// Step of the azimuth spectrum's amplitudes in fixed-point firmware, per row element, as intensity: dB relative to
    /// one squared sample unit after unnormalised FFTs. Amplitudes are truncated to whole steps before the peak search.
    /// Of equal amplitudes, the first one is selected in the order from boresight to the right, then from the left edge
    /// inwards. Weak cells therefore accumulate on boresight. `None` selects floating point.
    pub azimuth_step_db: Option<f64>,
    /// Subtract the beat frequency's Doppler part from the range: v * carrier / slope, 1.3 mm per m/s for the reference
    /// radar. This is exact for constant velocity. Without it, ranges are bin centres.
    pub correct_range_doppler_coupling: bool,
    /// Second CFAR of the detected cells, along Doppler.
    pub doppler_cfar: Option<DopplerCfar>,
    /// Keep only cells that are not weaker than their neighbours.
    pub peak_grouping: PeakGrouping,
    /// Cells with impossible directions.
    pub impossible_direction: ImpossibleDirection,
    /// Detection on a Capon map of range and azimuth instead of the range-Doppler map. Map, detector, passes after it,
    /// peak grouping and the options of the angle estimation other than `compensate_tdm` are then ignored.
    pub capon: Option<CaponDetection>,
}

impl Default for DspOptions {
    fn default() -> Self {
        Self {
            map: MapKind::NonCoherent,
            detector: Detector::NoiseFloor {
                false_alarms_per_frame: 1.0,
            },
            max_points: 128,
            dynamic_range_db: Some(40.0),
            range_window: Window::Hamming,
            doppler_window: Window::Hamming,
            range_fft_len: None,
            min_range_m: 0.3,
            max_range_m: 10.5,
            clutter: ClutterFilter::Mean,
            compensate_tdm: true,
            refine_azimuth: true,
            azimuth_step_db: None,
            correct_range_doppler_coupling: true,
            doppler_cfar: None,
            peak_grouping: PeakGrouping::Off,
            impossible_direction: ImpossibleDirection::Drop,
            capon: None,
        }
    }
}

impl DspOptions {
    /// mmMesh's chain, which the RadarLLM paper follows: coherent map, always the 128 strongest cells, and angles and
    /// ranges at bin centres.
    pub fn mmmesh() -> Self {
        Self {
            map: MapKind::Coherent,
            detector: Detector::AlwaysTopK,
            dynamic_range_db: None,
            refine_azimuth: false,
            correct_range_doppler_coupling: false,
            ..Self::default()
        }
    }

    /// The chain as the RadarLLM paper prints it: the mean over the receivers is subtracted from the range-Doppler spectra,
    /// and the 128 strongest cells of what remains are points, with angles and ranges at bin centres. The channels are
    /// combined by their powers, because the sum of values from which their mean was subtracted is zero. Angles are
    /// estimated as in the other chains: those that the paper prints are functions of the velocity.
    pub fn paper() -> Self {
        Self {
            map: MapKind::NonCoherent,
            clutter: ClutterFilter::ReceiverMean,
            ..Self::mmmesh()
        }
    }

    /// The chain of TI's out-of-box demos on xWR14xx parts: Blackman window in range, Hann window in Doppler, mean of
    /// logarithms over the channels, CFAR along range in the log domain (8 training cells after 4 guard cells, the
    /// smaller side, 15 dB), angles and ranges at bin centres, range FFT padded to a power of two. Peak grouping is off
    /// and static clutter is removed; commands of the demos set both.
    pub fn ti_demo(n_samples: usize) -> Self {
        Self {
            map: MapKind::MeanLog,
            detector: Detector::LogCfar {
                guard: 4,
                train: 8,
                sides: CfarSides::Smaller,
                threshold_db: 15.0,
            },
            dynamic_range_db: None,
            range_window: Window::Blackman,
            doppler_window: Window::Hann,
            range_fft_len: Some(n_samples.next_power_of_two()),
            refine_azimuth: false,
            correct_range_doppler_coupling: false,
            ..Self::default()
        }
    }
}
