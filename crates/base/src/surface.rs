//! The simulator's view of the world: moving triangle meshes.

use glam::Vec3;

/// How a surface scatters at millimetre waves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Power reflection coefficient at normal incidence, |Gamma|^2, in 0..=1.
    pub power_reflection: f32,
    /// Rms height of the surface's small-scale roughness, m; reduces the coherent part.
    pub roughness_m: f32,
    /// Strength rho of the rough (incoherent, body-locked) term sigma = 4 rho A cos^2(theta).
    pub rough_albedo: f32,
    /// One-way power transmission coefficient of the surface, in 0..=1; 0 is opaque. The sum of this value and
    /// [`Self::power_reflection`] must not exceed 1.
    pub power_transmission: f32,
}

impl Material {
    /// Perfect smooth conductor, for which the closed forms of physical optics hold.
    pub const PEC: Material = Material {
        power_reflection: 1.0,
        roughness_m: 0.0,
        rough_albedo: 0.0,
        power_transmission: 0.0,
    };
}

/// A moving triangle mesh. The simulator has no information about what it depicts.
pub trait MovingSurface: Sync {
    /// Vertex indices, counter-clockwise seen from outside. Constant over time.
    fn triangles(&self) -> &[[u32; 3]];
    /// Number of vertices.
    fn n_vertices(&self) -> usize;
    /// Writes vertex positions in the radar frame, m, at `time_s`; `out.len() == n_vertices()`.
    fn positions_at(&self, time_s: f64, out: &mut [Vec3]);
    /// [`Self::positions_at`] for several times at once, `out[i]` at `times_s[i]`. Surfaces that read large tables for
    /// every pose override this method to read them once. The results are the same.
    fn positions_at_times(&self, times_s: &[f64], out: &mut [&mut [Vec3]]) {
        for (&time_s, out) in times_s.iter().zip(out) {
            self.positions_at(time_s, out);
        }
    }
    /// Whether the vertices are in the same places at all times. What the simulator computes of such surfaces is kept from
    /// frame to frame.
    fn is_still(&self) -> bool {
        false
    }
    /// One material for the whole surface.
    fn material(&self) -> Material;
}
