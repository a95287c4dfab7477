//! The implicit surface of the built-in body: a smooth union of lofts and ellipsoids.
//!
//! A [`Field`] is negative inside, positive outside and close to a signed distance (m) near the
//! surface. It is folded at x = 0: only the person's left half is described, so the surface is
//! mirror-symmetric by construction.

use glam::{Mat3, Vec3};

/// Number of stations per loft after resampling; linear interpolation between them is then
/// invisible.
const LOFT_SAMPLES: usize = 64;
/// Offset of the four samples used to compute a gradient, m.
const GRADIENT_STEP_M: f32 = 5e-4;

/// Smooth union of primitives, folded at x = 0.
pub(super) struct Field {
    primitives: Vec<Primitive>,
    /// Plane y = `floor_y` that cuts the solid from below, and the radius of the rounded rim, m.
    floor: Option<(f32, f32)>,
}

/// One solid of the union.
struct Primitive {
    shape: Shape,
    /// Width of the fillet towards all previously added primitives, m.
    blend_m: f32,
    /// Axis-aligned bounding box of the solid.
    low: Vec3,
    high: Vec3,
}

enum Shape {
    Ellipsoid {
        center: Vec3,
        local_from_world: Mat3,
        radii: Vec3,
    },
    Loft {
        origin: Vec3,
        local_from_world: Mat3,
        start: f32,
        end: f32,
        cap_start: f32,
        cap_end: f32,
        sections: Vec<Section>,
    },
}

/// Elliptical cross-section of a loft, in the loft's own axes (x width, y along, z depth), m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Section {
    /// Position along the axis.
    pub along: f32,
    /// Offset of the centre from the axis.
    pub center_x: f32,
    pub center_z: f32,
    /// Semi-axes.
    pub half_width: f32,
    pub half_depth: f32,
}

/// A table row: position along the axis, centre x, centre z, half width, half depth.
pub(super) fn section(
    along: f32,
    center_x: f32,
    center_z: f32,
    half_width: f32,
    half_depth: f32,
) -> Section {
    Section {
        along,
        center_x,
        center_z,
        half_width,
        half_depth,
    }
}

impl Field {
    #[cfg(test)]
    pub fn new() -> Self {
        Self {
            primitives: Vec::new(),
            floor: None,
        }
    }

    /// An empty union that will be cut flat at y = `floor_y`, with a rim rounded over `rim_m`.
    pub(super) fn with_floor(floor_y: f32, rim_m: f32) -> Self {
        Self {
            primitives: Vec::new(),
            floor: Some((floor_y, rim_m)),
        }
    }

    /// Adds an ellipsoid whose own axes are the columns of `world_from_local`.
    pub(super) fn ellipsoid(
        &mut self,
        center: Vec3,
        world_from_local: Mat3,
        radii: Vec3,
        blend_m: f32,
    ) {
        let extent = Vec3::new(
            (world_from_local.transpose().x_axis * radii).length(),
            (world_from_local.transpose().y_axis * radii).length(),
            (world_from_local.transpose().z_axis * radii).length(),
        );
        self.primitives.push(Primitive {
            shape: Shape::Ellipsoid {
                center,
                local_from_world: world_from_local.transpose(),
                radii,
            },
            blend_m,
            low: center - extent,
            high: center + extent,
        });
    }

    /// Adds a generalised cylinder: elliptical sections along local y, in order of `along`, closed
    /// by half-ellipsoid caps of the given lengths. Sections are joined by cubic curves.
    pub(super) fn loft(
        &mut self,
        origin: Vec3,
        world_from_local: Mat3,
        sections: &[Section],
        caps: [f32; 2],
        blend_m: f32,
    ) {
        let (start, end) = (sections[0].along, sections[sections.len() - 1].along);
        let resampled: Vec<Section> = (0..LOFT_SAMPLES)
            .map(|i| {
                interpolate(
                    sections,
                    start + (end - start) * i as f32 / (LOFT_SAMPLES - 1) as f32,
                )
            })
            .collect();
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for s in &resampled {
            for along in [s.along, start - caps[0], end + caps[1]] {
                for (sx, sz) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
                    let local = Vec3::new(
                        s.center_x + sx * s.half_width,
                        along,
                        s.center_z + sz * s.half_depth,
                    );
                    let corner = origin + world_from_local * local;
                    // The corners of the caps matter only next to the first and last section.
                    let is_cap = along != s.along;
                    if !is_cap || s.along == start || s.along == end {
                        low = low.min(corner);
                        high = high.max(corner);
                    }
                }
            }
        }
        self.primitives.push(Primitive {
            shape: Shape::Loft {
                origin,
                local_from_world: world_from_local.transpose(),
                start,
                end,
                cap_start: caps[0],
                cap_end: caps[1],
                sections: resampled,
            },
            blend_m,
            low,
            high,
        });
    }

    /// Approximate signed distance, m.
    pub(super) fn value(&self, point: Vec3) -> f32 {
        let p = Vec3::new(point.x.abs(), point.y, point.z);
        let mut value = f32::INFINITY;
        for primitive in &self.primitives {
            let outside = (primitive.low - p).max(p - primitive.high).max(Vec3::ZERO);
            let reach = value + primitive.blend_m;
            if reach > 0.0 && outside.length_squared() > reach * reach {
                continue;
            }
            value = smooth_min(value, primitive.shape.value(p), primitive.blend_m);
        }
        match self.floor {
            Some((floor_y, rim_m)) => -smooth_min(-value, p.y - floor_y, rim_m),
            None => value,
        }
    }

    /// Value and gradient at a point (tetrahedral differences: four evaluations for both).
    pub(super) fn value_and_gradient(&self, p: Vec3) -> (f32, Vec3) {
        const CORNERS: [Vec3; 4] = [
            Vec3::new(1.0, -1.0, -1.0),
            Vec3::new(-1.0, -1.0, 1.0),
            Vec3::new(-1.0, 1.0, -1.0),
            Vec3::new(1.0, 1.0, 1.0),
        ];
        let (mut mean, mut gradient) = (0.0, Vec3::ZERO);
        for corner in CORNERS {
            let value = self.value(p + corner * GRADIENT_STEP_M);
            mean += 0.25 * value;
            gradient += corner * value;
        }
        (mean, gradient / (4.0 * GRADIENT_STEP_M))
    }

    /// Boxes that together contain the whole surface, including both halves.
    pub(super) fn boxes(&self) -> impl Iterator<Item = (Vec3, Vec3)> + '_ {
        self.primitives.iter().flat_map(|p| {
            let margin = Vec3::splat(p.blend_m);
            let (low, high) = (p.low - margin, p.high + margin);
            [
                (low, high),
                (
                    Vec3::new(-high.x, low.y, low.z),
                    Vec3::new(-low.x, high.y, high.z),
                ),
            ]
        })
    }
}

impl Shape {
    fn value(&self, p: Vec3) -> f32 {
        match self {
            Shape::Ellipsoid {
                center,
                local_from_world,
                radii,
            } => ellipsoid_distance(*local_from_world * (p - *center), *radii),
            Shape::Loft {
                origin,
                local_from_world,
                start,
                end,
                cap_start,
                cap_end,
                sections,
            } => {
                let local = *local_from_world * (p - *origin);
                let along = local.y.clamp(*start, *end);
                let scaled = (along - start) / (end - start) * (LOFT_SAMPLES - 1) as f32;
                let i = (scaled as usize).min(LOFT_SAMPLES - 2);
                let t = scaled - i as f32;
                let (a, b) = (&sections[i], &sections[i + 1]);
                let mix = |x: f32, y: f32| x + (y - x) * t;
                let beyond = local.y - along;
                let cap = if beyond < 0.0 { *cap_start } else { *cap_end };
                let q = Vec3::new(
                    local.x - mix(a.center_x, b.center_x),
                    beyond,
                    local.z - mix(a.center_z, b.center_z),
                );
                ellipsoid_distance(
                    q,
                    Vec3::new(
                        mix(a.half_width, b.half_width),
                        cap,
                        mix(a.half_depth, b.half_depth),
                    ),
                )
            }
        }
    }
}

/// First-order distance to an axis-aligned ellipsoid at the origin.
fn ellipsoid_distance(p: Vec3, radii: Vec3) -> f32 {
    let q = p / radii;
    let k0 = q.length();
    let k1 = (q / radii).length();
    if k1 < 1e-4 {
        -radii.min_element()
    } else {
        k0 * (k0 - 1.0) / k1
    }
}

/// Polynomial smooth minimum (a fillet of width `k`).
fn smooth_min(a: f32, b: f32, k: f32) -> f32 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - 0.25 * h * h * k
}

/// Cubic Hermite interpolation of a table with finite-difference tangents. The tangents are limited
/// so that a semi-axis never overshoots the range of its two neighbours.
fn interpolate(sections: &[Section], along: f32) -> Section {
    let i = sections
        .windows(2)
        .position(|w| along <= w[1].along)
        .unwrap_or(sections.len() - 2);
    let column = |get: fn(&Section) -> f32| {
        let slope = |k: usize| {
            (get(&sections[k + 1]) - get(&sections[k]))
                / (sections[k + 1].along - sections[k].along)
        };
        let tangent = |k: usize| {
            if k == 0 || k + 1 == sections.len() {
                return slope(k.min(sections.len() - 2));
            }
            // Harmonic mean of the neighbouring slopes (Fritsch-Butland): monotone between rows.
            let (s0, s1) = (slope(k - 1), slope(k));
            if s0 * s1 <= 0.0 {
                0.0
            } else {
                2.0 * s0 * s1 / (s0 + s1)
            }
        };
        let h = sections[i + 1].along - sections[i].along;
        let t = ((along - sections[i].along) / h).clamp(0.0, 1.0);
        let (y0, y1, m0, m1) = (
            get(&sections[i]),
            get(&sections[i + 1]),
            tangent(i) * h,
            tangent(i + 1) * h,
        );
        let (t2, t3) = (t * t, t * t * t);
        (2.0 * t3 - 3.0 * t2 + 1.0) * y0
            + (t3 - 2.0 * t2 + t) * m0
            + (3.0 * t2 - 2.0 * t3) * y1
            + (t3 - t2) * m1
    };
    Section {
        along,
        center_x: column(|s| s.center_x),
        center_z: column(|s| s.center_z),
        half_width: column(|s| s.half_width),
        half_depth: column(|s| s.half_depth),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sphere_has_its_exact_distance_and_gradient() {
        let mut field = Field::new();
        field.ellipsoid(
            Vec3::new(0.5, 0.0, 0.0),
            Mat3::IDENTITY,
            Vec3::splat(0.1),
            0.02,
        );
        let (value, gradient) = field.value_and_gradient(Vec3::new(0.5, 0.0, 0.3));
        // Distances of 0.2 m in f32 over a step of 0.5 mm leave about 1e-4 in the gradient.
        assert!((value - 0.2).abs() < 1e-5);
        assert!((gradient - Vec3::Z).length() < 1e-3);
        assert_eq!(
            field.value(Vec3::new(-0.5, 0.0, 0.3)),
            field.value(Vec3::new(0.5, 0.0, 0.3))
        );
    }

    #[test]
    fn a_loft_passes_through_its_sections() {
        let mut field = Field::new();
        let rows = [
            section(0.0, 0.0, 0.0, 0.05, 0.05),
            section(0.2, 0.0, 0.01, 0.08, 0.06),
            section(0.4, 0.0, 0.0, 0.04, 0.04),
        ];
        field.loft(Vec3::X, Mat3::IDENTITY, &rows, [0.05, 0.05], 0.02);
        // 64 linear pieces over 0.4 m: the sagitta is below 0.1 mm.
        assert!(field.value(Vec3::new(1.08, 0.2, 0.01)).abs() < 1e-4);
        assert!(field.value(Vec3::new(1.0, 0.2, 0.07)).abs() < 1e-4);
        assert!(field.value(Vec3::new(1.0, -0.05, 0.0)).abs() < 1e-4);
    }

    #[test]
    fn skipping_far_primitives_changes_nothing() {
        let mut field = Field::new();
        for i in 0..6 {
            let center = Vec3::new(0.3 + 0.07 * i as f32, 0.02 * i as f32, 0.0);
            field.ellipsoid(center, Mat3::IDENTITY, Vec3::new(0.05, 0.06, 0.04), 0.02);
        }
        for i in 0..400 {
            let p = Vec3::new(0.2 + 0.0015 * i as f32, 0.05, 0.1 - 0.0005 * i as f32);
            let all = field.primitives.iter().fold(f32::INFINITY, |v, q| {
                smooth_min(v, q.shape.value(p), q.blend_m)
            });
            // Only values inside the fillet width matter for the surface.
            if all.abs() < 0.01 {
                assert!((field.value(p) - all).abs() < 1e-6);
            }
        }
    }
}
