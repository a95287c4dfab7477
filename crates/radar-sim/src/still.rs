//! The surfaces that stand still, computed once.
//!
//! Walls and furniture return the same samples in every chirp of every frame, but for what a person hides or mirrors. Their
//! samples are therefore computed for one loop without the moving surfaces, kept, and added to every loop. A frame then
//! consists of the moving surfaces and of differences: facets that are hidden now and paths that are interrupted are taken
//! away by sources of negative amplitude, and what remains of them is added.
//!
//! What is kept depends only on the surfaces that stand still, not on the frame that came first, so that frames may be
//! simulated in any order.

use std::ops::Range;

use glam::Vec3;
use radarllm_base::Material;
use radarllm_simd::Cell;

use crate::bounce::{StillBase, StillPaths};
use crate::scene::Scene;
use crate::visibility::ScreenTransmission;

/// Everything on which the kept results depend, apart from the simulator's own plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct StillKey {
    seed: u64,
    /// Which surfaces stand still.
    pub still: Vec<bool>,
    /// Of every surface: its number of vertices, and its material.
    surfaces: Vec<(usize, Material)>,
    /// Of all surfaces.
    triangles: Vec<[u32; 3]>,
    /// Of the surfaces that stand still.
    positions: Vec<Vec3>,
}

impl StillKey {
    /// `None` if nothing stands still.
    pub(crate) fn new(
        scene: &Scene<'_>,
        triangles: &[[u32; 3]],
        positions: &[Vec3],
        seed: u64,
    ) -> Option<Self> {
        let any = (scene.surfaces.iter()).any(|s| s.is_still() && !s.triangles().is_empty());
        any.then(|| {
            let surfaces = scene.surfaces.iter();
            let mut key = Self {
                seed,
                still: surfaces.clone().map(|s| s.is_still()).collect(),
                surfaces: surfaces.map(|s| (s.n_vertices(), s.material())).collect(),
                triangles: triangles.to_vec(),
                positions: Vec::new(),
            };
            for part in key.still_parts(positions) {
                key.positions.extend_from_slice(part);
            }
            key
        })
    }

    /// Whether the same surfaces stand still in the same places; compares without copies.
    pub(crate) fn is_of(
        &self,
        scene: &Scene<'_>,
        triangles: &[[u32; 3]],
        positions: &[Vec3],
        seed: u64,
    ) -> bool {
        let surfaces = scene.surfaces.iter();
        if self.seed != seed
            || !(surfaces.clone().map(|s| s.is_still())).eq(self.still.iter().copied())
            || !(surfaces.map(|s| (s.n_vertices(), s.material()))).eq(self.surfaces.iter().copied())
            || self.triangles != triangles
        {
            return false;
        }
        let mut rest = &self.positions[..];
        self.still_parts(positions).iter().all(|part| {
            let (mine, later) = rest.split_at(part.len());
            rest = later;
            mine == *part
        })
    }

    fn still_parts<'a>(&self, positions: &'a [Vec3]) -> Vec<&'a [Vec3]> {
        let mut first = 0;
        let mut parts = Vec::new();
        for (&(n_vertices, _), &still) in self.surfaces.iter().zip(&self.still) {
            if still {
                parts.push(&positions[first..first + n_vertices]);
            }
            first += n_vertices;
        }
        parts
    }
}

/// What is kept of the surfaces that stand still. Facets and vertices are numbered as in the whole scene.
pub(crate) struct Still {
    pub key: StillKey,
    /// Visible share of every facet without the moving surfaces; 0 for theirs.
    pub coverage: Vec<f32>,
    pub transmission: ScreenTransmission,
    /// `None` if all bounces are traced in every frame.
    pub paths: Option<StillPaths>,
    pub n_bounces: usize,
    /// Visible facets that are too coarse.
    pub n_coarse: usize,
    /// Samples of every block of channels, `[lane][sample / 16]`.
    pub samples: Vec<Vec<Cell>>,
}

impl Still {
    /// Facets of one surface, counted from its first, of which more or less is seen than is kept.
    pub(crate) fn changed<'a>(
        &'a self,
        coverage: &'a [f32],
        transmission: &'a ScreenTransmission,
        facets: Range<usize>,
    ) -> impl Iterator<Item = u32> + use<'a> {
        let first = facets.start;
        let changed = facets.filter(move |&i| {
            self.coverage[i] != coverage[i]
                || self.transmission.amplitude(i) != transmission.amplitude(i)
        });
        changed.map(move |i| (i - first) as u32)
    }

    pub(crate) fn base(&self) -> Option<StillBase<'_>> {
        self.paths.as_ref().map(|paths| StillBase {
            paths,
            n_bounces: self.n_bounces,
            coverage: &self.coverage,
            transmission: &self.transmission,
        })
    }
}
