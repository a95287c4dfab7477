//! Triangulated solids that move as rigid bodies, for scenes and tests.

use glam::{DQuat, DVec3, Vec3};
use radarllm_base::{Material, MovingSurface};

/// A rigid mesh. At time t, vertex p is at `position_m + velocity_mps t + 1/2 acceleration t^2 + R(t) p`, where R is a
/// rotation of `angular_velocity` t about the mesh's origin, after `orientation`.
#[derive(Clone, Debug)]
pub struct RigidSurface {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// Scattering material.
    pub material: Material,
    /// Position of the mesh's origin at time 0, m.
    pub position_m: DVec3,
    /// Velocity at time 0, m/s.
    pub velocity_mps: DVec3,
    /// Constant acceleration, m/s^2.
    pub acceleration_mps2: DVec3,
    /// Orientation at time 0.
    pub orientation: DQuat,
    /// Rotation, rad/s about the vector's axis.
    pub angular_velocity: DVec3,
}

impl RigidSurface {
    /// Creates a perfectly conducting mesh at rest at the origin. Triangles are counter-clockwise seen from outside.
    pub fn new(vertices: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Self {
        Self {
            vertices,
            triangles,
            material: Material::PEC,
            position_m: DVec3::ZERO,
            velocity_mps: DVec3::ZERO,
            acceleration_mps2: DVec3::ZERO,
            orientation: DQuat::IDENTITY,
            angular_velocity: DVec3::ZERO,
        }
    }

    /// Returns the mesh with its origin at another position.
    pub fn at(self, position_m: DVec3) -> Self {
        Self { position_m, ..self }
    }

    /// Returns the mesh with another material.
    pub fn of(self, material: Material) -> Self {
        Self { material, ..self }
    }

    /// Returns the mesh with a constant velocity.
    pub fn moving(self, velocity_mps: DVec3) -> Self {
        Self {
            velocity_mps,
            ..self
        }
    }

    /// Returns the mesh with another orientation at time 0.
    pub fn turned(self, orientation: DQuat) -> Self {
        Self {
            orientation,
            ..self
        }
    }

    /// A sphere about the origin: latitude rings with edges of about `edge_m` or less.
    pub fn sphere(radius_m: f64, edge_m: f64) -> Self {
        Self::ellipsoid(DVec3::splat(radius_m), edge_m)
    }

    /// An ellipsoid with half axes `radii_m` about the origin. `edge_m` applies as for a sphere with the largest half
    /// axis.
    pub fn ellipsoid(radii_m: DVec3, edge_m: f64) -> Self {
        let rings = segments(std::f64::consts::PI * radii_m.max_element(), edge_m).max(4);
        let around = segments(std::f64::consts::TAU * radii_m.x.max(radii_m.y), edge_m).max(6);
        grid(rings, around, |s, t| {
            let (sin_polar, cos_polar) = (std::f64::consts::PI * s).sin_cos();
            let (sin, cos) = (std::f64::consts::TAU * t).sin_cos();
            radii_m * DVec3::new(sin_polar * cos, sin_polar * sin, cos_polar)
        })
    }

    /// An open cylinder (no caps) about the z axis, centred on the origin.
    pub fn cylinder(radius_m: f64, length_m: f64, edge_m: f64) -> Self {
        let around = segments(std::f64::consts::TAU * radius_m, edge_m).max(6);
        grid(segments(length_m, edge_m), around, |s, t| {
            let (sin, cos) = (std::f64::consts::TAU * t).sin_cos();
            DVec3::new(radius_m * cos, radius_m * sin, length_m * (0.5 - s))
        })
    }

    /// A plate in the xz plane, centred on the origin. Its outside faces -y (towards the radar).
    pub fn plate(width_m: f64, height_m: f64, edge_m: f64) -> Self {
        let (columns, rows) = (segments(width_m, edge_m), segments(height_m, edge_m));
        grid(rows, columns, |s, t| {
            DVec3::new(width_m * (t - 0.5), 0.0, height_m * (0.5 - s))
        })
    }

    /// A plate in the xz plane facing -y, over `x_m` and `z_m` (low, high). Its facets are finest around `foot` (x, z)
    /// and grow with the distance from it. This suits a wall: its specular reflection comes from the foot of the
    /// perpendicular from the radar, and its far parts scatter little.
    ///
    /// Edges are at most `finest_m`, or an eighth of the distance from the foot along their axis.
    pub fn graded_plate(x_m: [f64; 2], z_m: [f64; 2], foot: [f64; 2], finest_m: f64) -> Self {
        let (columns, rows) = (
            graded_lines(x_m, foot[0], finest_m),
            graded_lines(z_m, foot[1], finest_m),
        );
        let last = |lines: &[f64]| (lines.len() - 1) as f64;
        grid(rows.len() - 1, columns.len() - 1, |s, t| {
            let row = rows.len() - 1 - (s * last(&rows)).round() as usize;
            let column = (t * last(&columns)).round() as usize;
            DVec3::new(columns[column], 0.0, rows[row])
        })
    }

    /// A box centred on the origin. Its faces are plates with the given edge length.
    pub fn cuboid(size_m: DVec3, edge_m: f64) -> Self {
        use std::f64::consts::{FRAC_PI_2, PI};
        let mut all = Self::new(Vec::new(), Vec::new());
        for (turn, width, height, depth) in [
            (DQuat::IDENTITY, size_m.x, size_m.z, size_m.y),
            (DQuat::from_rotation_z(PI), size_m.x, size_m.z, size_m.y),
            (
                DQuat::from_rotation_z(FRAC_PI_2),
                size_m.y,
                size_m.z,
                size_m.x,
            ),
            (
                DQuat::from_rotation_z(-FRAC_PI_2),
                size_m.y,
                size_m.z,
                size_m.x,
            ),
            (
                DQuat::from_rotation_x(FRAC_PI_2),
                size_m.x,
                size_m.y,
                size_m.z,
            ),
            (
                DQuat::from_rotation_x(-FRAC_PI_2),
                size_m.x,
                size_m.y,
                size_m.z,
            ),
        ] {
            let mut face = Self::plate(width, height, edge_m);
            for vertex in &mut face.vertices {
                *vertex = turn * (*vertex - DVec3::Y * 0.5 * depth);
            }
            all = all.merged(face);
        }
        all
    }

    /// Two square-edged plates that meet at a right angle along the z axis, centred on the origin and
    /// open towards -y (the radar); each is `width_m` deep and `height_m` high.
    pub fn dihedral(width_m: f64, height_m: f64, edge_m: f64) -> Self {
        let wing = |side: f64| {
            let mut plate = Self::plate(width_m, height_m, edge_m);
            let turn = DQuat::from_rotation_z(-side * std::f64::consts::FRAC_PI_4);
            for vertex in &mut plate.vertices {
                *vertex = turn * (*vertex + DVec3::X * (side * 0.5 * width_m));
            }
            plate
        };
        wing(1.0).merged(wing(-1.0))
    }

    /// Three right triangles with legs `leg_m` that meet at right angles in the origin, open towards
    /// -y (the radar).
    pub fn trihedral(leg_m: f64, edge_m: f64) -> Self {
        let turn = DQuat::from_rotation_arc(DVec3::ONE.normalize(), -DVec3::Y);
        let legs = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| turn * axis * leg_m);
        let n = segments(leg_m, edge_m);
        let mut all = Self::new(Vec::new(), Vec::new());
        for face in 0..3 {
            // Counter-clockwise seen along the third leg, from inside the corner.
            let (p, q) = (legs[face] / n as f64, legs[(face + 1) % 3] / n as f64);
            let mut vertices = Vec::new();
            let mut rows = Vec::new();
            for i in 0..=n {
                rows.push(vertices.len() as u32);
                vertices.extend((0..=n - i).map(|j| p * i as f64 + q * j as f64));
            }
            let mut triangles = Vec::new();
            for i in 0..n {
                for j in 0..(n - i) as u32 {
                    let (here, next) = (rows[i] + j, rows[i + 1] + j);
                    triangles.push([here, next, here + 1]);
                    if (j as usize) < n - i - 1 {
                        triangles.push([next, next + 1, here + 1]);
                    }
                }
            }
            all = all.merged(Self::new(vertices, triangles));
        }
        all
    }

    /// Merges two meshes. Motion and material are those of the first.
    pub fn merged(mut self, other: Self) -> Self {
        let first = self.vertices.len() as u32;
        self.vertices.extend(other.vertices);
        self.triangles
            .extend(other.triangles.into_iter().map(|t| t.map(|i| i + first)));
        self
    }
}

impl MovingSurface for RigidSurface {
    fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    fn n_vertices(&self) -> usize {
        self.vertices.len()
    }

    fn positions_at(&self, time_s: f64, out: &mut [Vec3]) {
        let turn = DQuat::from_scaled_axis(self.angular_velocity * time_s) * self.orientation;
        let shift = self.position_m
            + self.velocity_mps * time_s
            + self.acceleration_mps2 * (0.5 * time_s * time_s);
        for (to, &p) in out.iter_mut().zip(&self.vertices) {
            *to = (turn * p + shift).as_vec3();
        }
    }

    fn is_still(&self) -> bool {
        [
            self.velocity_mps,
            self.acceleration_mps2,
            self.angular_velocity,
        ]
        .iter()
        .all(|v| *v == DVec3::ZERO)
    }

    fn material(&self) -> Material {
        self.material
    }
}

/// Increasing positions from low to high. The step between them grows with the distance from `foot`.
fn graded_lines([low, high]: [f64; 2], foot: f64, finest_m: f64) -> Vec<f64> {
    const GROWTH: f64 = 0.125;
    const MAX_PLACES: usize = 4096;
    let start = foot.clamp(low, high);
    let side = |end: f64| {
        let mut places = Vec::new();
        let mut at = start;
        while places.len() < MAX_PLACES {
            let step = finest_m.max(GROWTH * (at - foot).abs());
            let left = (end - at).abs();
            if left <= 0.0 {
                break;
            }
            // The last two steps share the remaining length equally, so that the last one is not very short.
            at = if left <= step {
                end
            } else {
                at + (end - at).signum() * step.min(0.5 * left.max(step))
            };
            places.push(at);
        }
        places
    };
    let mut lines: Vec<f64> = side(low).into_iter().rev().collect();
    lines.push(start);
    lines.extend(side(high));
    lines
}

fn segments(length_m: f64, edge_m: f64) -> usize {
    // The limit prevents a very small edge length from requesting terabytes.
    ((length_m / edge_m).ceil().clamp(1.0, 4096.0)) as usize
}

/// Triangles of a surface over s in 0..=1 (rows, downwards) and t in 0..=1 (columns, to the right as seen from
/// outside). Triangles without area, as at poles, are left out.
fn grid(rows: usize, columns: usize, at: impl Fn(f64, f64) -> DVec3) -> RigidSurface {
    let mut vertices = Vec::new();
    for row in 0..=rows {
        for column in 0..=columns {
            vertices.push(at(row as f64 / rows as f64, column as f64 / columns as f64));
        }
    }
    let mut triangles = Vec::new();
    let index = |row: usize, column: usize| (row * (columns + 1) + column) as u32;
    for row in 0..rows {
        for column in 0..columns {
            let (a, b) = (index(row, column), index(row, column + 1));
            let (c, d) = (index(row + 1, column), index(row + 1, column + 1));
            for triangle in [[a, c, d], [a, d, b]] {
                let [p, q, r] = triangle.map(|i| vertices[i as usize]);
                if (q - p).cross(r - p).length() > 1e-12 {
                    triangles.push(triangle);
                }
            }
        }
    }
    RigidSurface::new(vertices, triangles)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sum of p . N over the triangles divided by 3, which is the enclosed volume if all triangles face outwards.
    fn volume(mesh: &RigidSurface) -> f64 {
        let v = |i: u32| mesh.vertices[i as usize];
        mesh.triangles
            .iter()
            .map(|&[a, b, c]| v(a).dot((v(b) - v(a)).cross(v(c) - v(a))) / 6.0)
            .sum()
    }

    #[test]
    fn solids_face_outwards() {
        let sphere = RigidSurface::sphere(0.5, 0.01);
        // The inscribed polyhedron is smaller than the sphere by about (edge / radius)^2 / 4.
        assert!((volume(&sphere) / (4.0 / 3.0 * std::f64::consts::PI * 0.125) - 1.0).abs() < 2e-4);
        let cuboid = RigidSurface::cuboid(DVec3::new(1.0, 2.0, 3.0), 0.3);
        assert!((volume(&cuboid) - 6.0).abs() < 1e-12);
    }

    #[test]
    fn corners_open_towards_the_radar() {
        for (mesh, area) in [
            (RigidSurface::dihedral(0.2, 0.3, 0.04), 2.0 * 0.2 * 0.3),
            (RigidSurface::trihedral(0.2, 0.03), 3.0 * 0.5 * 0.2 * 0.2),
        ] {
            let mut sum = 0.0;
            for &[a, b, c] in &mesh.triangles {
                let [a, b, c] = [a, b, c].map(|i| mesh.vertices[i as usize]);
                let cross = 0.5 * (b - a).cross(c - a);
                sum += cross.length();
                assert!(cross.y < 0.0);
                // Every point lies on the radar's side of the apex.
                assert!(a.y <= 1e-12);
            }
            assert!((sum - area).abs() < 1e-12, "{sum} {area}");
        }
    }

    #[test]
    fn graded_plates_cover_their_area_and_are_finest_at_the_foot() {
        for (x, z, foot) in [
            ([-2.0, 3.0], [-1.0, 1.5], [0.0, 0.0]),
            ([0.0, 6.0], [-1.0, 1.5], [-0.5, 0.2]),
        ] {
            let mesh = RigidSurface::graded_plate(x, z, foot, 0.02);
            let (mut area, mut nearest) = (0.0, (f64::INFINITY, 0.0));
            for &[a, b, c] in &mesh.triangles {
                let [a, b, c] = [a, b, c].map(|i| mesh.vertices[i as usize]);
                let cross = 0.5 * (b - a).cross(c - a);
                assert!(cross.y < 0.0);
                area += cross.length();
                let distance = (a.x - foot[0]).hypot(a.z - foot[1]);
                let edge = a.distance(b).max(a.distance(c));
                if distance < nearest.0 {
                    nearest = (distance, edge);
                }
                let (dx, dz) = (b.x.max(c.x) - foot[0], b.z.max(c.z) - foot[1]);
                let reach = dx.abs().max(dz.abs()).max(distance) + 0.5;
                assert!(edge <= 0.2 * reach, "{edge} m at {distance} m");
            }
            let expected = (x[1] - x[0]) * (z[1] - z[0]);
            assert!((area / expected - 1.0).abs() < 1e-9);
            if foot[0] >= x[0] {
                assert!(nearest.1 < 0.03, "{nearest:?}");
            }
            assert!(mesh.triangles.len() < 20_000, "{}", mesh.triangles.len());
        }
    }

    #[test]
    fn a_plate_faces_the_radar() {
        let plate = RigidSurface::plate(1.0, 1.0, 1.0);
        let [a, b, c] = plate.triangles[0].map(|i| plate.vertices[i as usize]);
        assert!((b - a).cross(c - a).y < 0.0);
    }
}
