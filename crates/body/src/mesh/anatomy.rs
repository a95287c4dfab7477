//! The shape of a person: tables of cross-sections attached to the skeleton.
//!
//! All lengths are in metres for a person of 1.75 m and scale with the height; widths and depths
//! also scale with the build. The figures are rounded proportions of an adult between the sexes.
//! They were chosen by eye and for a plausible mass, not taken from one survey: shoulder breadth 45
//! cm, hip breadth 35 cm, chest depth 23 cm, head 15 x 20 x 23 cm, hand 18.5 cm, foot 26 cm.

use super::builtin::Build;
use super::field::{Field, Section, section};
use glam::{Mat3, Vec3};
use radarllm_base::Joint;
use radarllm_base::skeleton::N_JOINTS;

/// Body height to which the tables refer, m.
const TABLE_HEIGHT_M: f32 = 1.75;

/// The body's surface in the bind pose. `joints` are bind positions with the soles at y = 0.
pub(super) fn body_field(joints: &[Vec3; N_JOINTS], height_m: f32, build: Build) -> Field {
    let scale = height_m / TABLE_HEIGHT_M;
    let mut sculptor = Sculptor {
        field: Field::with_floor(0.0, 0.008 * scale),
        scale,
        girth: 1.0,
    };
    let at = |joint: Joint| joints[joint as usize];
    let girths = Girths::of(build);

    sculptor.girth = girths.trunk;
    trunk(&mut sculptor, girths.belly);
    sculptor.girth = girths.limbs;
    leg(
        &mut sculptor,
        at(Joint::LeftHip),
        at(Joint::LeftKnee),
        at(Joint::LeftAnkle),
    );
    arm(
        &mut sculptor,
        at(Joint::LeftShoulder),
        at(Joint::LeftElbow),
        at(Joint::LeftWrist),
    );
    sculptor.girth = girths.extremities;
    foot(&mut sculptor, at(Joint::LeftAnkle), at(Joint::LeftFoot));
    hand(&mut sculptor, at(Joint::LeftElbow), at(Joint::LeftWrist));
    sculptor.girth = 1.0;
    head(&mut sculptor, girths.extremities);
    sculptor.field
}

/// Scale factors for widths and depths.
struct Girths {
    trunk: f32,
    limbs: f32,
    extremities: f32,
    /// Size of the belly: 0 is none, 1 is large.
    belly: f32,
}

impl Girths {
    fn of(build: Build) -> Self {
        match build {
            Build::Slim => Self {
                trunk: 0.93,
                limbs: 0.91,
                extremities: 0.97,
                belly: 0.0,
            },
            Build::Average => Self {
                trunk: 1.03,
                limbs: 1.03,
                extremities: 1.0,
                belly: 0.08,
            },
            Build::Heavy => Self {
                trunk: 1.15,
                limbs: 1.15,
                extremities: 1.04,
                belly: 1.0,
            },
        }
    }
}

fn trunk(s: &mut Sculptor, belly: f32) {
    s.loft(
        Vec3::ZERO,
        Mat3::IDENTITY,
        1.0,
        &[
            section(0.845, 0.0, -0.010, 0.105, 0.085),
            section(0.900, 0.0, -0.012, 0.155, 0.103),
            section(0.950, 0.0, -0.012, 0.166, 0.108),
            section(1.010, 0.0, -0.006, 0.160, 0.106),
            section(1.080, 0.0, 0.000, 0.144, 0.101),
            section(1.130, 0.0, 0.002, 0.138, 0.099),
            section(1.200, 0.0, 0.001, 0.144, 0.103),
            section(1.280, 0.0, -0.003, 0.156, 0.112),
            section(1.350, 0.0, -0.009, 0.158, 0.107),
            section(1.400, 0.0, -0.017, 0.138, 0.090),
            section(1.440, 0.0, -0.023, 0.100, 0.070),
            section(1.475, 0.0, -0.024, 0.062, 0.052),
        ],
        [0.03, 0.03],
        0.03,
    );
    // Buttocks, chest, shoulder blades, and the slope from neck to shoulder.
    s.ellipsoid(
        Vec3::new(0.070, 0.905, -0.072),
        Vec3::new(0.074, 0.082, 0.060),
        0.04,
    );
    s.ellipsoid(
        Vec3::new(0.072, 1.300, 0.062),
        Vec3::new(0.076, 0.068, 0.042),
        0.06,
    );
    s.ellipsoid(
        Vec3::new(0.080, 1.350, -0.075),
        Vec3::new(0.070, 0.090, 0.040),
        0.05,
    );
    s.bone(
        Vec3::new(0.010, 1.490, -0.030),
        Vec3::new(0.165, 1.430, -0.026),
        Vec3::Z,
        &[
            section(0.0, 0.0, 0.0, 0.040, 0.040),
            section(0.5, 0.0, 0.0, 0.040, 0.042),
            section(1.0, 0.0, 0.0, 0.044, 0.048),
        ],
        [0.03, 0.03],
        0.035,
    );
    if belly > 0.0 {
        s.ellipsoid(
            Vec3::new(0.0, 1.070, 0.030 + 0.030 * belly),
            Vec3::new(
                0.120 + 0.020 * belly,
                0.115 + 0.02 * belly,
                0.078 + 0.022 * belly,
            ),
            0.06,
        );
    }
}

fn head(s: &mut Sculptor, neck: f32) {
    s.girth = neck;
    s.bone(
        Vec3::new(0.0, 1.420, -0.030),
        Vec3::new(0.0, 1.600, 0.000),
        Vec3::Z,
        &[
            section(0.0, 0.0, 0.0, 0.062, 0.062),
            section(0.5, 0.0, 0.0, 0.055, 0.057),
            section(1.0, 0.0, 0.0, 0.055, 0.058),
        ],
        [0.03, 0.03],
        0.045,
    );
    s.girth = 1.0;
    // Cranium, face, jaw, chin, nose, ear.
    s.ellipsoid(
        Vec3::new(0.0, 1.660, -0.006),
        Vec3::new(0.075, 0.090, 0.094),
        0.02,
    );
    s.ellipsoid(
        Vec3::new(0.0, 1.625, 0.036),
        Vec3::new(0.060, 0.080, 0.062),
        0.03,
    );
    s.ellipsoid(
        Vec3::new(0.0, 1.580, 0.038),
        Vec3::new(0.053, 0.050, 0.056),
        0.02,
    );
    s.ellipsoid(
        Vec3::new(0.0, 1.548, 0.076),
        Vec3::new(0.024, 0.019, 0.020),
        0.03,
    );
    s.ellipsoid(
        Vec3::new(0.0, 1.622, 0.100),
        Vec3::new(0.013, 0.026, 0.022),
        0.018,
    );
    s.ellipsoid(
        Vec3::new(0.076, 1.628, -0.006),
        Vec3::new(0.012, 0.032, 0.018),
        0.008,
    );
}

fn arm(s: &mut Sculptor, shoulder: Vec3, elbow: Vec3, wrist: Vec3) {
    let along = (elbow - shoulder).normalize();
    // The deltoid covers the joint from above and outside.
    let deltoid = shoulder + along * 0.030 * s.scale + Vec3::Y * 0.002 * s.scale;
    s.ellipsoid_at(
        deltoid,
        frame(along, Vec3::Z),
        Vec3::new(0.056, 0.082, 0.056),
        0.04,
    );
    s.bone(
        shoulder / s.scale,
        elbow / s.scale,
        Vec3::Z,
        &[
            section(0.0, 0.0, 0.0, 0.050, 0.052),
            section(0.25, 0.0, 0.0, 0.049, 0.051),
            section(0.5, 0.0, 0.0, 0.045, 0.048),
            section(0.8, 0.0, 0.0, 0.039, 0.042),
            section(1.0, 0.0, 0.0, 0.037, 0.041),
        ],
        [0.04, 0.03],
        0.03,
    );
    s.bone(
        elbow / s.scale,
        wrist / s.scale,
        Vec3::Z,
        &[
            section(0.0, 0.0, 0.0, 0.038, 0.041),
            section(0.2, 0.0, 0.0, 0.040, 0.044),
            section(0.45, 0.0, 0.0, 0.036, 0.040),
            section(0.75, 0.0, 0.0, 0.028, 0.033),
            section(1.0, 0.0, 0.0, 0.021, 0.029),
        ],
        [0.03, 0.02],
        0.02,
    );
}

/// Palm, a block of four slightly curled fingers, and the thumb. Palms face down in the T-pose:
/// local x of the arm's frame points to the palm side, local z to the thumb side.
fn hand(s: &mut Sculptor, elbow: Vec3, wrist: Vec3) {
    let forearm = frame((wrist - elbow).normalize(), Vec3::Z);
    let (palmar, along, radial) = (forearm.x_axis, forearm.y_axis, forearm.z_axis);
    s.loft(
        wrist,
        forearm,
        1.0,
        &[
            section(-0.01, 0.0, 0.0, 0.020, 0.028),
            section(0.025, 0.0, 0.002, 0.020, 0.034),
            section(0.060, 0.0, 0.001, 0.018, 0.042),
            section(0.095, 0.0, -0.001, 0.0155, 0.043),
        ],
        [0.01, 0.012],
        0.015,
    );
    let fingers = frame(along + 0.16 * palmar, radial);
    s.loft(
        wrist + along * 0.085 * s.scale,
        fingers,
        1.0,
        &[
            section(0.0, 0.0, -0.001, 0.0145, 0.041),
            section(0.035, 0.001, -0.001, 0.0125, 0.040),
            section(0.065, 0.003, -0.001, 0.0115, 0.036),
            section(0.083, 0.005, -0.001, 0.0100, 0.029),
        ],
        [0.01, 0.014],
        0.01,
    );
    let thumb = frame(0.74 * along + 0.62 * radial + 0.30 * palmar, radial);
    s.loft(
        wrist + (along * 0.022 + radial * 0.018 + palmar * 0.006) * s.scale,
        thumb,
        1.0,
        &[
            section(0.0, 0.0, 0.0, 0.0165, 0.018),
            section(0.035, 0.0, 0.0, 0.0140, 0.0145),
            section(0.065, 0.0, 0.0, 0.0120, 0.0125),
            section(0.078, 0.0, 0.0, 0.0110, 0.0115),
        ],
        [0.012, 0.012],
        0.010,
    );
}

fn leg(s: &mut Sculptor, hip: Vec3, knee: Vec3, ankle: Vec3) {
    // Local x points to the midline of the body.
    s.bone(
        hip / s.scale,
        knee / s.scale,
        Vec3::Z,
        &[
            section(0.0, -0.028, -0.004, 0.078, 0.088),
            section(0.15, -0.022, -0.002, 0.080, 0.089),
            section(0.35, -0.010, 0.002, 0.074, 0.083),
            section(0.6, -0.003, 0.003, 0.062, 0.070),
            section(0.85, 0.0, 0.003, 0.052, 0.058),
            section(1.0, 0.0, 0.004, 0.049, 0.055),
        ],
        [0.05, 0.03],
        0.03,
    );
    s.bone(
        knee / s.scale,
        ankle / s.scale,
        Vec3::Z,
        &[
            section(0.0, 0.0, 0.002, 0.048, 0.053),
            section(0.12, 0.0, -0.004, 0.049, 0.052),
            section(0.28, -0.002, -0.013, 0.053, 0.056),
            section(0.5, -0.001, -0.011, 0.046, 0.049),
            section(0.75, 0.0, -0.004, 0.034, 0.038),
            section(0.92, 0.0, 0.0, 0.031, 0.036),
            section(1.0, 0.0, 0.0, 0.033, 0.039),
        ],
        [0.03, 0.03],
        0.02,
    );
    s.ellipsoid_at(
        knee + Vec3::Z * 0.028 * s.scale,
        Mat3::IDENTITY,
        Vec3::new(0.032, 0.042, 0.028),
        0.03,
    );
}

/// Heel, arch and toes along the line from the ankle to the ball of the foot. Sections extend a few
/// millimetres below the floor, which cuts them to a flat sole.
fn foot(s: &mut Sculptor, ankle: Vec3, ball: Vec3) {
    let forward = Vec3::new(ball.x - ankle.x, 0.0, ball.z - ankle.z).normalize();
    let on_floor = Vec3::new(ankle.x, 0.0, ankle.z);
    s.loft(
        on_floor,
        frame(forward, Vec3::Y),
        1.0,
        &[
            section(-0.028, 0.0, 0.034, 0.030, 0.040),
            section(0.010, 0.0, 0.040, 0.033, 0.047),
            section(0.050, -0.001, 0.034, 0.037, 0.041),
            section(0.100, 0.0, 0.022, 0.044, 0.030),
            section(0.140, 0.003, 0.013, 0.046, 0.022),
            section(0.175, 0.006, 0.008, 0.041, 0.017),
        ],
        [0.032, 0.024],
        0.025,
    );
}

/// Adds solids in the units of the tables.
struct Sculptor {
    field: Field,
    scale: f32,
    girth: f32,
}

impl Sculptor {
    fn ellipsoid(&mut self, center: Vec3, radii: Vec3, blend: f32) {
        let girth = Vec3::new(self.girth, 1.0, self.girth);
        self.field.ellipsoid(
            center * girth * self.scale,
            Mat3::IDENTITY,
            radii * girth * self.scale,
            blend * self.scale,
        );
    }

    /// Like [`Self::ellipsoid`], but around a point in metres and in a frame whose y axis is along
    /// the limb.
    fn ellipsoid_at(&mut self, center: Vec3, axes: Mat3, radii: Vec3, blend: f32) {
        let girth = Vec3::new(self.girth, 1.0, self.girth);
        self.field
            .ellipsoid(center, axes, radii * girth * self.scale, blend * self.scale);
    }

    /// A loft whose `along` column is the fraction of the way from one point to another.
    fn bone(
        &mut self,
        from: Vec3,
        to: Vec3,
        depth_hint: Vec3,
        rows: &[Section],
        caps: [f32; 2],
        blend: f32,
    ) {
        let length = from.distance(to);
        self.loft(
            from * self.scale,
            frame((to - from) / length, depth_hint),
            length,
            rows,
            caps,
            blend,
        );
    }

    fn loft(
        &mut self,
        origin: Vec3,
        axes: Mat3,
        along_unit: f32,
        rows: &[Section],
        caps: [f32; 2],
        blend: f32,
    ) {
        let s = self.scale;
        let rows: Vec<Section> = rows
            .iter()
            .map(|r| Section {
                along: r.along * along_unit * s,
                center_x: r.center_x * self.girth * s,
                center_z: r.center_z * s,
                half_width: r.half_width * self.girth * s,
                half_depth: r.half_depth * self.girth * s,
            })
            .collect();
        self.field
            .loft(origin, axes, &rows, caps.map(|c| c * s), blend * s);
    }
}

/// Right-handed axes with y along `direction` and z as near as possible to `depth_hint`.
fn frame(direction: Vec3, depth_hint: Vec3) -> Mat3 {
    let y = direction.normalize();
    let z = depth_hint.reject_from_normalized(y).normalize();
    Mat3::from_cols(y.cross(z), y, z)
}
