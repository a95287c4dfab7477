//! Isotropic remeshing of a closed mesh on an implicit surface.
//!
//! The algorithm alternates between splits of long edges, collapses of short edges, flips towards
//! six neighbours per vertex, and tangential smoothing with projection back onto the surface (after
//! Botsch and Kobbelt, "A remeshing approach to multiresolution modeling", SGP 2004). The topology
//! never changes.

use super::field::Field;
use glam::Vec3;

/// Number of rounds of split, collapse, flip and smooth; edge lengths converge after about six.
const N_ROUNDS: usize = 7;
/// Ratio of the mean edge to the maximum allowed edge at which the final splits are rare.
const TARGET_OF_LIMIT: f32 = 0.95;

/// Remeshes so that no edge is longer than `longest_edge_m`. `scale_at` gives the local target edge
/// length as a fraction (0..=1) of the default; hands and faces need smaller facets.
pub(super) fn remesh(
    vertices: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    field: &Field,
    longest_edge_m: f32,
    scale_at: &dyn Fn(Vec3) -> f32,
) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut mesh = Mesh::new(vertices, triangles);
    let target_m = TARGET_OF_LIMIT * longest_edge_m;
    for round in 0..N_ROUNDS {
        mesh.split(
            &|p| longest_edge_m.min(4.0 / 3.0 * target_m * scale_at(p)),
            field,
        );
        mesh.collapse(&|p| 0.8 * target_m * scale_at(p), &|p| {
            longest_edge_m.min(4.0 / 3.0 * target_m * scale_at(p))
        });
        mesh.flip();
        let n_steps = if round + 1 == N_ROUNDS { 3 } else { 1 };
        for _ in 0..n_steps {
            mesh.smooth(field);
        }
    }
    mesh.flip();
    mesh.split(&|_| longest_edge_m, field);
    mesh.finish()
}

/// Marker for a deleted triangle.
const DEAD: [u32; 3] = [u32::MAX; 3];

struct Mesh {
    position: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    /// Triangles around each vertex, in no order.
    around: Vec<Vec<u32>>,
}

impl Mesh {
    fn new(position: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        let mut around = vec![Vec::with_capacity(8); position.len()];
        for (f, t) in triangles.iter().enumerate() {
            for &v in t {
                around[v as usize].push(f as u32);
            }
        }
        Self {
            position,
            triangles,
            around,
        }
    }

    fn length(&self, a: u32, b: u32) -> f32 {
        self.position[a as usize].distance(self.position[b as usize])
    }

    fn middle(&self, a: u32, b: u32) -> Vec3 {
        0.5 * (self.position[a as usize] + self.position[b as usize])
    }

    fn normal(&self, [a, b, c]: [u32; 3]) -> Vec3 {
        let at = |v: u32| self.position[v as usize];
        (at(b) - at(a)).cross(at(c) - at(a))
    }

    /// The triangle with the directed edge a -> b, and its third vertex.
    fn side(&self, a: u32, b: u32) -> Option<(u32, u32)> {
        self.around[a as usize].iter().find_map(|&f| {
            let t = self.triangles[f as usize];
            (0..3)
                .find(|&k| t[k] == a && t[(k + 1) % 3] == b)
                .map(|k| (f, t[(k + 2) % 3]))
        })
    }

    /// Neighbours of a vertex: in a closed mesh each is the successor in exactly one triangle.
    fn neighbours(&self, v: u32) -> impl Iterator<Item = u32> + '_ {
        self.around[v as usize].iter().map(move |&f| {
            let t = self.triangles[f as usize];
            if t[0] == v {
                t[1]
            } else if t[1] == v {
                t[2]
            } else {
                t[0]
            }
        })
    }

    fn replace(&mut self, f: u32, old: u32, new: u32) {
        for v in &mut self.triangles[f as usize] {
            if *v == old {
                *v = new;
            }
        }
        self.around[new as usize].push(f);
    }

    fn detach(&mut self, v: u32, f: u32) {
        self.around[v as usize].retain(|&g| g != f);
    }

    fn split(&mut self, limit: &dyn Fn(Vec3) -> f32, field: &Field) {
        let mut queue: Vec<u32> = (0..self.triangles.len() as u32).collect();
        while let Some(f) = queue.pop() {
            let t = self.triangles[f as usize];
            if t == DEAD {
                continue;
            }
            let edge = |k: usize| self.length(t[k], t[(k + 1) % 3]);
            let k = (0..3).fold(0, |best, k| if edge(k) > edge(best) { k } else { best });
            let (a, b) = (t[k], t[(k + 1) % 3]);
            let middle = self.middle(a, b);
            if edge(k) <= limit(middle) {
                continue;
            }
            let (Some((f0, c)), Some((f1, d))) = (self.side(a, b), self.side(b, a)) else {
                continue;
            };
            let m = self.position.len() as u32;
            // A projection away from the edge would create folds; the midpoint of the chord is then
            // better.
            let on_surface = project(field, middle);
            let step = on_surface.distance(middle);
            self.position.push(if step < 0.25 * self.length(a, b) {
                on_surface
            } else {
                middle
            });
            self.around.push(Vec::with_capacity(8));
            for (face, opposite) in [(f0, c), (f1, d)] {
                // The half with a remains in place; the half with b becomes a new triangle.
                let new = self.triangles.len() as u32;
                let half_b = self.triangles[face as usize].map(|v| if v == a { m } else { v });
                self.detach(b, face);
                self.replace(face, b, m);
                self.triangles.push(half_b);
                for v in [b, m, opposite] {
                    self.around[v as usize].push(new);
                }
                queue.push(face);
                queue.push(new);
            }
        }
    }

    fn collapse(&mut self, shortest: &dyn Fn(Vec3) -> f32, longest: &dyn Fn(Vec3) -> f32) {
        for f in 0..self.triangles.len() {
            for k in 0..3 {
                let t = self.triangles[f];
                if t == DEAD {
                    break;
                }
                let (a, b) = (t[k], t[(k + 1) % 3]);
                let middle = self.middle(a, b);
                if self.length(a, b) < shortest(middle)
                    && self.may_collapse(a, b, middle, longest(middle))
                {
                    self.collapse_edge(a, b, middle);
                }
            }
        }
    }

    fn may_collapse(&self, a: u32, b: u32, to: Vec3, longest: f32) -> bool {
        let mut n_common = 0;
        for u in self.neighbours(a) {
            if u == b {
                continue;
            }
            if self.neighbours(b).any(|w| w == u) {
                n_common += 1;
                // The common neighbour loses one triangle; three must remain.
                if self.around[u as usize].len() <= 4 {
                    return false;
                }
            }
        }
        // There must be exactly the two vertices opposite the edge; otherwise a handle would be
        // pinched.
        if n_common != 2 {
            return false;
        }
        let other = |moved: u32, gone: u32| {
            self.around[moved as usize].iter().all(|&f| {
                let t = self.triangles[f as usize];
                if t.contains(&gone) {
                    return true;
                }
                let before = self.normal(t);
                let at = |v: u32| {
                    if v == moved {
                        to
                    } else {
                        self.position[v as usize]
                    }
                };
                let after = (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0]));
                let reach = t
                    .iter()
                    .all(|&v| v == moved || self.position[v as usize].distance(to) <= longest);
                reach && after.dot(before) > 0.3 * after.length() * before.length()
            })
        };
        other(a, b) && other(b, a)
    }

    fn collapse_edge(&mut self, a: u32, b: u32, to: Vec3) {
        self.position[a as usize] = to;
        for f in std::mem::take(&mut self.around[b as usize]) {
            let t = self.triangles[f as usize];
            if t.contains(&a) {
                self.triangles[f as usize] = DEAD;
                for v in t {
                    if v != b {
                        self.detach(v, f);
                    }
                }
            } else {
                self.replace(f, b, a);
            }
        }
    }

    fn flip(&mut self) {
        for f in 0..self.triangles.len() {
            for k in 0..3 {
                let t = self.triangles[f];
                if t == DEAD {
                    break;
                }
                let (a, b, c) = (t[k], t[(k + 1) % 3], t[(k + 2) % 3]);
                let Some((g, d)) = self.side(b, a) else {
                    continue;
                };
                let valence = |v: u32| self.around[v as usize].len() as i32;
                let badness = |va: i32, vb: i32, vc: i32, vd: i32| {
                    [va, vb, vc, vd]
                        .iter()
                        .map(|v| (v - 6) * (v - 6))
                        .sum::<i32>()
                };
                let (va, vb, vc, vd) = (valence(a), valence(b), valence(c), valence(d));
                let gain = badness(va, vb, vc, vd) - badness(va - 1, vb - 1, vc + 1, vd + 1);
                if gain <= 0 || va <= 4 || vb <= 4 || self.neighbours(c).any(|u| u == d) {
                    continue;
                }
                if self.length(c, d) > 1.5 * self.length(a, b) {
                    continue;
                }
                let (old0, old1) = (self.normal(t), self.normal(self.triangles[g as usize]));
                let (new0, new1) = (self.normal([a, d, c]), self.normal([d, b, c]));
                let agrees = |n: Vec3| {
                    [old0, old1]
                        .iter()
                        .all(|o| n.dot(*o) > 0.7 * n.length() * o.length())
                        && n.length() > 0.0
                };
                if !agrees(new0) || !agrees(new1) {
                    continue;
                }
                self.triangles[f] = [a, d, c];
                self.triangles[g as usize] = [d, b, c];
                self.detach(b, f as u32);
                self.detach(a, g);
                self.around[d as usize].push(f as u32);
                self.around[c as usize].push(g);
            }
        }
    }

    /// Moves every vertex to the mean of its neighbours within the tangent plane, then back onto
    /// the surface.
    fn smooth(&mut self, field: &Field) {
        let mut moved = self.position.clone();
        for (v, to) in moved.iter_mut().enumerate() {
            let n = self.around[v].len();
            if n == 0 {
                continue;
            }
            let at = self.position[v];
            let mean = self
                .neighbours(v as u32)
                .map(|u| self.position[u as usize])
                .sum::<Vec3>()
                / n as f32;
            let normal = self.around[v]
                .iter()
                .map(|&f| self.normal(self.triangles[f as usize]))
                .sum::<Vec3>();
            let normal = normal.normalize_or_zero();
            let shift = mean - at;
            *to = project(field, at + 0.7 * (shift - normal * normal.dot(shift)));
        }
        self.position = moved;
    }

    /// Removes deleted entries.
    fn finish(self) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let mut new_index = vec![u32::MAX; self.position.len()];
        let mut vertices = Vec::new();
        for (v, around) in self.around.iter().enumerate() {
            if !around.is_empty() {
                new_index[v] = vertices.len() as u32;
                vertices.push(self.position[v]);
            }
        }
        let triangles = self
            .triangles
            .iter()
            .filter(|t| **t != DEAD)
            .map(|t| t.map(|v| new_index[v as usize]))
            .collect();
        (vertices, triangles)
    }
}

/// Newton step onto the zero level.
fn project(field: &Field, p: Vec3) -> Vec3 {
    let (value, gradient) = field.value_and_gradient(p);
    // Blends of approximate distances have gradients between about 0.5 and 1.5.
    let step = -value / gradient.length_squared().max(0.25);
    p + gradient * step.clamp(-0.01, 0.01)
}

#[cfg(test)]
mod tests {
    use super::super::polygonize::polygonize;
    use super::super::topology::{
        euler_characteristic, is_closed_and_oriented, longest_edge_m, volume_m3,
    };
    use super::*;
    use glam::Mat3;

    #[test]
    fn a_remeshed_sphere_stays_closed_and_obeys_the_edge_limit() {
        let mut field = Field::new();
        field.ellipsoid(Vec3::ZERO, Mat3::IDENTITY, Vec3::splat(0.15), 0.02);
        let (v, t) = polygonize(&field, 0.02);
        let (v, t) = remesh(v, t, &field, 0.02, &|_| 1.0);
        assert!(is_closed_and_oriented(&t));
        assert_eq!(euler_characteristic(v.len(), &t), 2);
        assert!(longest_edge_m(&v, &t) <= 0.02);
        // Equilateral triangles of the mean edge would be 4 pi r^2 / (0.433 L^2) in number; with
        // L between 0.7 and 0.9 of the limit that is 2000 to 3300.
        assert!((2000..3300).contains(&t.len()), "{}", t.len());
        // An inscribed polyhedron with 1.6 cm edges loses about (L / r)^2 / 4 = 0.3 % of the volume.
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.15f64.powi(3);
        assert!((volume_m3(&v, &t) / exact - 1.0).abs() < 0.01);
    }
}
