//! Properties of closed triangle meshes.

use glam::{DVec3, Vec3};
use std::collections::HashMap;

/// True if every edge is shared by exactly two triangles that traverse it in opposite directions.
pub fn is_closed_and_oriented(triangles: &[[u32; 3]]) -> bool {
    let mut directed: HashMap<(u32, u32), u32> = HashMap::new();
    for t in triangles {
        for k in 0..3 {
            *directed.entry((t[k], t[(k + 1) % 3])).or_default() += 1;
        }
    }
    directed
        .iter()
        .all(|(&(a, b), &n)| a != b && n == 1 && directed.get(&(b, a)) == Some(&1))
}

/// V - E + F of a closed mesh; 2 for one surface without handles.
pub fn euler_characteristic(n_vertices: usize, triangles: &[[u32; 3]]) -> i64 {
    n_vertices as i64 - (triangles.len() * 3 / 2) as i64 + triangles.len() as i64
}

/// Enclosed volume, m^3; positive when triangles are counter-clockwise from outside.
pub fn volume_m3(vertices: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
    let at = |i: u32| -> DVec3 { vertices[i as usize].as_dvec3() };
    triangles
        .iter()
        .map(|&[a, b, c]| at(a).dot(at(b).cross(at(c))) / 6.0)
        .sum()
}

/// Surface area, m^2.
pub fn area_m2(vertices: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
    let at = |i: u32| -> DVec3 { vertices[i as usize].as_dvec3() };
    triangles
        .iter()
        .map(|&[a, b, c]| 0.5 * (at(b) - at(a)).cross(at(c) - at(a)).length())
        .sum()
}

/// Length of the longest edge, m.
pub fn longest_edge_m(vertices: &[Vec3], triangles: &[[u32; 3]]) -> f32 {
    let at = |i: u32| vertices[i as usize];
    triangles
        .iter()
        .flat_map(|&[a, b, c]| {
            [
                at(a).distance(at(b)),
                at(b).distance(at(c)),
                at(c).distance(at(a)),
            ]
        })
        .fold(0.0, f32::max)
}

/// Sorted neighbours of every vertex as offsets into one list: vertex v owns
/// `list[offsets[v]..offsets[v + 1]]`.
pub(super) fn neighbours(n_vertices: usize, triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<u32>) {
    // In a closed oriented mesh every directed edge occurs once, so this lists each neighbour once.
    let mut offsets = vec![0u32; n_vertices + 1];
    for t in triangles {
        for &v in t {
            offsets[v as usize + 1] += 1;
        }
    }
    for v in 0..n_vertices {
        offsets[v + 1] += offsets[v];
    }
    let mut fill = offsets.clone();
    let mut list = vec![0u32; triangles.len() * 3];
    for t in triangles {
        for k in 0..3 {
            let slot = &mut fill[t[k] as usize];
            list[*slot as usize] = t[(k + 1) % 3];
            *slot += 1;
        }
    }
    (offsets, list)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

    #[test]
    fn a_tetrahedron_is_closed_until_a_face_is_missing_or_flipped() {
        assert!(is_closed_and_oriented(&TETRAHEDRON));
        assert!(!is_closed_and_oriented(&TETRAHEDRON[..3]));
        let mut flipped = TETRAHEDRON;
        flipped[0].swap(0, 1);
        assert!(!is_closed_and_oriented(&flipped));
        assert_eq!(euler_characteristic(4, &TETRAHEDRON), 2);
    }

    #[test]
    fn the_unit_tetrahedron_has_volume_one_sixth() {
        let vertices = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
        assert!((volume_m3(&vertices, &TETRAHEDRON) - 1.0 / 6.0).abs() < 1e-12);
        assert!((area_m2(&vertices, &TETRAHEDRON) - (1.5 + 0.75f64.sqrt())).abs() < 1e-9);
        assert!((longest_edge_m(&vertices, &TETRAHEDRON) - 2f32.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn neighbours_of_a_tetrahedron_are_the_other_three() {
        let (offsets, list) = neighbours(4, &TETRAHEDRON);
        for v in 0..4u32 {
            let mut own =
                list[offsets[v as usize] as usize..offsets[v as usize + 1] as usize].to_vec();
            own.sort_unstable();
            assert_eq!(own, (0..4).filter(|&u| u != v).collect::<Vec<_>>());
        }
    }
}
