//! What the rasters' visible shares leave of error, against rays.

use glam::{DQuat, DVec3, Vec3};
use radarllm_base::MovingSurface;
use radarllm_radar_sim::Sampling;
use radarllm_radar_sim::rays::coverage_by_rays;
use radarllm_radar_sim::shapes::RigidSurface;
use radarllm_radar_sim::visibility::{DepthRaster, ScreenTransmission, SurfaceRange, View};

/// A trunk, a head, and limbs that cross it.
fn body(pose: usize) -> Vec<RigidSurface> {
    let swing = 0.5 * (pose as f64 - 1.5);
    let limb = |x: f64, z: f64, angle: f64, radii: [f64; 3]| {
        RigidSurface::ellipsoid(DVec3::from(radii), 0.025)
            .turned(DQuat::from_rotation_y(angle) * DQuat::from_rotation_x(0.3 * angle))
            .at(DVec3::new(x, 2.75, z))
    };
    vec![
        limb(0.0, 0.1, 0.0, [0.17, 0.11, 0.32]),
        limb(0.0, 0.57, 0.0, [0.08, 0.1, 0.12]),
        limb(-0.15, 0.1, swing, [0.05, 0.05, 0.3]),
        limb(0.15, 0.15, 0.8 - swing, [0.05, 0.05, 0.3]),
        limb(-0.1, -0.5, 0.3 * swing, [0.08, 0.08, 0.4]),
        limb(0.1, -0.5, -0.3 * swing, [0.08, 0.08, 0.4]),
    ]
}

/// Error of the body's shares, rms with the weight of a facet's field, and samples drawn, over four poses.
fn error(walls: &[RigidSurface], sampling: Sampling, size: usize) -> (f64, usize) {
    let (mut squares, mut weights, mut n_samples) = (0.0, 0.0, 0);
    for pose in 0..4 {
        let body = body(pose);
        let (mut positions, mut triangles, mut surfaces) = (Vec::new(), Vec::new(), Vec::new());
        for surface in body.iter().chain(walls) {
            let (vertex, facet) = (positions.len() as u32, triangles.len() as u32);
            triangles.extend(surface.triangles().iter().map(|t| t.map(|i| i + vertex)));
            let mut at = vec![Vec3::ZERO; surface.n_vertices()];
            surface.positions_at(0.0, &mut at);
            positions.extend(at);
            surfaces.push(SurfaceRange {
                facets: facet..triangles.len() as u32,
                vertices: vertex..positions.len() as u32,
                power_transmission: 0.0,
            });
        }
        let view = View {
            positions: &positions,
            triangles: &triangles,
            surfaces: &surfaces,
            centre: Vec3::ZERO,
        };
        let (mut found, mut exact, mut transmission) =
            (Vec::new(), Vec::new(), ScreenTransmission::default());
        coverage_by_rays(view, 12, &mut exact, &mut transmission);
        n_samples += DepthRaster::new(size, sampling).coverage(view, &mut found, &mut transmission);
        let n_body = surfaces[body.len() - 1].facets.end as usize;
        for (facet, (f, e)) in found[..n_body].iter().zip(&exact).enumerate() {
            // The field of a facet goes with its projected area.
            let [a, b, c] = triangles[facet].map(|i| positions[i as usize]);
            let weight = (b - a).cross(c - a).dot(a.normalize()).min(0.0);
            squares += f64::from((weight * (f - e)).powi(2));
            weights += f64::from(weight * weight);
        }
    }
    ((squares / weights).sqrt(), n_samples)
}

/// Without anything larger around it, a body fills the raster as it is.
#[test]
fn a_body_in_free_space_needs_no_window() {
    let uniform = error(&[], Sampling::Uniform, 320);
    assert_eq!(error(&[], Sampling::Windows, 320), uniform);
    assert!(uniform.0 < 0.02, "{uniform:?}");
}

/// Before walls that fill the view, a body needs a window of its own.
#[test]
fn a_body_in_a_room_gets_its_own_window() {
    let half_pi = std::f64::consts::FRAC_PI_2;
    let floor = RigidSurface::plate(5.0, 6.0, 0.1)
        .turned(DQuat::from_rotation_x(-half_pi))
        .at(DVec3::new(0.0, 3.0, -1.0));
    let left = RigidSurface::plate(6.0, 2.5, 0.1)
        .turned(DQuat::from_rotation_z(half_pi))
        .at(DVec3::new(-2.5, 3.0, 0.2));
    let back = RigidSurface::plate(5.0, 2.5, 0.1).at(DVec3::new(0.0, 6.0, 0.2));
    let walls = [floor, left, back];
    let (uniform, n_uniform) = error(&walls, Sampling::Uniform, 320);
    let (windows, n_windows) = error(&walls, Sampling::Windows, 320);
    println!("room: {uniform:.4} from {n_uniform}, windows {windows:.4} from {n_windows}");
    assert!(n_windows <= n_uniform);
    assert!(windows < 0.5 * uniform, "{uniform} {windows}");
}
