//! Properties of all built-in motions, and of some individual ones.

use glam::{Quat, Vec3};
use proptest::prelude::*;
use radarllm_base::Joint;
use radarllm_base::hash::Fnv1a;
use radarllm_base::skeleton::N_JOINTS;
use radarllm_facts::tables::{Expected, caption_rows};

use crate::captions::check;
use crate::random::LONGEST_S;
use crate::spec::{KeyKind, Posture};
use crate::*;

fn render(text: &str) -> Procedural {
    parse(text)
        .unwrap_or_else(|e| panic!("{text}: {e}"))
        .render(11)
}

fn track(p: &Procedural, joint: Joint) -> Vec<Vec3> {
    p.motion
        .joints_in_world()
        .iter()
        .map(|j| j[joint as usize])
        .collect()
}

/// Every motion alone with its defaults, with every word of every key, and with extreme sizes and speeds, and random
/// requests.
fn cases() -> Vec<(String, u64)> {
    let mut texts = Vec::new();
    for spec in specs() {
        texts.push(spec.name.to_owned());
        for key in spec.keys {
            match key.kind {
                KeyKind::Word { allowed, .. } => {
                    texts.extend(
                        allowed
                            .iter()
                            .map(|w| format!("{}?{}={w}", spec.name, key.name)),
                    );
                }
                KeyKind::Speed => {
                    texts.extend(["0.4", "2"].map(|s| format!("{}?speed={s}", spec.name)))
                }
                KeyKind::Number { min, max, .. } if key.name == "amplitude" => {
                    texts.extend([min, max].map(|a| format!("{}?amplitude={a}", spec.name)));
                }
                _ => {}
            }
        }
        texts.extend(["1", "2"].map(|h| format!("{}?height_m={h}", spec.name)));
    }
    let mut cases: Vec<(String, u64)> = texts.into_iter().zip(5..).collect();
    cases.extend((0..150).map(|seed| (random_request(seed).to_string(), seed)));
    cases
}

#[test]
fn every_motion_is_finite_above_the_floor_continuous_and_within_joint_limits() {
    let mut worst: (f32, f32, f32) = (f32::MAX, 0.0, 0.0);
    for (text, seed) in cases() {
        let p = parse(&text)
            .unwrap_or_else(|e| panic!("{text}: {e}"))
            .render(seed);
        let joints = p.motion.joints_in_world();
        assert!(
            p.motion.poses.iter().all(|q| q.root_in_world.is_finite()),
            "{text}"
        );
        let low = joints
            .iter()
            .flatten()
            .map(|q| q.z)
            .fold(f32::MAX, f32::min);
        // The joint nearest to the floor is the ball of the foot, 3 cm above the sole. On tiptoe the sole is vertical,
        // and the joint may reach the floor itself.
        assert!(low > -0.005, "{text}: a joint at {low} m");
        worst.0 = worst.0.min(low);
        for pair in joints.windows(2) {
            for j in 0..N_JOINTS {
                let speed = (pair[1][j] - pair[0][j]).length() * p.motion.fps as f32;
                worst.1 = worst.1.max(speed);
                // The punch or throw of a professional reaches about 10 m/s, and everyday motions are slower.
                assert!(speed < 12.0, "{text}: {:?} at {speed} m/s", Joint::ALL[j]);
            }
        }
        for pair in p.motion.poses.windows(2) {
            for j in 0..N_JOINTS {
                let angle = pair[0].rotations[j].angle_between(pair[1].rotations[j]);
                worst.2 = worst.2.max(angle);
                // 0.7 rad in 1/60 s are 2400 degrees/s, the speed of the elbow in an overhand throw. Arms that catch a
                // fall at twice its speed may exceed it by a fifth.
                let max = if text == "fall?speed=2" { 0.84 } else { 0.7 };
                assert!(
                    angle < max,
                    "{text}: {:?} turns {angle} rad in a frame",
                    Joint::ALL[j]
                );
            }
        }
        for pose in &p.motion.poses {
            for q in &pose.rotations {
                assert!(q.is_finite() && (q.length() - 1.0).abs() < 1e-3, "{text}");
            }
            for (joint, hinge) in [
                (Joint::LeftKnee, Vec3::X),
                (Joint::RightKnee, Vec3::X),
                (Joint::LeftElbow, Vec3::NEG_Y),
                (Joint::RightElbow, Vec3::Y),
            ] {
                let (axis, angle) = pose.rotations[joint as usize].to_axis_angle();
                // Knees and elbows are hinges: they turn only about one axis, only in the anatomical direction, and by
                // at most 158 degrees.
                assert!(
                    angle < 1e-3 || (axis.dot(hinge) > 0.999 && angle < 2.76),
                    "{text}: {joint:?} {axis} {angle}"
                );
            }
        }
    }
    println!(
        "lowest joint {:.3} m, fastest {:.1} m/s, largest turn {:.2} rad a frame",
        worst.0, worst.1, worst.2
    );
}

#[test]
fn bones_keep_their_lengths_and_the_start_is_canonical() {
    for spec in specs() {
        let p = render(spec.name);
        let start = p.motion.poses[0].root_in_world;
        assert!(start.truncate().length() < 1e-5, "{}", spec.name);
        for joints in p.motion.joints_in_world() {
            for joint in Joint::ALL {
                if let Some(parent) = joint.parent() {
                    let length = (joints[joint as usize] - joints[parent as usize]).length();
                    // The tolerance is the rounding of f32 metres away from the origin.
                    assert!(
                        (length - p.motion.skeleton.offsets[joint as usize].length()).abs() < 1e-4
                    );
                }
            }
        }
        let forward = p.motion.poses[0].rotations[0] * Vec3::Z;
        if spec.starts == Posture::Standing {
            assert!(
                forward.dot(Vec3::NEG_Y) > 0.97,
                "{}: faces {forward}",
                spec.name
            );
        }
    }
}

#[test]
fn walking_covers_the_distance_in_the_right_direction_at_the_asked_speed() {
    for (text, travel) in [
        ("walk?distance_m=3", Vec3::new(0.0, -3.0, 0.0)),
        (
            "walk?distance_m=2&direction=backward",
            Vec3::new(0.0, 2.0, 0.0),
        ),
        ("walk?distance_m=2&heading_deg=90", Vec3::new(2.0, 0.0, 0.0)),
        ("run?distance_m=5", Vec3::new(0.0, -5.0, 0.0)),
        (
            "side_step?distance_m=1.5&direction=left",
            Vec3::new(1.5, 0.0, 0.0),
        ),
        (
            "side_step?distance_m=1.5&direction=right",
            Vec3::new(-1.5, 0.0, 0.0),
        ),
        ("limp?distance_m=2", Vec3::new(0.0, -2.0, 0.0)),
        ("march?distance_m=2", Vec3::new(0.0, -2.0, 0.0)),
        ("march", Vec3::ZERO),
        ("jog_in_place", Vec3::ZERO),
        ("circle?radius_m=1", Vec3::ZERO),
        (
            "walk+then+turn+then+walk?distance_m=1.5&turn.angle_deg=90&direction=left",
            Vec3::ZERO,
        ),
    ] {
        if text.contains("+then+") {
            continue;
        }
        let pelvis = track(&render(text), Joint::Pelvis);
        let moved = (pelvis[pelvis.len() - 1] - pelvis[0]).truncate();
        // Idle sway moves the pelvis by up to 1 cm at either end.
        assert!(
            (moved - travel.truncate()).length() < 0.03,
            "{text}: moved {moved}"
        );
    }
    for (speed, expected) in [("slow", 0.7), ("normal", 1.0), ("fast", 1.45), ("0.5", 0.5)] {
        let p = render(&format!("walk?distance_m=6&height_m=1.75&speed={speed}"));
        let y: Vec<f32> = track(&p, Joint::Pelvis).iter().map(|q| -q.y).collect();
        let (a, b) = (y.len() / 3, 2 * y.len() / 3);
        let mps = (y[b] - y[a]) / (b - a) as f32 * 60.0;
        // Normal speed is 1.2 m/s. The tolerance of 5 % is the speed variation within a step.
        assert!(
            (mps / (1.2 * expected) - 1.0).abs() < 0.05,
            "{speed}: {mps} m/s"
        );
    }
}

#[test]
fn turning_left_then_walking_goes_left() {
    let text = "walk+then+turn+then+march?walk.distance_m=1&turn.angle_deg=90&turn.direction=left&march.distance_m=2";
    let pelvis = track(&render(text), Joint::Pelvis);
    let moved = pelvis[pelvis.len() - 1] - pelvis[0];
    // First 1 m towards -y, then 2 m towards the person's left, +x.
    assert!(
        (moved.truncate() - glam::Vec2::new(2.0, -1.0)).length() < 0.05,
        "{moved}"
    );
    let pelvis = track(&render("circle?direction=left&radius_m=1"), Joint::Pelvis);
    let far = pelvis.iter().map(|p| p.x).fold(0.0, f32::max);
    assert!(
        (far - 2.0).abs() < 0.1 && pelvis.iter().all(|p| p.x > -0.1),
        "reaches x = {far}"
    );
}

#[test]
fn a_foot_on_the_floor_stays_where_it_is() {
    for text in [
        "walk?distance_m=4",
        "walk?distance_m=3&speed=fast",
        "walk?direction=backward",
        "circle",
        "pace",
        "limp",
        "turn",
        "march",
        "squat",
        "side_step",
        "run",
        "pick_up",
        "lunge",
    ] {
        let p = render(text);
        let joints = p.motion.joints_in_world();
        let mut stances = 0;
        for (ankle, ball) in [
            (Joint::LeftAnkle, Joint::LeftFoot),
            (Joint::RightAnkle, Joint::RightFoot),
        ] {
            let rest = (joints[0][ankle as usize].z, joints[0][ball as usize].z);
            // A foot is flat on the floor if both joints are within 4 mm of their standing heights.
            let flat: Vec<bool> = joints
                .iter()
                .map(|j| {
                    (j[ankle as usize].z - rest.0).abs() < 0.004
                        && (j[ball as usize].z - rest.1).abs() < 0.004
                })
                .collect();
            let mut start = 0;
            while start < flat.len() {
                let end = (start..flat.len())
                    .find(|n| !flat[*n])
                    .unwrap_or(flat.len());
                if end - start >= 8 {
                    stances += 1;
                    let first = joints[start][ankle as usize];
                    for j in &joints[start..end] {
                        let slide = (j[ankle as usize] - first).truncate().length();
                        // 4 mm of height correspond to up to 2 degrees of pitch and 5 mm of ankle travel. In side
                        // steps, feet slide over the floor at the end of a swing.
                        assert!(slide < 0.02, "{text}: {ankle:?} slides {slide} m in stance");
                    }
                }
                start = end + 1;
            }
        }
        assert!(stances >= 2, "{text}: {stances} stances found");
    }
}

#[test]
fn standing_people_are_over_their_feet() {
    for text in [
        "stand_still",
        "bow",
        "pick_up",
        "kick",
        "balance",
        "side_bend",
        "wave",
        "toe_touch",
        "squat",
    ] {
        let p = render(text);
        for j in p.motion.joints_in_world() {
            let feet = [
                Joint::LeftAnkle,
                Joint::RightAnkle,
                Joint::LeftFoot,
                Joint::RightFoot,
            ]
            .map(|f| j[f as usize]);
            let head = j[Joint::Head as usize];
            let mass =
                (j[Joint::Pelvis as usize] * 2.0 + j[Joint::Spine3 as usize] * 2.0 + head * 0.4)
                    / 4.4;
            let near = feet
                .iter()
                .map(|f| (f.truncate() - mass.truncate()).length())
                .fold(f32::MAX, f32::min);
            // The centre of the trunk is not that of the whole body. Legs and arms move the latter by up to 25 cm in a
            // kick or a toe touch.
            assert!(near < 0.35, "{text}: trunk {near} m from the nearest foot");
        }
    }
}

#[test]
fn sides_are_the_sides_asked_for() {
    for (text, up, down) in [
        ("raise_arms?side=left", Joint::LeftWrist, Joint::RightWrist),
        ("raise_arms?side=right", Joint::RightWrist, Joint::LeftWrist),
        ("wave?side=left", Joint::LeftWrist, Joint::RightWrist),
        (
            "walk+while+wave?side=right",
            Joint::RightWrist,
            Joint::LeftWrist,
        ),
        (
            "side_bend?direction=left",
            Joint::RightWrist,
            Joint::LeftWrist,
        ),
    ] {
        let joints = render(text).motion.joints_in_world();
        let above = |wrist: Joint| {
            joints
                .iter()
                .any(|j| j[wrist as usize].z > j[Joint::Spine3 as usize].z)
        };
        assert!(above(up) && !above(down), "{text}");
    }
    for (text, far, near) in [
        ("kick?side=left", Joint::LeftAnkle, Joint::RightAnkle),
        (
            "kick?side=right&direction=backward",
            Joint::RightAnkle,
            Joint::LeftAnkle,
        ),
        ("kick?direction=left", Joint::LeftAnkle, Joint::RightAnkle),
        ("leg_raise?side=left", Joint::LeftAnkle, Joint::RightAnkle),
        (
            "leg_raise?side=right&direction=forward&arm=raised",
            Joint::RightWrist,
            Joint::LeftWrist,
        ),
        ("hop?side=right", Joint::LeftAnkle, Joint::RightAnkle),
        ("balance?side=left", Joint::RightAnkle, Joint::LeftAnkle),
        ("step_over?side=left", Joint::LeftAnkle, Joint::RightAnkle),
        ("punch?side=left", Joint::LeftWrist, Joint::RightWrist),
        ("knock?side=left", Joint::LeftWrist, Joint::RightWrist),
        ("drink?side=right", Joint::RightWrist, Joint::LeftWrist),
        (
            "point?side=right&direction=left",
            Joint::RightWrist,
            Joint::LeftWrist,
        ),
        ("throw?side=left", Joint::LeftWrist, Joint::RightWrist),
    ] {
        let joints = render(text).motion.joints_in_world();
        let first_to_move = |joint: Joint| {
            let start = joints[0][joint as usize];
            joints
                .iter()
                .map(|j| (j[joint as usize] - start).length())
                .fold(0.0, f32::max)
        };
        let way = |joint: Joint| -> f32 {
            joints
                .windows(2)
                .map(|w| (w[1][joint as usize] - w[0][joint as usize]).length())
                .sum()
        };
        if text.starts_with("step_over") {
            // Both legs cross the obstacle. The leading leg is higher first.
            let high = |joint: Joint| {
                joints
                    .iter()
                    .position(|j| j[joint as usize].z > 0.3)
                    .unwrap_or(usize::MAX)
            };
            assert!(high(far) < high(near), "{text}");
        } else if text.starts_with("hop") {
            // The hopping foot travels more, and the lifted foot stays higher.
            let sum = |joint: Joint| joints.iter().map(|j| j[joint as usize].z).sum::<f32>();
            assert!(sum(far) > 1.3 * sum(near), "{text}");
        } else {
            assert!(way(far) > way(near) && first_to_move(far) > 0.2, "{text}");
        }
    }
    let lowest = |text: &str, joint: Joint| {
        track(&render(text), joint)
            .iter()
            .map(|q| q.z)
            .fold(f32::MAX, f32::min)
    };
    assert!(lowest("pick_up?side=left", Joint::LeftWrist) < 0.3);
    assert!(lowest("pick_up?side=left", Joint::RightWrist) > 0.3);
    assert!(lowest("kneel?side=left", Joint::LeftKnee) < 0.12);
    assert!(lowest("kneel?side=left", Joint::RightKnee) > 0.3);
    let reach = |text: &str, axis: Vec3, joint: Joint| {
        let at = track(&render(text), joint);
        at.iter()
            .map(|q| (*q - at[0]).dot(axis))
            .fold(0.0, f32::max)
    };
    assert!(reach("kick?direction=forward", Vec3::NEG_Y, Joint::RightAnkle) > 0.5);
    assert!(reach("kick?direction=backward", Vec3::Y, Joint::RightAnkle) > 0.4);
    assert!(reach("kick?direction=left", Vec3::X, Joint::LeftAnkle) > 0.4);
    assert!(reach("lunge?direction=right", Vec3::NEG_X, Joint::RightAnkle) > 0.4);
    assert!(reach("jump?direction=left", Vec3::X, Joint::Pelvis) > 0.25);
    assert!(reach("jump?direction=backward", Vec3::Y, Joint::Pelvis) > 0.25);
    assert!(
        reach(
            "point?side=left&direction=right",
            Vec3::NEG_X,
            Joint::LeftWrist
        ) > 0.4
    );
}

/// Number of separate times the signal rises above the middle of its range, with hysteresis.
fn count_peaks(signal: &[f32]) -> u32 {
    let (low, high) = signal
        .iter()
        .fold((f32::MAX, f32::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
    let (up, down) = (low + 0.7 * (high - low), low + 0.55 * (high - low));
    let (mut above, mut count) = (false, 0);
    for x in signal {
        if !above && *x > up {
            above = true;
            count += 1;
        } else if above && *x < down {
            above = false;
        }
    }
    count
}

#[test]
fn repetitions_are_counted_in_the_motion() {
    for n in 1..=4 {
        let count = |text: &str, signal: &dyn Fn(&[Vec3; N_JOINTS]) -> f32| {
            let p = render(&format!("{text}repetitions={n}"));
            let signal: Vec<f32> = p.motion.joints_in_world().iter().map(signal).collect();
            assert_eq!(count_peaks(&signal), n, "{text}repetitions={n}");
        };
        let z = |j: &[Vec3; N_JOINTS], joint: Joint| j[joint as usize].z;
        count("squat?", &|j| -z(j, Joint::Pelvis));
        count("jump?", &|j| {
            z(j, Joint::LeftAnkle).min(z(j, Joint::RightAnkle))
        });
        count("squat?arms=still&", &|j| -z(j, Joint::Pelvis));
        count("jump?arms=still&", &|j| {
            z(j, Joint::LeftAnkle).min(z(j, Joint::RightAnkle))
        });
        count("jumping_jack?", &|j| z(j, Joint::LeftWrist));
        count("raise_arms?side=left&", &|j| z(j, Joint::LeftWrist));
        count("kick?", &|j| {
            -(j[Joint::RightAnkle as usize].y - j[Joint::LeftAnkle as usize].y)
        });
        count("bow?", &|j| -z(j, Joint::Head));
        count("toe_touch?", &|j| -z(j, Joint::Head));
        count("push?", &|j| {
            -(j[Joint::LeftWrist as usize].y - j[Joint::Spine3 as usize].y)
        });
        count("punch?side=right&", &|j| {
            -(j[Joint::RightWrist as usize].y - j[Joint::Pelvis as usize].y)
        });
        count("arm_circles?", &|j| z(j, Joint::LeftWrist));
        count("lunge?", &|j| -j[Joint::RightAnkle as usize].y);
        count("hop?side=left&", &|j| z(j, Joint::LeftAnkle));
        count("side_bend?", &|j| j[Joint::Head as usize].x);
    }
}

/// Distance that the hands travel relative to the chest, m.
fn hand_travel(text: &str) -> f32 {
    let p = render(text);
    let from_chest = |joint: Joint| {
        let (hand, chest) = (track(&p, joint), track(&p, Joint::Spine3));
        let relative: Vec<Vec3> = hand.iter().zip(&chest).map(|(h, c)| *h - *c).collect();
        relative
            .iter()
            .map(|r| (*r - relative[0]).length())
            .fold(0.0, f32::max)
    };
    from_chest(Joint::LeftWrist).max(from_chest(Joint::RightWrist))
}

/// A foot that stands farther back is nearer to its hip, so that its knee bends more. That knee must move outward, not
/// down into the floor.
#[test]
fn knees_stay_above_the_floor_however_people_stand() {
    for seed in 0..60 {
        let p = parse("fall").unwrap().render(seed);
        let joints = p.motion.joints_in_world();
        let knees = joints.iter().flat_map(|j| {
            [
                j[Joint::LeftKnee as usize].z,
                j[Joint::RightKnee as usize].z,
            ]
        });
        let lowest = knees.fold(f32::MAX, f32::min);
        assert!(lowest > -0.005, "seed {seed}: {lowest} m");
    }
}

#[test]
fn still_arms_stay_at_the_body() {
    for motion in ["jump", "squat"] {
        let moving = hand_travel(&format!("{motion}?repetitions=3"));
        let still = hand_travel(&format!("{motion}?repetitions=3&arms=still"));
        // Hanging arms keep pointing down while the trunk leans by up to 0.5 rad.
        assert!(moving > 0.4 && still < 0.25, "{motion}: {moving}, {still}");
    }
    let height = |text: &str| {
        let z = track(&render(text), Joint::LeftAnkle);
        z.iter().map(|p| p.z).fold(0.0, f32::max) - z[0].z
    };
    assert!(height("jump?arms=still") > 0.05);
    assert!(height("jump?arms=still") < 0.7 * height("jump"));
}

#[test]
fn postures_end_where_they_should() {
    let last =
        |text: &str, joint: Joint| *track(&render(text), joint).last().unwrap_or(&Vec3::ZERO);
    let seat = last("sit_down", Joint::Pelvis).z;
    assert!(
        (0.48..0.58).contains(&seat),
        "pelvis at {seat} m on a seat of 0.45 m"
    );
    assert!(last("sit_down+then+stand_up", Joint::Pelvis).z > 0.9);
    assert!(last("lie_down+then+stand_up", Joint::Pelvis).z > 0.9);
    for text in [
        "lie_down",
        "fall",
        "fall?direction=backward",
        "fall?direction=left",
        "fall?direction=right",
    ] {
        for joint in [Joint::Pelvis, Joint::Head, Joint::Spine3] {
            let z = last(text, joint).z;
            assert!((0.03..0.4).contains(&z), "{text}: {joint:?} at {z} m");
        }
    }
    for (direction, axis) in [
        ("forward", Vec3::NEG_Y),
        ("backward", Vec3::Y),
        ("left", Vec3::X),
        ("right", Vec3::NEG_X),
    ] {
        let p = render(&format!("fall?direction={direction}"));
        let head = track(&p, Joint::Head);
        let moved = *head.last().unwrap_or(&Vec3::ZERO) - head[0];
        assert!(moved.dot(axis) > 0.7, "{direction}: head moved {moved}");
        let fast = head
            .windows(30)
            .map(|w| w[0].z - w[29].z)
            .fold(0.0, f32::max);
        assert!(
            fast > 0.7,
            "{direction}: drops only {fast} m in half a second"
        );
    }
}

#[test]
fn durations_are_kept() {
    for (text, seconds) in [
        ("wave?duration_s=6", 6.0),
        ("sit_down?duration_s=4.5", 4.5),
        ("stand_still?duration_s=2", 2.0),
        ("walk?duration_s=5", 5.0),
        ("walk?duration_s=5&distance_m=3", 5.0),
        ("jump?duration_s=3&repetitions=2", 3.5),
    ] {
        match parse(text) {
            Ok(request) => {
                let got = request.render(3).motion.duration_s();
                // The tolerance is half a frame in both directions.
                assert!((got - seconds).abs() < 0.01, "{text}: {got} s");
            }
            Err(e) => assert!(
                text.starts_with("jump") && e.to_string().contains("does not fit"),
                "{text}: {e}"
            ),
        }
    }
    let (slow, fast) = (
        render("squat?speed=slow").motion.len(),
        render("squat?speed=fast").motion.len(),
    );
    assert!(
        slow as f32 > 1.6 * fast as f32,
        "{slow} against {fast} frames"
    );
}

#[test]
fn the_seed_decides_and_only_the_seed() {
    let request = random_request(5);
    assert_eq!(request.render(1).motion, request.render(1).motion);
    assert_eq!(request.render(1).captions, request.render(1).captions);
    for spec in specs() {
        let request = parse(spec.name).unwrap_or_else(|e| panic!("{e}"));
        let (a, b) = (request.render(1).motion, request.render(2).motion);
        assert_ne!(a, b, "{}", spec.name);
        let n = a.len().min(b.len()) / 2;
        let (ja, jb) = (a.joints_in_world(), b.joints_in_world());
        let apart = Joint::ALL
            .iter()
            .map(|j| (ja[n][*j as usize] - jb[n][*j as usize]).length())
            .fold(0.0, f32::max);
        assert!(
            apart > 0.003,
            "{}: instances differ by {apart} m only",
            spec.name
        );
    }
}

#[test]
fn heading_turns_the_whole_motion() {
    let (plain, turned) = (render("kick"), render("kick?heading_deg=35"));
    let turn = Quat::from_rotation_z(35_f32.to_radians());
    for (a, b) in plain
        .motion
        .joints_in_world()
        .iter()
        .zip(turned.motion.joints_in_world())
    {
        for j in 0..N_JOINTS {
            // f32 rounding.
            assert!((turn * a[j] - b[j]).length() < 1e-4);
        }
    }
}

#[test]
fn requests_round_trip() {
    for seed in 0..300 {
        let text = random_request(seed).to_string();
        let again = parse(&text).unwrap_or_else(|e| panic!("{text}: {e}"));
        assert_eq!(again.to_string(), text);
    }
    assert_eq!(
        parse("walk").map(|r| r.to_string()).ok().as_deref(),
        Some("builtin:walk")
    );
    assert_eq!(render("walk+then+sit_down").action, "walk then sit_down");
    assert_eq!(render("march+while+clap").action, "march while clap");
}

#[test]
fn bad_requests_are_refused_with_what_would_do() {
    for (text, part) in [
        ("", "no motion named"),
        ("builtin:", "no motion named"),
        ("fly", "there are: walk, run"),
        ("walk+then", "joined by"),
        ("walk+and+run", "joined by"),
        ("walk+then+", "no built-in motion ``"),
        ("walk?speed", "expected key=value"),
        (
            "walk?sped=1",
            "it has: after_s, amplitude, before_s, build, direction",
        ),
        ("walk?speed=quick", "slow|normal|fast"),
        ("walk?speed=NaN", "0.4..2"),
        ("walk?speed=inf", "0.4..2"),
        ("walk?speed=9", "0.4..2"),
        ("walk?speed=1&speed=1", "given twice"),
        ("walk?direction=left", "forward|backward"),
        ("walk?run.speed=1", "`run` has no key `speed`"),
        ("squat?repetitions=51", "1..50"),
        ("squat?repetitions=0", "1..50"),
        ("squat?repetitions=-1", "1..50"),
        ("wave?duration_s=61", "0.5..60"),
        ("wave?duration_s=0.6", "does not fit into"),
        ("wave?height_m=3", "1..2"),
        (
            "kick?side=left&direction=right",
            "only one of side and direction",
        ),
        ("walk?speed=1&distance_m=2&duration_s=4", "at most two"),
        ("walk?distance_m=20&duration_s=3", "need at least"),
        ("walk?distance_m=1&duration_s=30", "at most"),
        ("sit_down+then+walk", "put `stand_up` between"),
        ("walk+then+stand_up", "put `sit_down` between"),
        ("fall+then+walk", "nothing can follow"),
        ("jump+while+wave", "possible are: walk"),
        ("walk+while+kick", "possible are: wave"),
        ("walk+while+wave+while+clap", "one `+while+`"),
        ("throw?repetitions=50&speed=0.4", "fewer repetitions"),
    ] {
        match parse(text) {
            Ok(r) => panic!("{text} was read as {r}"),
            Err(e) => assert!(e.to_string().contains(part), "{text}: {e}"),
        }
    }
    assert!(parse(&"a".repeat(5000)).is_err());
    assert!(parse(&format!("walk{}", "+then+walk".repeat(9))).is_err());
}

proptest! {
    #[test]
    fn parse_never_panics(text in ".{0,80}") {
        let _ = parse(&text);
    }

    #[test]
    fn parse_never_panics_on_nearly_right_text(
        names in prop::collection::vec(0..specs().len(), 1..4),
        joins in prop::collection::vec(prop::sample::select(vec!["+then+", "+while+", "+", "&"]), 3),
        keys in prop::collection::vec((prop::sample::select(vec!["speed", "side", "walk.speed", "repetitions", "distance_m", "duration_s", "height_m", "direction", "angle_deg", "x"]), "[a-z0-9.e-]{0,6}"), 0..4),
    ) {
        let mut text = String::from("builtin:");
        for (n, name) in names.iter().enumerate() {
            if n > 0 { text.push_str(joins[n - 1]); }
            text.push_str(specs()[*name].name);
        }
        text.push('?');
        text.push_str(&keys.iter().map(|(k, v)| format!("{k}={v}")).collect::<Vec<_>>().join("&"));
        if let Ok(request) = parse(&text) {
            let again = parse(&request.to_string());
            prop_assert_eq!(again.map(|r| r.to_string()), Ok(request.to_string()));
        }
    }
}

#[test]
fn random_requests_are_broad_and_short() {
    let n = 2000;
    let (mut single, mut sequence, mut overlay, mut going_on) = (0, 0, 0, 0);
    let mut seen = std::collections::BTreeMap::new();
    for seed in 0..n {
        let request = random_request(seed);
        match request.segments.as_slice() {
            [one] if one.overlay.is_some() => overlay += 1,
            [_] => single += 1,
            _ => sequence += 1,
        }
        for part in request.parts() {
            *seen.entry(part.spec.name).or_insert(0) += 1;
        }
        assert!(request.nominal_duration_s() <= LONGEST_S, "{request}");
        let times = request
            .parts()
            .next()
            .map(|p| p.values.count("repetitions"));
        if request.nominal_duration_s() > 0.75 * LONGEST_S && times > Some(1) {
            going_on += i32::from(request.parts().count() == 1);
        }
    }
    // Binomial: three standard deviations are 2.9, 2.7 and 1.5 percentage points.
    let share = |k: i32| 100.0 * f64::from(k) / n as f64;
    assert!(
        (share(single) - 75.0).abs() < 3.0,
        "single {}",
        share(single)
    );
    assert!(
        (share(sequence) - 20.0).abs() < 3.0,
        "then {}",
        share(sequence)
    );
    assert!(
        (share(overlay) - 5.0).abs() < 2.0,
        "while {}",
        share(overlay)
    );
    // A quarter of the single motions with repetitions continue to the time limit, in addition to those that are long
    // anyway.
    let share_on = share(going_on);
    assert!((8.0..25.0).contains(&share_on), "{share_on} % go on");
    // The expected number of each motion is about 2500 / 45 = 55. It is lower for long motions, which rarely fit with
    // others.
    for spec in specs()
        .iter()
        .filter(|s| !["leg_raise", "pace", "walk_turn"].contains(&s.name))
    {
        let count = seen.get(spec.name).copied().unwrap_or(0);
        assert!(count >= 20, "{} only {count} times", spec.name);
    }
}

#[test]
fn a_lunge_with_the_feet_in_place_steps_once() {
    let far_m = |text: &str| {
        let joints = render(text).motion.joints_in_world();
        let at = |i: usize| joints[i][Joint::RightAnkle as usize].truncate();
        let middle = joints.len() / 2;
        let from_start = |i: usize| (at(i) - at(0)).length();
        let nearest = (middle - 40..middle + 40)
            .map(from_start)
            .fold(f32::MAX, f32::min);
        (nearest, from_start(joints.len() - 1))
    };
    // Four repetitions at 20 frames per second take more than 80 frames.
    let (stepping_m, end_m) = far_m("lunge?side=right&repetitions=4");
    assert!(stepping_m < 0.05 && end_m < 0.05, "{stepping_m} {end_m}");
    let (in_place_m, end_m) = far_m("lunge?side=right&repetitions=4&feet=in_place");
    assert!(in_place_m > 0.5 && end_m < 0.05, "{in_place_m} {end_m}");
}

#[test]
fn everyday_motions_are_drawn_more_often() {
    let mut seen = std::collections::HashMap::new();
    for seed in 0..4000 {
        let drawn = people_request(seed);
        for part in drawn.request.parts().filter(|_| !drawn.is_continuous) {
            *seen.entry(part.spec.name).or_insert(0) += 1;
        }
    }
    let times = |name: &str| seen.get(name).copied().unwrap_or(0);
    assert!(times("walk") > 5 * times("limp"), "{seen:?}");
    assert!(times("pick_up") > 2 * times("toe_touch"), "{seen:?}");
    assert!(times("leg_raise") > 20, "{seen:?}");
}

#[test]
fn rendered_random_requests_fit_into_the_window() {
    for seed in 0..200 {
        let p = random_request(seed).render(seed ^ 0x55);
        assert!(
            p.motion.duration_s() <= f64::from(LONGEST_S),
            "{}: {} s",
            p.request,
            p.motion.duration_s()
        );
        assert!(
            (3..=5).contains(&p.captions.len()),
            "{}: {:?}",
            p.request,
            p.captions
        );
    }
}

#[test]
fn captions_are_clean_english_and_say_what_the_motion_does() {
    for seed in 0..2000 {
        let request = random_request(seed);
        for caption in captions::captions(&request, seed) {
            if let Err(reason) = check::language(&caption) {
                panic!("`{caption}`: {reason} ({request})");
            }
            if let Err(reason) = check::facts(&caption, &request) {
                panic!("`{caption}`: {reason} ({request})");
            }
        }
    }
}

#[test]
fn captions_test_values_that_their_motions_have() {
    for spec in specs() {
        let name = spec.name;
        assert!(
            caption_rows(name).any(|row| row.tests.is_empty()),
            "{name}: no caption that always holds"
        );
        for test in caption_rows(name).flat_map(|row| &row.tests) {
            let key = spec
                .key(test.key)
                .unwrap_or_else(|| panic!("{name}: no key `{}`", test.key));
            let fits = match (&test.is, key.kind) {
                (Expected::Word(words), KeyKind::Word { allowed, .. }) => {
                    words.iter().all(|word| allowed.contains(word))
                }
                (Expected::Word(_), _) | (_, KeyKind::Word { .. }) => false,
                _ => true,
            };
            assert!(fits, "{name}: {test:?}");
        }
    }
}

/// Every motion with all its words and with numbers on both sides of the limits at which its captions change.
fn worded_requests() -> Vec<BuiltinRequest> {
    let mut requests = Vec::new();
    for spec in specs() {
        let mut texts = vec![format!("{}?", spec.name)];
        for key in spec.keys {
            let words: Vec<&str> = match (key.kind, key.name) {
                (KeyKind::Word { allowed, .. }, _) => allowed.to_vec(),
                (KeyKind::Speed, _) => vec!["0.7", "1", "1.4"],
                (_, "angle_deg") => vec!["60", "90", "120", "180", "360"],
                (_, "radius_m") => vec!["0.5", "0.8", "1.2"],
                (_, "distance_m") => vec!["0", "0.5", "2"],
                (_, "amplitude") => vec!["0.8", "1", "1.2"],
                (_, "repetitions") => vec!["1", "2", "3"],
                _ => continue,
            };
            let with = |word: &&str| {
                let pair = format!("{}={word}&", key.name);
                texts.iter().map(|text| format!("{text}{pair}")).collect()
            };
            texts = words
                .iter()
                .flat_map(|w| -> Vec<String> { with(w) })
                .collect();
        }
        let requests_of = texts.iter().filter_map(|text| {
            let text = text.trim_end_matches(['&', '?']);
            parse(&format!("builtin:{text}")).ok()
        });
        let before = requests.len();
        requests.extend(requests_of);
        assert!(requests.len() > before, "{}", spec.name);
    }
    requests
}

/// Data sets and trained weights depend on the captions. The hashes change when a motion or its words change; then the
/// changelog has to say so.
#[test]
fn captions_change_only_on_purpose() {
    let hash_of = |requests: &mut dyn Iterator<Item = (BuiltinRequest, u64)>| {
        let mut hash = Fnv1a::new();
        let mut n_captions = 0;
        for (request, seed) in requests {
            for caption in captions::captions(&request, seed) {
                hash.write(caption.as_bytes());
                hash.write(b"\n");
                n_captions += 1;
            }
        }
        (n_captions, hash.finish())
    };
    let worded = worded_requests();
    let worded = worded
        .iter()
        .flat_map(|r| (0..4).map(move |seed| (r.clone(), seed)));
    let random = (0..2000).map(|seed| (random_request(seed), seed));
    let people = (0..500).map(|seed| (crate::people_request(seed).request, seed));
    assert_eq!(
        [
            hash_of(&mut worded.into_iter()),
            hash_of(&mut random.into_iter()),
            hash_of(&mut people.into_iter()),
        ],
        [
            (47_934, 17_432_065_512_986_280_404),
            (7_980, 10_860_775_812_842_762_312),
            (1_968, 12_620_535_298_377_004_133),
        ]
    );
}

#[test]
fn attributes_name_the_facts() {
    let p = render("kick?direction=left&speed=1.5&repetitions=3");
    for fact in [
        ("side", "left"),
        ("direction", "left"),
        ("speed", "fast"),
        ("repetitions", "3"),
    ] {
        assert!(
            p.attributes
                .contains(&(fact.0.to_owned(), fact.1.to_owned())),
            "{fact:?} in {:?}",
            p.attributes
        );
    }
    let p = render("walk+then+wave?walk.speed=slow&wave.side=both");
    assert!(
        p.attributes
            .contains(&("walk.speed".to_owned(), "slow".to_owned()))
    );
    assert!(
        p.attributes
            .contains(&("wave.side".to_owned(), "both".to_owned()))
    );
}

#[test]
fn people_s_motions_are_true_sentences_and_mostly_go_on() {
    let mut n_on = 0;
    for seed in 0..600 {
        let moves = crate::people_request(seed);
        for caption in captions::captions(&moves.request, seed) {
            if let Err(reason) = check::language(&caption) {
                panic!("`{caption}`: {reason} ({})", moves.request);
            }
            if let Err(reason) = check::facts(&caption, &moves.request) {
                panic!("`{caption}`: {reason} ({})", moves.request);
            }
        }
        let length_s = moves.request.nominal_duration_s();
        assert!(
            moves.is_continuous || length_s <= LONGEST_S,
            "{}",
            moves.request
        );
        n_on += i32::from(moves.is_continuous);
    }
    assert!((270..390).contains(&n_on), "{n_on} of 600 go on");
}

/// People jump again and again at about two jumps a second.
#[test]
fn quick_jumps_are_low_and_follow_the_speed() {
    let heights = |speed: f32| {
        let p = render(&format!("jump?arms=still&repetitions=8&speed={speed}"));
        let hips: Vec<f32> = p
            .motion
            .poses
            .iter()
            .map(|pose| pose.root_in_world.y)
            .collect();
        (
            p.motion.duration_s(),
            hips.iter().copied().fold(f32::MIN, f32::max),
        )
    };
    let ((slow_s, high_m), (quick_s, low_m)) = (heights(1.0), heights(2.0));
    let rate_hz = 8.0 / (quick_s - 0.9);
    assert!((1.7..2.5).contains(&rate_hz), "{rate_hz} jumps a second");
    assert!(
        slow_s > 1.7 * quick_s && high_m > low_m,
        "{slow_s} {quick_s} {high_m} {low_m}"
    );
}

#[test]
fn who_wanders_takes_small_steps_about_the_same_place() {
    let p = render("punch?repetitions=14&wander_m=0.3");
    let still = render("punch?repetitions=14");
    let spread = |p: &Procedural, joint| {
        let z: Vec<f32> = track(p, joint).iter().map(|q| q.y).collect();
        z.iter().copied().fold(f32::MIN, f32::max) - z.iter().copied().fold(f32::MAX, f32::min)
    };
    assert!(spread(&still, Joint::Pelvis) < 0.15);
    for joint in [Joint::Pelvis, Joint::LeftAnkle, Joint::RightAnkle] {
        let moved = spread(&p, joint);
        assert!((0.15..0.9).contains(&moved), "{joint:?} moves by {moved} m");
    }
    // One foot stands while the other moves.
    let feet = [track(&p, Joint::LeftAnkle), track(&p, Joint::RightAnkle)];
    let speed = |side: usize, n: usize| feet[side][n].distance(feet[side][n - 1]) * 60.0;
    let both = (1..feet[0].len()).filter(|n| speed(0, *n) > 0.2 && speed(1, *n) > 0.2);
    let share = both.count() as f32 / feet[0].len() as f32;
    assert!(share < 0.1, "both feet move for {share} of the time");
}

#[test]
fn sway_moves_the_pelvis_and_not_the_feet() {
    let p = render("clap?repetitions=20&sway_m=0.1");
    let of = |joint| {
        let y: Vec<f32> = track(&p, joint).iter().map(|q| q.y).collect();
        y.iter().copied().fold(f32::MIN, f32::max) - y.iter().copied().fold(f32::MAX, f32::min)
    };
    assert!(of(Joint::Pelvis) > 0.1, "{}", of(Joint::Pelvis));
    assert!(of(Joint::LeftAnkle) < 0.02, "{}", of(Joint::LeftAnkle));
}

#[test]
fn pauses_hold_the_first_and_the_last_pose() {
    let (plain, paused) = (
        render("sit_down"),
        render("sit_down?before_s=1.5&after_s=2"),
    );
    let extra_s = paused.motion.duration_s() - plain.motion.duration_s();
    assert!((extra_s - 3.5).abs() < 0.02, "{extra_s}");
    let head = track(&paused, Joint::Head);
    let (first, last) = (&head[..85], &head[head.len() - 115..]);
    for part in [first, last] {
        assert!(part.iter().all(|p| p.distance(part[0]) < 0.03));
    }
    assert!(head[0].z - head[head.len() - 1].z > 0.3);
    assert_eq!(plain.captions, paused.captions);
}

#[test]
fn a_boxer_moves_the_weight_between_the_feet() {
    let reach = |text: &str| {
        let p = render(text);
        let y: Vec<f32> = track(&p, Joint::Spine3).iter().map(|q| q.y).collect();
        y.iter().copied().fold(f32::MIN, f32::max) - y.iter().copied().fold(f32::MAX, f32::min)
    };
    let square = reach("punch?repetitions=6&side=both");
    let boxer = reach("punch?repetitions=6&side=both&stance_m=0.5&lean_deg=15");
    assert!(boxer > square + 0.1, "{boxer} {square}");
}

#[test]
fn motions_made_once_are_short_and_waves_have_two_swings_or_more() {
    let (mut n_paused, mut n_raised, mut n_waves) = (0, 0, 0);
    for seed in 0..400 {
        let request = crate::once_request(seed);
        assert_eq!(request.segments.len(), 1, "{request}");
        assert!(request.nominal_duration_s() <= crate::random::LONGEST_S);
        assert_eq!(request.to_string(), crate::once_request(seed).to_string());
        let text = request.to_string();
        n_paused += usize::from(text.contains("before_s="));
        n_raised += usize::from(text.starts_with("builtin:raise_arms"));
        if text.starts_with("builtin:wave") {
            n_waves += 1;
            assert!(!text.contains("repetitions=1&"), "{text}");
        }
    }
    assert!((60..160).contains(&n_paused), "{n_paused}");
    assert!(n_raised > 80 && n_waves > 30, "{n_raised} {n_waves}");
}

#[test]
fn pairs_are_two_motions_that_fit_into_a_window() {
    let mut actions = std::collections::BTreeSet::new();
    for seed in 0..300 {
        let request = crate::pair_request(seed);
        assert_eq!(request.segments.len(), 2, "{request}");
        assert!(request.nominal_duration_s() <= crate::random::LONGEST_S);
        assert_eq!(request.to_string(), crate::pair_request(seed).to_string());
        actions.insert(request.action());
    }
    assert!(actions.len() > 150, "{} pairs", actions.len());
}

#[test]
fn sides_are_drawn_equally_often() {
    let mut sides = std::collections::BTreeMap::<String, usize>::new();
    let mut actions = std::collections::BTreeSet::new();
    let mut n_continuous = 0;
    for seed in 0..600 {
        let drawn = crate::side_request(seed);
        let text = drawn.request.to_string();
        assert_eq!(text, crate::side_request(seed).request.to_string());
        assert_eq!(drawn.request.segments.len(), 1, "{text}");
        if !drawn.is_continuous {
            assert!(drawn.request.nominal_duration_s() <= crate::random::LONGEST_S);
        }
        n_continuous += usize::from(drawn.is_continuous);
        let side = text
            .split(['?', '&'])
            .find_map(|key| key.strip_prefix("side="));
        *sides
            .entry(side.unwrap_or("by direction").into())
            .or_default() += 1;
        actions.insert(drawn.request.action());
    }
    assert!(actions.len() >= 15, "{actions:?}");
    assert!((60..240).contains(&n_continuous), "{n_continuous}");
    let (left, right) = (sides["left"], sides["right"]);
    assert!(
        left.abs_diff(right) < 60 && left > 150 && sides["both"] > 60,
        "{sides:?}"
    );
}
