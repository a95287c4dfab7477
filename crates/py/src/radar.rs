//! `Radar`.

use std::path::PathBuf;

use pyo3::{prelude::*, types::PyDict};
use radarllm::{OpenedRadar, RadarConfig, open_radar};

use crate::errors;

/// A radar: its chirps, antennas and frame rate.
///
/// `Radar("awr1843boost")` is a built-in radar (`radarllm radar list` names them); `Radar("profile.cfg")` reads TI's chirp
/// configuration, a `.json` of mmWave Studio or a `.toml` of this project. A chirp configuration that describes no cube is
/// an error here; points are read with the name of its file.
///
/// >>> radar = Radar("awr1843boost")
/// >>> radar.frame_rate_hz
/// 10.0
/// >>> radar.cube_shape
/// (128, 3, 4, 256)
#[pyclass(frozen, name = "Radar", module = "radarllm")]
pub struct PyRadar {
    pub opened: OpenedRadar,
    config: RadarConfig,
}

impl PyRadar {
    fn config(&self) -> &RadarConfig {
        &self.config
    }
}

#[pymethods]
impl PyRadar {
    #[new]
    fn new(name_or_file: PathBuf) -> PyResult<Self> {
        let opened = open_radar(&name_or_file.to_string_lossy()).map_err(errors::to_py)?;
        let config = opened.config().map_err(errors::to_py)?.clone();
        Ok(Self { opened, config })
    }

    /// Name in reports.
    #[getter]
    fn name(&self) -> &str {
        &self.config().name
    }

    /// Frames per second, Hz.
    #[getter]
    fn frame_rate_hz(&self) -> f64 {
        self.config().frame_rate_hz()
    }

    /// Width of a range bin, m.
    #[getter]
    fn range_resolution_m(&self) -> f64 {
        self.config().range_resolution_m()
    }

    /// End of the last range bin, m.
    #[getter]
    fn max_range_m(&self) -> f64 {
        self.config().max_range_m()
    }

    /// Width of a Doppler bin, m/s.
    #[getter]
    fn velocity_resolution_mps(&self) -> f64 {
        self.config().velocity_resolution_mps()
    }

    /// Unambiguous radial speed, m/s.
    #[getter]
    fn max_velocity_mps(&self) -> f64 {
        self.config().max_velocity_mps()
    }

    /// Shape of a frame of raw samples: (loops, transmitter slots, receivers, samples).
    #[getter]
    fn cube_shape(&self) -> (usize, usize, usize, usize) {
        let radar = self.config();
        (
            radar.n_loops,
            radar.tx.len(),
            radar.rx.len(),
            radar.n_samples,
        )
    }

    /// All values, in SI units: Hz, Hz/s, s, m, rad, dBm, dBi, dB. Antennas are (x, z) in m.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let radar = self.config();
        let antennas = |list: &[radarllm_base::radar_config::Antenna]| -> Vec<(f64, f64)> {
            list.iter().map(|a| (a.x_m, a.z_m)).collect()
        };
        let out = PyDict::new(py);
        out.set_item("name", &radar.name)?;
        out.set_item("start_hz", radar.start_hz)?;
        out.set_item("slope_hz_per_s", radar.slope_hz_per_s)?;
        out.set_item("idle_s", radar.idle_s)?;
        out.set_item("adc_start_s", radar.adc_start_s)?;
        out.set_item("ramp_end_s", radar.ramp_end_s)?;
        out.set_item("n_samples", radar.n_samples)?;
        out.set_item("sample_rate_hz", radar.sample_rate_hz)?;
        out.set_item("n_loops", radar.n_loops)?;
        out.set_item("frame_period_s", radar.frame_period_s)?;
        out.set_item("tx", antennas(&radar.tx))?;
        out.set_item("rx", antennas(&radar.rx))?;
        let multiplexing = match radar.multiplexing {
            radarllm_base::radar_config::TxMultiplexing::Tdm => "tdm",
            radarllm_base::radar_config::TxMultiplexing::Bpm => "bpm",
        };
        out.set_item("firing", multiplexing)?;
        out.set_item("tx_power_dbm", radar.tx_power_dbm)?;
        out.set_item("antenna_gain_dbi", radar.antenna_gain_dbi)?;
        out.set_item("azimuth_half_width_rad", radar.azimuth_half_width_rad)?;
        out.set_item("elevation_half_width_rad", radar.elevation_half_width_rad)?;
        out.set_item("noise_figure_db", radar.noise_figure_db)?;
        Ok(out)
    }

    fn __repr__(&self) -> String {
        let (loops, tx, rx, samples) = self.cube_shape();
        format!(
            "Radar({:?}: {loops} loops, {tx} slots, {rx} receivers, {samples} samples, {} Hz)",
            self.name(),
            self.frame_rate_hz()
        )
    }
}

/// A radar as an argument: a `Radar`, a built-in name or a file.
pub(crate) struct RadarArgument(pub OpenedRadar);

impl<'py> FromPyObject<'_, 'py> for RadarArgument {
    type Error = PyErr;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(radar) = value.cast::<PyRadar>() {
            return Ok(Self(radar.get().opened.clone()));
        }
        let name: PathBuf = value.extract()?;
        let opened = open_radar(&name.to_string_lossy()).map_err(errors::to_py)?;
        Ok(Self(opened))
    }
}
