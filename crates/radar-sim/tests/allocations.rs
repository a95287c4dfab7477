//! The frame loop allocates nothing once its buffers have grown.
//!
//! A test program of its own: it counts what the global allocator hands out.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;

use glam::DVec3;
use radarllm_base::{RadarConfig, frames::Placement};
use radarllm_body::{
    MotionSampler,
    mesh::{BodyShape, BuiltinBody, PosedBody, clothed_skin},
};
use radarllm_radar_sim::{Noise, PointTarget, Scene, SimOptions, Simulator};

thread_local! {
    /// Allocations of this thread; the test harness's own threads do not count.
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: passes everything on to the system's allocator; counting allocates nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn frames_of_a_walking_body_allocate_nothing() {
    let walk = radarllm_motions::parse("builtin:walk").unwrap().render(0);
    let shape = BodyShape {
        facet_edge_m: 0.05,
        ..BodyShape::default()
    };
    let body = PosedBody::new(
        Arc::new(BuiltinBody::new(&shape).unwrap()),
        MotionSampler::new(&walk.motion),
        Placement::default(),
        clothed_skin(),
    );
    let scene = Scene {
        surfaces: vec![&body],
        points: vec![PointTarget::at(DVec3::new(0.5, 4.0, 0.0), 0.1)],
        noise: Noise::Thermal,
    };
    let mut simulator =
        Simulator::new(&RadarConfig::awr1843boost(), SimOptions::default()).unwrap();
    let mut cube = simulator.new_cube();
    let mut frames = || {
        for frame in 0..10 {
            let time_s = 0.1 * frame as f64;
            simulator
                .simulate_frame(&scene, frame, time_s, 1, &mut cube)
                .unwrap();
        }
    };
    let before = COUNT.get();
    frames();
    let growing = COUNT.get() - before;
    assert!(
        growing > 0,
        "the first pass grows buffers, and the counter sees it"
    );
    let before = COUNT.get();
    frames();
    assert_eq!(COUNT.get() - before, 0);
}
