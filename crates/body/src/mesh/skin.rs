//! Linear blend skinning with sparse weights.

use glam::{Affine3A, Mat3A, Vec3, Vec3A};

/// Bones and weights that influence each vertex (compressed rows).
pub(super) struct Skin {
    /// Vertex v owns `influences[offsets[v]..offsets[v + 1]]`.
    offsets: Vec<u32>,
    influences: Vec<Influence>,
}

#[derive(Clone, Copy)]
struct Influence {
    bone: u32,
    weight: f32,
}

impl Skin {
    /// Builds rows from `(bone, weight)` lists whose weights sum to one.
    pub(super) fn new<'a>(rows: impl Iterator<Item = &'a [(usize, f32)]>) -> Self {
        let (mut offsets, mut influences) = (vec![0], Vec::new());
        for row in rows {
            influences.extend(row.iter().map(|&(bone, weight)| Influence {
                bone: bone as u32,
                weight,
            }));
            offsets.push(influences.len() as u32);
        }
        Self {
            offsets,
            influences,
        }
    }

    /// The bones and weights of one vertex.
    pub(super) fn row(&self, vertex: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let range = self.offsets[vertex] as usize..self.offsets[vertex + 1] as usize;
        self.influences[range]
            .iter()
            .map(|i| (i.bone as usize, i.weight))
    }

    /// Moves each vertex by the weighted mean of its bones' transforms.
    ///
    /// `rest` and `out` are the positions of vertices `first_vertex..`; `world_from_rest[bone]`
    /// maps rest positions to the world.
    pub(super) fn apply(
        &self,
        first_vertex: usize,
        world_from_rest: &[Affine3A],
        rest: &[Vec3],
        out: &mut [Vec3],
    ) {
        for (v, (at, to)) in (first_vertex..).zip(rest.iter().zip(out.iter_mut())) {
            let (first, last) = (self.offsets[v] as usize, self.offsets[v + 1] as usize);
            let point = Vec3A::from(*at);
            *to = match &self.influences[first..last] {
                [only] => world_from_rest[only.bone as usize]
                    .transform_point3a(point)
                    .into(),
                several => {
                    let (mut m, mut t) = (Mat3A::ZERO, Vec3A::ZERO);
                    for i in several {
                        let bone = &world_from_rest[i.bone as usize];
                        m += bone.matrix3 * i.weight;
                        t += bone.translation * i.weight;
                    }
                    (m * point + t).into()
                }
            };
        }
    }
}
