//! Visibility by rays: slow, and as exact as its samples are many. What the raster is tested against.

use glam::{Vec3, Vec3A};
use obvhs::{BvhBuildParams, bvh2::builder::build_bvh2, ray::Ray, triangle::Triangle};

use crate::visibility::{Through, View};

/// As [`crate::visibility::DepthRaster::coverage`], from `per_edge * per_edge` rays a facet: from the
/// middles of its equal parts to `centre`.
pub fn coverage_by_rays(
    view: View<'_>,
    per_edge: usize,
    out: &mut Vec<f32>,
    through: &mut Through,
) {
    let View {
        positions,
        triangles,
        screens,
        centre,
    } = view;
    out.clear();
    out.resize(triangles.len(), 0.0);
    let passed_sum = through.reset(if screens.is_empty() {
        0
    } else {
        triangles.len()
    });
    let corners: Vec<[Vec3; 3]> = triangles
        .iter()
        .map(|t| t.map(|i| positions[i as usize] - centre))
        .collect();
    // Seen from the centre: turned towards it, and before 87 degrees as in the raster.
    let is_seen = |[a, b, c]: [Vec3; 3]| {
        (b - a).cross(c - a).dot(a) < 0.0 && [a, b, c].iter().all(|p| p.y > 0.05 * p.length())
    };
    let opposite: Vec<u32> = (0..triangles.len() as u32)
        .filter(|&i| is_seen(corners[i as usize]))
        .collect();
    if opposite.is_empty() {
        return;
    }
    let mesh: Vec<Triangle> = opposite
        .iter()
        .map(|&i| {
            let [v0, v1, v2] = corners[i as usize].map(Vec3A::from);
            Triangle { v0, v1, v2 }
        })
        .collect();
    let mut time = std::time::Duration::default();
    let bvh = build_bvh2(&mesh, BvhBuildParams::fast_build(), &mut time);
    let transmission = |facet: u32| {
        let screen = screens.iter().find(|s| s.facets.contains(&facet));
        screen.map_or(0.0, |s| s.power_transmission)
    };
    let n = per_edge.max(1);
    for &facet in &opposite {
        let [a, b, c] = corners[facet as usize];
        let (mut seen, mut passed_over) = (0, 0.0);
        for (s, t) in parts(n) {
            let point = a + (b - a) * s + (c - a) * t;
            let range_m = point.length();
            // From the centre outwards: nearer facets only, itself left out by index.
            let ray = Ray::new(
                Vec3A::ZERO,
                (point / range_m).into(),
                0.0,
                range_m * (1.0 - 1e-6),
            );
            let mut passed = 1.0_f32;
            bvh.ray_traverse_miss(ray, |ray, i| {
                let index = bvh.primitive_indices[i] as usize;
                if opposite[index] != facet && mesh[index].intersect(ray) < ray.tmax {
                    passed *= transmission(opposite[index]);
                }
                // Any distance below the ray's end stops it: nothing is left to lose.
                if passed == 0.0 { 0.0 } else { f32::INFINITY }
            });
            if passed > 0.0 {
                seen += 1;
                passed_over += passed;
            }
        }
        out[facet as usize] = seen as f32 / (n * n) as f32;
        if let (Some(mean), 1..) = (passed_sum.get_mut(facet as usize), seen) {
            *mean = passed_over / seen as f32;
        }
    }
}

/// Barycentric middles of the n^2 equal parts of a triangle.
fn parts(n: usize) -> impl Iterator<Item = (f32, f32)> {
    let at = move |i: usize, j: usize, third: f32| {
        ((i as f32 + third) / n as f32, (j as f32 + third) / n as f32)
    };
    (0..n).flat_map(move |i| {
        (0..n - i).flat_map(move |j| {
            let upper = (j + 1 < n - i).then(|| at(i, j, 2.0 / 3.0));
            std::iter::once(at(i, j, 1.0 / 3.0)).chain(upper)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::RigidSurface;
    use crate::visibility::{DepthRaster, Screen};
    use glam::DVec3;
    use radarllm_base::MovingSurface;

    #[test]
    fn the_raster_sees_what_rays_see() {
        let sphere = RigidSurface::sphere(0.3, 0.05).at(DVec3::new(0.1, 3.0, 0.0));
        let (mut positions, mut triangles, mut firsts) = (Vec::new(), Vec::new(), Vec::new());
        // Opaque in front of the left half, a screen before most of it, another in front of all.
        for surface in [
            &sphere as &dyn MovingSurface,
            &RigidSurface::plate(0.4, 0.4, 0.1).at(DVec3::new(-0.13, 2.0, 0.0)),
            &RigidSurface::plate(0.3, 0.3, 0.03).at(DVec3::new(0.1, 2.5, 0.1)),
            &RigidSurface::plate(0.8, 0.8, 0.2).at(DVec3::new(0.05, 1.5, 0.0)),
        ] {
            let first = positions.len() as u32;
            firsts.push(triangles.len() as u32);
            triangles.extend(surface.triangles().iter().map(|t| t.map(|i| i + first)));
            let mut at = vec![Vec3::ZERO; surface.n_vertices()];
            surface.positions_at(0.0, &mut at);
            positions.extend(at);
        }
        firsts.push(triangles.len() as u32);
        let screens = [2, 3].map(|i| Screen {
            facets: firsts[i]..firsts[i + 1],
            power_transmission: [0.5, 0.8][i - 2],
        });
        let (mut share, mut exact) = (Vec::new(), Vec::new());
        let (mut through, mut exact_through) = (Through::default(), Through::default());
        let mut raster = DepthRaster::new(1024);
        let view = View {
            positions: &positions,
            triangles: &triangles,
            screens: &screens,
            centre: Vec3::ZERO,
        };
        raster.coverage(view, &mut share, &mut through);
        coverage_by_rays(view, 24, &mut exact, &mut exact_through);
        let (mut all, mut kinds) = (0.0, [0; 3]);
        for facet in 0..triangles.len() {
            // 12 samples of the raster and 24 rays across a sphere's facet: a row of either at its
            // edge. At the rim facets are slivers of few samples; they count by their number below.
            let found = share[facet] * through.of(facet);
            let expected = exact[facet] * exact_through.of(facet);
            all += (found - expected).abs();
            for (count, factor) in kinds.iter_mut().zip([1.0, 0.8, 0.4]) {
                *count += usize::from((expected - factor).abs() < 1e-4);
            }
        }
        let mean = all / triangles.len() as f32;
        assert!(mean < 4e-3, "{mean}");
        // The front screen, what is behind it alone, and behind both.
        assert!(kinds.iter().all(|&n| n > 20), "{kinds:?}");
    }
}
