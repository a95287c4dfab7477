//! Mapping of the joints of other skeletons to the joints of SMPL-X.
//!
//! Limbs and head are identified by name, from tables of the words that rigs use. Pelvis, chest,
//! neck, collars and spine are identified by their position between those, because their names
//! (`Hip`, `Spine1`, `Shoulder`) have different meanings in different rigs.

use super::source::SourceMotion;
use radarllm_base::Joint;
use radarllm_base::skeleton::N_JOINTS;

/// Source joint of every SMPL-X joint.
pub(crate) type JointMap = [Option<usize>; N_JOINTS];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Left,
    Right,
    Middle,
}

/// Words before the bone's own name that carry no information.
const PREFIXES: [&str; 12] = [
    "cc",
    "mixamorig",
    "bip01",
    "bip001",
    "bip",
    "joint",
    "skeleton",
    "character",
    "character1",
    "rig",
    "def",
    "avg",
];

/// Names of limb joints in order of preference. If a rig has two of them, the later one has another
/// meaning (`shoulder` is the upper arm only if there is no `arm`).
const HIP: &[&str] = &["upleg", "upperleg", "thigh", "femur", "legupper", "hip"];
const KNEE: &[&str] = &[
    "knee", "lowerleg", "lowleg", "calf", "shin", "tibia", "leglower", "leg",
];
const ANKLE: &[&str] = &["ankle", "foot"];
const FOOT: &[&str] = &[
    "toebase",
    "toe",
    "toes",
    "ball",
    "toe0",
    "toebasesharebone",
    "foot",
];
const SHOULDER: &[&str] = &[
    "upperarm", "uparm", "humerus", "armupper", "arm", "shoulder", "shldr",
];
const ELBOW: &[&str] = &[
    "elbow", "forearm", "lowerarm", "lowarm", "radius", "armlower",
];
const WRIST: &[&str] = &["wrist", "hand"];
const HEAD: &[&str] = &["head", "skull"];
const PELVIS: &[&str] = &["hips", "pelvis", "hip", "root"];

/// Maps a source skeleton. `lengths` are the distances of joints from their parents in the rest
/// pose or the first frame. They are used to skip joints that coincide with their parent.
pub(crate) fn map_joints(source: &SourceMotion, lengths: &[f32]) -> JointMap {
    let named: Vec<(Side, String)> = source.joints.iter().map(|j| split_name(&j.name)).collect();
    let find =
        |side: Side, words: &[&str], below: Option<usize>, not: Option<usize>| -> Option<usize> {
            words.iter().find_map(|word| {
                (0..named.len()).find(|&j| {
                    named[j].0 == side
                        && named[j].1 == *word
                        && Some(j) != not
                        && below.is_none_or(|b| j != b && source.descends(j, b))
                })
            })
        };

    let mut map: JointMap = [None; N_JOINTS];
    for (side, leg, arm) in [
        (
            Side::Left,
            [
                Joint::LeftHip,
                Joint::LeftKnee,
                Joint::LeftAnkle,
                Joint::LeftFoot,
            ],
            [Joint::LeftShoulder, Joint::LeftElbow, Joint::LeftWrist],
        ),
        (
            Side::Right,
            [
                Joint::RightHip,
                Joint::RightKnee,
                Joint::RightAnkle,
                Joint::RightFoot,
            ],
            [Joint::RightShoulder, Joint::RightElbow, Joint::RightWrist],
        ),
    ] {
        let mut above = None;
        for (joint, words) in leg.into_iter().zip([HIP, KNEE, ANKLE, FOOT]) {
            // A `foot` below an `ankle` is the ball of the foot; a `foot` below a knee is the
            // ankle.
            let found = find(side, words, above, above);
            map[joint as usize] = found;
            above = found.or(above);
        }
        let mut above = None;
        for (joint, words) in arm.into_iter().zip([SHOULDER, ELBOW, WRIST]) {
            let found = find(side, words, above, above);
            map[joint as usize] = found;
            above = found.or(above);
        }
    }
    map[Joint::Head as usize] = find(Side::Middle, HEAD, None, None);
    map_trunk(source, lengths, &named, &mut map);
    map
}

/// Determines pelvis, spine, neck and collars from the limbs.
fn map_trunk(source: &SourceMotion, lengths: &[f32], named: &[(Side, String)], map: &mut JointMap) {
    let get = |map: &JointMap, joint: Joint| map[joint as usize];
    let lower: Vec<usize> = [Joint::LeftHip, Joint::RightHip]
        .iter()
        .filter_map(|j| get(map, *j))
        .collect();
    let mut upper: Vec<usize> = [Joint::LeftShoulder, Joint::RightShoulder]
        .iter()
        .filter_map(|j| get(map, *j))
        .collect();
    upper.extend(get(map, Joint::Head));

    let everything: Vec<usize> = lower.iter().chain(&upper).copied().collect();
    let pelvis = (lower.len() == 2 && !upper.is_empty())
        .then(|| common_ancestor(source, &everything))
        .flatten()
        .or_else(|| {
            PELVIS.iter().find_map(|word| {
                named
                    .iter()
                    .position(|(s, n)| *s == Side::Middle && n == word)
            })
        })
        .unwrap_or(0);
    map[Joint::Pelvis as usize] = Some(pelvis);

    let chest = (upper.len() >= 2)
        .then(|| common_ancestor(source, &upper))
        .flatten();
    let Some(chest) = chest.filter(|&c| c != pelvis && source.descends(c, pelvis)) else {
        return;
    };
    // From the pelvis (exclusive) to the chest (inclusive), lowest first.
    let mut spine: Vec<usize> = source
        .path_to_root(chest)
        .into_iter()
        .take_while(|&j| j != pelvis)
        .collect();
    spine.reverse();
    let (n, last) = (spine.len(), spine.len() - 1);
    map[Joint::Spine3 as usize] = Some(spine[last]);
    if n >= 2 {
        map[Joint::Spine1 as usize] = Some(spine[0]);
    }
    if n >= 3 {
        map[Joint::Spine2 as usize] = Some(spine[last - 1]);
    }

    if let Some(head) = map[Joint::Head as usize].filter(|&h| source.descends(h, chest)) {
        let mut neck: Vec<usize> = source
            .path_to_root(head)
            .into_iter()
            .take_while(|&j| j != chest)
            .collect();
        neck.reverse();
        neck.pop();
        // CMU's BVH conversion places `Neck` at the chest and `Neck1` at the neck.
        let apart = neck
            .iter()
            .find(|&&j| lengths[j] > 1e-3 * lengths.iter().sum::<f32>() / lengths.len() as f32);
        map[Joint::Neck as usize] = apart.or(neck.first()).copied();
    }
    for (shoulder, collar) in [
        (Joint::LeftShoulder, Joint::LeftCollar),
        (Joint::RightShoulder, Joint::RightCollar),
    ] {
        if let Some(s) = map[shoulder as usize].filter(|&s| source.descends(s, chest)) {
            map[collar as usize] = source.joints[s].parent.filter(|&p| p != chest);
        }
    }
}

/// Deepest joint that is on the paths of all `joints` to their root.
fn common_ancestor(source: &SourceMotion, joints: &[usize]) -> Option<usize> {
    let (first, others) = joints.split_first()?;
    source
        .path_to_root(*first)
        .into_iter()
        .find(|&a| others.iter().all(|&j| source.descends(j, a)))
}

/// Side and bare lower-case word of a joint name: `CC_Base_L_Upperarm` gives (left, `upperarm`).
fn split_name(name: &str) -> (Side, String) {
    let name = name.rsplit([':', '|']).next().unwrap_or(name);
    let mut words: Vec<String> = Vec::new();
    let chars: Vec<char> = name.chars().collect();
    let mut word = String::new();
    for (i, &c) in chars.iter().enumerate() {
        let boundary = c.is_uppercase()
            && i > 0
            && (chars[i - 1].is_lowercase() || chars.get(i + 1).is_some_and(|n| n.is_lowercase()));
        if (boundary || !c.is_alphanumeric()) && !word.is_empty() {
            words.push(std::mem::take(&mut word));
        }
        if c.is_alphanumeric() {
            word.extend(c.to_lowercase());
        }
    }
    if !word.is_empty() {
        words.push(word);
    }
    while words.len() > 1 && PREFIXES.contains(&words[0].as_str()) {
        let dropped = words.remove(0);
        if dropped == "cc" && words.len() > 1 && words[0] == "base" {
            words.remove(0);
        }
    }
    let mut side = Side::Middle;
    words.retain(|w| {
        let found = match w.as_str() {
            "l" | "left" => Side::Left,
            "r" | "right" => Side::Right,
            _ => return true,
        };
        side = found;
        false
    });
    let mut base = words.concat();
    if side == Side::Middle {
        // Names such as `lfemur` of ASF and `leftupleg` of rigs without capitals.
        let known = |rest: &str| {
            [HIP, KNEE, ANKLE, FOOT, SHOULDER, ELBOW, WRIST]
                .iter()
                .any(|words| words.contains(&rest))
                || ["clavicle", "collar", "hipjoint", "fingers", "thumb"].contains(&rest)
        };
        for (prefix, found) in [
            ("left", Side::Left),
            ("right", Side::Right),
            ("l", Side::Left),
            ("r", Side::Right),
        ] {
            if let Some(rest) = base.strip_prefix(prefix).filter(|rest| known(rest)) {
                side = found;
                base = rest.to_owned();
                break;
            }
        }
    }
    (side, base)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_many_rigs_are_understood() {
        for (name, side, word) in [
            ("CC_Base_L_Upperarm", Side::Left, "upperarm"),
            ("CC_Base_L_ToeBase", Side::Left, "toebase"),
            ("mixamorig:RightUpLeg", Side::Right, "upleg"),
            ("LHipJoint", Side::Left, "hipjoint"),
            ("lfemur", Side::Left, "femur"),
            ("rradius", Side::Right, "radius"),
            ("UpperLeg_R", Side::Right, "upperleg"),
            ("joint_Root", Side::Middle, "root"),
            ("left_hip", Side::Left, "hip"),
            ("L_Hip", Side::Left, "hip"),
            ("Bip01 L Thigh", Side::Left, "thigh"),
            ("LeftForeArm", Side::Left, "forearm"),
            ("rightfoot", Side::Right, "foot"),
            ("leg", Side::Middle, "leg"),
            ("rShldr", Side::Right, "shldr"),
            ("lThigh", Side::Left, "thigh"),
            ("lowerneck", Side::Middle, "lowerneck"),
            ("root", Side::Middle, "root"),
        ] {
            assert_eq!(split_name(name), (side, word.to_owned()), "{name}");
        }
    }
}
