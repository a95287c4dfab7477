//! Visibility by ray tracing. It is slow, and its accuracy is limited only by the number of rays. The raster is tested
//! against it.

use glam::{Vec3, Vec3A};
use obvhs::{BvhBuildParams, bvh2::builder::build_bvh2, ray::Ray, triangle::Triangle};

use crate::visibility::{ScreenTransmission, View};

/// Like [`crate::visibility::DepthRaster::coverage`], with `per_edge * per_edge` rays per facet, from the centres of
/// its equal parts to the viewpoint. Returns the number of rays.
pub fn coverage_by_rays(
    view: View<'_>,
    per_edge: usize,
    out: &mut Vec<f32>,
    transmission: &mut ScreenTransmission,
) -> usize {
    let View {
        positions,
        triangles,
        surfaces,
        centre,
    } = view;
    out.clear();
    out.resize(triangles.len(), 0.0);
    let passed_sum = transmission.reset(if view.has_screens() {
        triangles.len()
    } else {
        0
    });
    let corners: Vec<[Vec3; 3]> = triangles
        .iter()
        .map(|t| t.map(|i| positions[i as usize] - centre))
        .collect();
    // A facet is visible from the centre if it faces the centre and is within 87 degrees of boresight, as in the
    // raster.
    let is_seen = |[a, b, c]: [Vec3; 3]| {
        (b - a).cross(c - a).dot(a) < 0.0 && [a, b, c].iter().all(|p| p.y > 0.05 * p.length())
    };
    let opposite: Vec<u32> = (surfaces.iter().flat_map(|surface| surface.facets.clone()))
        .filter(|&i| is_seen(corners[i as usize]))
        .collect();
    if opposite.is_empty() {
        return 0;
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
        let part = surfaces.partition_point(|p| p.facets.end <= facet);
        surfaces[part].power_transmission
    };
    let n = per_edge.max(1);
    for &facet in &opposite {
        let [a, b, c] = corners[facet as usize];
        let (mut seen, mut passed_over) = (0, 0.0);
        for (s, t) in middles(n) {
            let point = a + (b - a) * s + (c - a) * t;
            let range_m = point.length();
            // The ray starts at the centre and ends at the facet, so that it meets only nearer facets. The facet itself
            // is excluded by its index.
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
                // Once nothing passes, the search can stop. Any distance below the ray's end stops it.
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
    opposite.len() * n * n
}

/// Barycentric coordinates of the centroids of the n^2 equal parts of a triangle.
fn middles(n: usize) -> impl Iterator<Item = (f32, f32)> {
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
    use crate::visibility::{DepthRaster, Sampling, SurfaceRange};
    use glam::DVec3;
    use radarllm_base::MovingSurface;

    #[test]
    fn the_raster_sees_what_rays_see() {
        let sphere = RigidSurface::sphere(0.3, 0.05).at(DVec3::new(0.1, 3.0, 0.0));
        let (mut positions, mut triangles, mut surfaces) = (Vec::new(), Vec::new(), Vec::new());
        // An opaque plate is in front of the left half, a screen in front of most of the sphere, and another screen in
        // front of everything.
        for (surface, power_transmission) in [
            (&sphere as &dyn MovingSurface, 0.0),
            (
                &RigidSurface::plate(0.4, 0.4, 0.1).at(DVec3::new(-0.13, 2.0, 0.0)),
                0.0,
            ),
            (
                &RigidSurface::plate(0.3, 0.3, 0.03).at(DVec3::new(0.1, 2.5, 0.1)),
                0.5,
            ),
            (
                &RigidSurface::plate(0.8, 0.8, 0.2).at(DVec3::new(0.05, 1.5, 0.0)),
                0.8,
            ),
        ] {
            let first = positions.len() as u32;
            let first_facet = triangles.len() as u32;
            triangles.extend(surface.triangles().iter().map(|t| t.map(|i| i + first)));
            let mut at = vec![Vec3::ZERO; surface.n_vertices()];
            surface.positions_at(0.0, &mut at);
            positions.extend(at);
            surfaces.push(SurfaceRange {
                facets: first_facet..triangles.len() as u32,
                vertices: first..positions.len() as u32,
                power_transmission,
            });
        }
        let (mut share, mut exact) = (Vec::new(), Vec::new());
        let (mut transmission, mut exact_transmission) =
            (ScreenTransmission::default(), ScreenTransmission::default());
        let view = View {
            positions: &positions,
            triangles: &triangles,
            surfaces: &surfaces,
            centre: Vec3::ZERO,
        };
        coverage_by_rays(view, 24, &mut exact, &mut exact_transmission);
        // Facets of the front screen, facets behind it alone, and facets behind both screens.
        for factor in [1.0, 0.8, 0.4] {
            let visible = (0..triangles.len()).filter(|&f| exact[f] > 0.0);
            let behind =
                visible.filter(|&f| (exact_transmission.amplitude(f) - factor).abs() < 1e-4);
            assert!(behind.count() > 20, "{factor}");
        }
        for (sampling, size) in [(Sampling::Uniform, 1024), (Sampling::Windows, 1024)] {
            DepthRaster::new(size, sampling).coverage(view, &mut share, &mut transmission);
            let error = |f: usize| {
                share[f] * transmission.amplitude(f) - exact[f] * exact_transmission.amplitude(f)
            };
            // A facet of the sphere is 12 raster samples or 24 rays wide. A partly hidden facet has an error of up to
            // one row of them. Most facets are not partly hidden.
            let mean =
                (0..triangles.len()).map(|f| error(f).abs()).sum::<f32>() / triangles.len() as f32;
            println!("{sampling:?}: {mean}");
            assert!(mean < 4e-3, "{sampling:?}: {mean}");
        }
    }
}
