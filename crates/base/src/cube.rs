//! Raw samples of one radar frame.

use num_complex::Complex32;

/// Complex IF samples of one frame, `[loop, tx, rx, sample]`, sample fastest.
///
/// `tx` is the firing slot ([`crate::radar_config::TxMultiplexing`]). Simulated and captured cubes have the same type,
/// so that no later stage can distinguish them. The unit is the square root of watts at the receiver input for
/// simulated cubes, and ADC counts for captures.
#[derive(Clone, Debug, PartialEq)]
pub struct RadarCube {
    /// Doppler loops.
    pub n_loops: usize,
    /// Number of firing slots, equal to the number of transmitters.
    pub n_tx: usize,
    /// Receivers.
    pub n_rx: usize,
    /// Fast-time samples.
    pub n_samples: usize,
    /// Time of the frame's first chirp, s.
    pub time_s: f64,
    /// `n_loops * n_tx * n_rx * n_samples` values.
    pub data: Vec<Complex32>,
}

impl RadarCube {
    /// A cube of zeros.
    pub fn zeros(n_loops: usize, n_tx: usize, n_rx: usize, n_samples: usize) -> Self {
        let data = vec![Complex32::ZERO; n_loops * n_tx * n_rx * n_samples];
        Self {
            n_loops,
            n_tx,
            n_rx,
            n_samples,
            time_s: 0.0,
            data,
        }
    }

    /// The samples of one chirp at one receiver.
    pub fn chirp(&self, loop_idx: usize, tx_idx: usize, rx_idx: usize) -> &[Complex32] {
        let start = ((loop_idx * self.n_tx + tx_idx) * self.n_rx + rx_idx) * self.n_samples;
        &self.data[start..start + self.n_samples]
    }
}
