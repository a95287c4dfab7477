//! A captioned motion as training data of the language model.

use std::collections::BTreeMap;

use radarllm_dataset::record::ClipRecord;
use radarllm_inference::tokenizer::Encoded;

/// Codes and captions of one motion.
#[derive(Clone, Debug, PartialEq)]
pub struct LmClip {
    /// Motion id, for messages.
    pub id: String,
    /// Action label.
    pub action: String,
    /// Captions; at least one.
    pub captions: Vec<String>,
    /// Codes of each simulation of the motion; at least one.
    pub variants: Vec<Encoded>,
    /// Codes of the same simulations with points mirrored in x, or empty.
    pub flipped: Vec<Encoded>,
    /// Length of the motion, s.
    pub seconds: f32,
}

/// Clips of motions, by the id of the motion, of which variants are added one by one.
#[derive(Default)]
pub(crate) struct Motions<'a>(BTreeMap<&'a str, LmClip>);

impl<'a> Motions<'a> {
    /// Adds a variant of the motion of `record`, and the codes of its mirror image if they are wanted. `seconds` are those of
    /// the first variant.
    pub(crate) fn add(
        &mut self,
        record: &'a ClipRecord,
        seconds: f32,
        codes: Encoded,
        mirrored: Option<Encoded>,
    ) {
        let entry = self.0.entry(&record.motion_id).or_insert_with(|| LmClip {
            id: record.motion_id.clone(),
            action: record.action.clone(),
            captions: record.captions.clone(),
            variants: Vec::new(),
            flipped: Vec::new(),
            seconds,
        });
        entry.variants.push(codes);
        entry.flipped.extend(mirrored);
    }

    /// The clips, one for each motion.
    pub(crate) fn into_clips(self) -> Vec<LmClip> {
        self.0.into_values().collect()
    }
}
