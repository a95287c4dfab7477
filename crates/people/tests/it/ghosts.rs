//! Reflections of people over walls.

use radarllm_people::{TrackOptions, find_ghosts, track};

use crate::scenes::{points, summary, walker};

const WALL: &str = "max_bounces = 2\nbounce_rays = 128\n[[target]]\nkind = \"plate\"\nposition_m = [1.5, 3.0, 0.0]\n\
                    normal = [-1.0, 0.0, 0.0]\nsize_m = [6.0, 3.0]\nmaterial = \"concrete\"\nfacet_edge_m = 0.05\n";

#[test]
fn a_ghost_over_a_wall_goes_and_a_second_person_stays() {
    let scene = [
        "duration_s = 2.6\n",
        WALL,
        &walker([0.4, 4.2], 0.0, 2.4),
        &walker([-1.2, 2.0], 170.0, 2.4),
    ]
    .concat();
    let frames = points(&scene);
    let tracks = track(&frames, &TrackOptions::default()).unwrap();
    let ghosts = find_ghosts(&tracks, &frames);
    eprintln!("{:#?}\n{ghosts:#?}", summary(&tracks));
    for t in &tracks {
        for f in t.frames.iter().step_by(3) {
            let med = |g: &dyn Fn(&radarllm_base::RadarPoint) -> f32| {
                let mut v: Vec<f32> = f.points.iter().map(|i| g(&frames[f.frame].points[*i as usize])).collect();
                v.sort_by(f32::total_cmp);
                v.get(v.len() / 2).copied().unwrap_or(f32::NAN)
            };
            let level = f.points.iter().map(|i| { let p = &frames[f.frame].points[*i as usize]; p.intensity_db + 40.0 * p.range_m.log10() }).fold(-999.0, f32::max);
            eprintln!("T{} f{} n{} R {:.2} ux {:.2} uz {:.2} v {:.2} level {:.1} est {:.2?} {:.2?}", t.id, f.frame, f.points.len(), med(&|p| p.range_m), med(&|p| p.x_m / p.range_m), med(&|p| p.z_m / p.range_m), med(&|p| p.velocity_mps), level, f.place_m, f.velocity_mps);
        }
    }
}
