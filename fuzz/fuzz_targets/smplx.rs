//! Body models in npz files: an archive, or its members. What was read is posed once.
#![no_main]

use std::io::Cursor;

use glam::{Quat, Vec3};
use libfuzzer_sys::fuzz_target;
use radarllm_base::Pose;
use radarllm_body::mesh::{BodyModel, SmplxBody};
use radarllm_fuzz::{archive, pieces};

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else {
        return;
    };
    let npz = match kind % 3 {
        0 => Some(bytes.to_vec()),
        other => archive(&pieces(bytes), other == 2),
    };
    let Some(npz) = npz else {
        return;
    };
    if let Ok(body) = SmplxBody::read(Cursor::new(npz), "fuzz", &[0.5, -1.0]) {
        let pose = Pose {
            root_in_world: Vec3::Z,
            rotations: [Quat::IDENTITY; 22],
        };
        let mut vertices = vec![Vec3::ZERO; body.n_vertices()];
        body.pose_into(&pose, &mut vertices);
        let n = body.n_vertices();
        assert!(body.triangles().iter().flatten().all(|i| (*i as usize) < n));
    }
});
