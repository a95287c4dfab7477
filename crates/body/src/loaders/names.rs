//! Mapping of the joints of other skeletons to the joints of SMPL-X.
//!
//! Limbs and head are identified by name, from tables of the words that rigs use. Pelvis, chest,
//! neck, collars and spine are identified by their position between those, because their names
//! (`Hip`, `Spine1`, `Shoulder`) have different meanings in different rigs.

use std::collections::BTreeMap;

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

/// Words before the bone's own name that carry no information. Others are recognised because nearly all joints share them.
const PREFIXES: [&str; 13] = [
    "cc",
    // VRM: `J_Bip_L_UpperLeg`.
    "j",
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

/// Words after the bone's own name that carry no information: the kind of the joint, and parts of a limb that deforms.
const SUFFIXES: [&str; 7] = ["jnt", "bone", "bn", "bind", "bend", "stretch", "skin"];

/// Words of joints in the middle of the body: `J_Bip_C_Hips` (VRM), `head.x` (Auto-Rig Pro), `Root_M` (AdvancedSkeleton).
const MIDDLE: [&str; 3] = ["c", "x", "m"];

/// Words of sides.
const SIDES: [(&str, Side); 4] = [
    ("l", Side::Left),
    ("left", Side::Left),
    ("r", Side::Right),
    ("right", Side::Right),
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
    "toebaseshare",
    "foot",
];
const SHOULDER: &[&str] = &[
    "upperarm", "uparm", "humerus", "armupper", "uarm", "arm", "shoulder", "shldr",
];
const ELBOW: &[&str] = &[
    "elbow", "forearm", "lowerarm", "lowarm", "radius", "armlower", "farm",
];
const WRIST: &[&str] = &["wrist", "hand"];
const HEAD: &[&str] = &["head", "skull"];
const PELVIS: &[&str] = &["hips", "pelvis", "hip", "root"];

/// Maps a source skeleton. `lengths` are the distances of joints from their parents in the rest
/// pose or the first frame. They are used to skip joints that coincide with their parent.
pub(crate) fn map_joints(source: &SourceMotion, lengths: &[f32]) -> JointMap {
    let named = split_names(source.joints.iter().map(|j| j.name.as_str()));
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

/// [`split_name`] of all joints of a skeleton, without the words with which nearly all of its names begin or end
/// (`Robot_LeftArm`, `ValveBiped.Bip01_L_Thigh`, `left_arm_joint`).
fn split_names<'a>(names: impl Iterator<Item = &'a str>) -> Vec<(Side, String)> {
    let mut words: Vec<Vec<String>> = names.map(words_of).collect();
    while let Some(shared) = shared_word(&words, <[String]>::first) {
        for words in &mut words {
            if words.len() > 1 && words.first() == Some(&shared) {
                words.remove(0);
            }
        }
    }
    while let Some(shared) = shared_word(&words, <[String]>::last) {
        for words in &mut words {
            if words.len() > 1 && words.last() == Some(&shared) {
                words.pop();
            }
        }
    }
    words.into_iter().map(split_name).collect()
}

/// The word at one end of nearly all names, of those that have several words, unless it is a side.
fn shared_word(names: &[Vec<String>], end: fn(&[String]) -> Option<&String>) -> Option<String> {
    let several = names.iter().filter(|words| words.len() > 1);
    let mut counts: BTreeMap<&String, usize> = BTreeMap::new();
    for word in several.filter_map(|words| end(words)) {
        *counts.entry(word).or_default() += 1;
    }
    let (word, n) = counts.into_iter().max_by_key(|(_, n)| *n)?;
    let is_side = SIDES.iter().any(|(side, _)| side == word);
    // The root often has another name.
    (!is_side && n > 1 && 5 * n >= 4 * names.len()).then(|| word.clone())
}

/// Words of a joint name in lower case, without its name space: `mixamorig:RightUpLeg` gives `right`, `up`, `leg`.
fn words_of(name: &str) -> Vec<String> {
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
    words
}

/// Side and bare lower-case word of the words of a joint name: `CC_Base_L_Upperarm` gives (left, `upperarm`).
fn split_name(mut words: Vec<String>) -> (Side, String) {
    while words.len() > 1 && PREFIXES.contains(&words[0].as_str()) {
        let dropped = words.remove(0);
        if dropped == "cc" && words.len() > 1 && words[0] == "base" {
            words.remove(0);
        }
    }
    let mut side = Side::Middle;
    words.retain(|w| match SIDES.iter().find(|(word, _)| word == w) {
        Some((_, found)) => {
            side = *found;
            false
        }
        None => true,
    });
    if side == Side::Middle && words.len() > 1 {
        let is_middle = |w: &String| MIDDLE.contains(&w.as_str());
        if let Some(at) = words.iter().position(is_middle) {
            words.remove(at);
        }
    }
    while words.len() > 1 && words.last().is_some_and(|w| SUFFIXES.contains(&w.as_str())) {
        words.pop();
    }
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
            assert_eq!(
                split_name(words_of(name)),
                (side, word.to_owned()),
                "{name}"
            );
        }
    }

    /// Names of pelvis, left and right upper leg, lower leg, foot, head, upper arm, lower arm and hand.
    fn assert_understood(program: &str, names: [&str; 14]) {
        let words = split_names(names.into_iter());
        let find = |side: Side, wanted: &[&str]| {
            let is_it = |(s, w): &&(Side, String)| *s == side && wanted.contains(&w.as_str());
            words.iter().filter(is_it).count()
        };
        assert_eq!(find(Side::Middle, PELVIS), 1, "{program}: {words:?}");
        assert_eq!(find(Side::Middle, HEAD), 1, "{program}: {words:?}");
        for side in [Side::Left, Side::Right] {
            for wanted in [HIP, KNEE, ANKLE, SHOULDER, ELBOW, WRIST] {
                assert_ne!(find(side, wanted), 0, "{program} {wanted:?}: {words:?}");
            }
        }
    }

    #[test]
    fn names_of_whole_skeletons_are_understood() {
        /// Names from a pattern of each program, in which `@` is the side.
        fn both(pelvis: &str, head: &str, limbs: [&str; 6], sides: [&str; 2]) -> [String; 14] {
            let mut names = vec![pelvis.to_owned(), head.to_owned()];
            for side in sides {
                names.extend(limbs.map(|limb| limb.replace('@', side)));
            }
            names.try_into().unwrap()
        }
        for (program, pelvis, head, limbs, sides) in [
            (
                "VRM",
                "J_Bip_C_Hips",
                "J_Bip_C_Head",
                [
                    "J_Bip_@_UpperLeg",
                    "J_Bip_@_LowerLeg",
                    "J_Bip_@_Foot",
                    "J_Bip_@_UpperArm",
                    "J_Bip_@_LowerArm",
                    "J_Bip_@_Hand",
                ],
                ["L", "R"],
            ),
            (
                "Unreal",
                "pelvis",
                "head",
                [
                    "thigh_@",
                    "calf_@",
                    "foot_@",
                    "upperarm_@",
                    "lowerarm_@",
                    "hand_@",
                ],
                ["l", "r"],
            ),
            (
                "Auto-Rig Pro",
                "root.x",
                "head.x",
                [
                    "thigh_stretch.@",
                    "leg_stretch.@",
                    "foot.@",
                    "arm_stretch.@",
                    "forearm_stretch.@",
                    "hand.@",
                ],
                ["l", "r"],
            ),
            (
                "Daz Genesis 8",
                "hip",
                "head",
                [
                    "@ThighBend",
                    "@Shin",
                    "@Foot",
                    "@ShldrBend",
                    "@ForearmBend",
                    "@Hand",
                ],
                ["l", "r"],
            ),
            (
                "AdvancedSkeleton",
                "Root_M",
                "Head_M",
                [
                    "Hip_@",
                    "Knee_@",
                    "Ankle_@",
                    "Shoulder_@",
                    "Elbow_@",
                    "Wrist_@",
                ],
                ["L", "R"],
            ),
            (
                "Motive",
                "Skeleton_Hip",
                "Skeleton_Head",
                [
                    "Skeleton_@Thigh",
                    "Skeleton_@Shin",
                    "Skeleton_@Foot",
                    "Skeleton_@UArm",
                    "Skeleton_@FArm",
                    "Skeleton_@Hand",
                ],
                ["L", "R"],
            ),
            (
                "Source",
                "ValveBiped.Bip01_Pelvis",
                "ValveBiped.Bip01_Head",
                [
                    "ValveBiped.Bip01_@_Thigh",
                    "ValveBiped.Bip01_@_Calf",
                    "ValveBiped.Bip01_@_Foot",
                    "ValveBiped.Bip01_@_UpperArm",
                    "ValveBiped.Bip01_@_Forearm",
                    "ValveBiped.Bip01_@_Hand",
                ],
                ["L", "R"],
            ),
            (
                "Perception Neuron",
                "Robot_Hips",
                "Robot_Head",
                [
                    "Robot_@UpLeg",
                    "Robot_@Leg",
                    "Robot_@Foot",
                    "Robot_@Arm",
                    "Robot_@ForeArm",
                    "Robot_@Hand",
                ],
                ["Left", "Right"],
            ),
            (
                "joints of Maya",
                "hero_pelvis_jnt",
                "hero_head_jnt",
                [
                    "hero_@_hip_jnt",
                    "hero_@_knee_jnt",
                    "hero_@_ankle_jnt",
                    "hero_@_shoulder_jnt",
                    "hero_@_elbow_jnt",
                    "hero_@_wrist_jnt",
                ],
                ["L", "R"],
            ),
        ] {
            let names = both(pelvis, head, limbs, sides);
            assert_understood(program, std::array::from_fn(|i| names[i].as_str()));
        }
    }

    #[test]
    fn only_words_that_nearly_all_names_share_are_dropped() {
        let names = ["LeftArm", "LeftHand", "LeftLeg", "LeftFoot"];
        assert_eq!(
            split_names(names.into_iter())[0],
            (Side::Left, "arm".into())
        );
        let names = ["left_arm_joint", "left_hip_joint", "head_joint"];
        assert_eq!(
            split_names(names.into_iter())[1],
            (Side::Left, "hip".into())
        );
        let names = ["hand_index", "hand_thumb", "foot_toe"];
        assert_eq!(
            split_names(names.into_iter())[0],
            (Side::Middle, "handindex".into())
        );
        // One joint shares its words with nobody.
        assert_eq!(
            split_names(["upper_leg"].into_iter())[0],
            (Side::Middle, "upperleg".into())
        );
        assert!(split_names(std::iter::empty()).is_empty());
        assert_eq!(
            split_names([""].into_iter()),
            [(Side::Middle, String::new())]
        );
    }
}
