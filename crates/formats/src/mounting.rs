//! Mounting of a sensor: the rotation from its own axes into the level axes of the project.

use radarllm_base::{BoardTrack, PointFrame};

/// Angles of a mounted sensor. With all angles zero, the sensor is level and looks along y.
///
/// The angles are applied in this order: roll about the boresight, tilt about the x axis, yaw about the vertical. The
/// height above the floor is not included: points remain relative to the radar, and the points file stores the height.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Mounting {
    /// Angle of the boresight below the horizon, rad; positive when looking down.
    pub tilt_rad: f64,
    /// Angle of the boresight to the right, rad, seen from above.
    pub yaw_rad: f64,
    /// Rotation about the boresight, rad; positive when the right side is lowered (clockwise seen along the boresight).
    pub roll_rad: f64,
}

impl Mounting {
    /// Converts a position from the axes of the sensor (x right, y along the boresight, z up) into level axes, m.
    pub fn level(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let (sin, cos) = self.roll_rad.sin_cos();
        let (x, z) = (x * cos + z * sin, z * cos - x * sin);
        let (sin, cos) = self.tilt_rad.sin_cos();
        let (y, z) = (y * cos + z * sin, z * cos - y * sin);
        let (sin, cos) = self.yaw_rad.sin_cos();
        [x * cos + y * sin, y * cos - x * sin, z]
    }

    /// Rotates a track of the firmware. Without its height, it is taken to be at the height of the sensor.
    fn apply_to_track(&self, track: &mut BoardTrack) {
        let [x_m, y_m] = track.place_m.map(f64::from);
        let z_m = track.height_m.map_or(0.0, f64::from);
        let [x_m, y_m, z_m] = self.level([x_m, y_m, z_m]).map(|v| v as f32);
        track.place_m = [x_m, y_m];
        track.height_m = track.height_m.map(|_| z_m);
        let velocity_mps = self.level(track.velocity_mps.map(f64::from));
        track.velocity_mps = velocity_mps.map(|v| v as f32);
    }

    /// Rotates all points and tracks. Ranges and radial velocities do not change.
    pub fn apply(&self, frames: &mut [PointFrame]) {
        if *self == Self::default() {
            return;
        }
        for point in frames.iter_mut().flat_map(|f| &mut f.points) {
            let [x, y, z] = self.level([point.x_m, point.y_m, point.z_m].map(f64::from));
            (point.x_m, point.y_m, point.z_m) = (x as f32, y as f32, z as f32);
        }
        for board in frames.iter_mut().filter_map(|f| f.board.as_mut()) {
            board
                .tracks
                .iter_mut()
                .for_each(|track| self.apply_to_track(track));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: [f64; 3], expected: [f64; 3]) {
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 5e-4, "{found:?} for {expected:?}");
        }
    }

    /// Checks the numbers in CONVENTIONS.md.
    #[test]
    fn tilted_turned_and_rolled_sensors_see_level_points() {
        let degrees = f64::to_radians;
        let tilted = Mounting {
            tilt_rad: degrees(15.0),
            ..Mounting::default()
        };
        close(tilted.level([0.0, 3.0, 0.0]), [0.0, 2.898, -0.776]);
        let turned = Mounting {
            yaw_rad: degrees(30.0),
            ..Mounting::default()
        };
        close(turned.level([0.0, 3.0, 0.0]), [1.5, 2.598, 0.0]);
        let rolled = Mounting {
            roll_rad: degrees(90.0),
            ..Mounting::default()
        };
        // The right side of the sensor is lowered.
        close(rolled.level([1.0, 3.0, 0.0]), [0.0, 3.0, -1.0]);
    }
}
