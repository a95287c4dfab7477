//! The captioner: a clip in, a sentence out.

use radarllm_base::Clip;
use radarllm_inference::{DescribeOptions, Description, PreparedClip};
use radarllm_io::{Error, Result};

use radarllm_measure::Site;
use radarllm_teach::{Memory, Recogniser};

use crate::{
    Choices, Model,
    gaps::describe_between_gaps,
    insert_taught,
    measured::{self, Measured},
    taught::insert,
};

/// Describes clips with a [`Model`], and with what its user adds: taught activities, or activities to choose among.
///
/// ```
/// let captioner = radarllm::Captioner::bundled()?;
/// let recording = radarllm::open("builtin:walk?direction=backward").points()?;
/// let description = captioner.describe(&recording.clip)?;
/// assert_eq!(description.segments[0].actions, ["walk"]);
/// # Ok::<(), radarllm::Error>(())
/// ```
pub struct Captioner {
    model: Model,
    recogniser: Option<Recogniser>,
    choices: Option<Choices>,
    site: Option<Site>,
    measures: bool,
}

impl Captioner {
    /// A captioner of a model.
    pub fn new(model: Model) -> Self {
        Self {
            model,
            recogniser: None,
            choices: None,
            site: None,
            measures: true,
        }
    }

    /// A captioner of [`Model::bundled`].
    ///
    /// # Errors
    /// If the library was built without it.
    pub fn bundled() -> Result<Self> {
        Ok(Self::new(Model::bundled()?))
    }

    /// The captioner with taught activities: where one is recognised, its own sentence is used.
    #[must_use]
    pub fn with_memory(mut self, memory: &Memory) -> Self {
        self.recogniser = Recogniser::new(memory);
        self
    }

    /// The captioner restricted to named activities: a clip gets a sentence of the one that fits best, and the
    /// probabilities of all.
    #[must_use]
    pub fn with_choices(self, choices: Choices) -> Self {
        Self {
            choices: Some(choices),
            ..self
        }
    }

    /// The captioner with what is known of a site. With `None`, the site is learned from each recording in which somebody
    /// walks.
    #[must_use]
    pub fn with_site(self, site: Option<Site>) -> Self {
        Self { site, ..self }
    }

    /// The captioner that states the sentences of the model on every board, also on those of which it learned nothing and
    /// where it is nearly always wrong. For comparisons.
    #[must_use]
    pub fn without_measuring(self) -> Self {
        Self {
            measures: false,
            ..self
        }
    }

    /// Name of the model in reports; see [`Model::name`].
    pub fn name(&self) -> &str {
        self.model.name()
    }

    /// The model, whose networks also describe batches and tokenize.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Describes a clip by a vote of drawn sentences. The clip is prepared for the model: resampled to its frame rate and, if recorded,
    /// without static clutter.
    ///
    /// # Errors
    /// Values that are not finite, or an impossible frame rate.
    pub fn describe(&self, clip: &Clip) -> Result<Description> {
        self.describe_with(clip, &DescribeOptions::default())
    }

    /// Describes a clip.
    ///
    /// # Errors
    /// As [`Self::describe`].
    pub fn describe_with(&self, clip: &Clip, options: &DescribeOptions) -> Result<Description> {
        let clip = PreparedClip::of(clip).map_err(Error::wrap)?;
        self.describe_prepared(&clip, options)
    }

    /// Describes a clip that is prepared already, by [`crate::Recording::prepared`] for example.
    ///
    /// # Errors
    /// What the networks refuse.
    pub fn describe_prepared(
        &self,
        clip: &PreparedClip,
        options: &DescribeOptions,
    ) -> Result<Description> {
        let confidence = self.model.confidence();
        let is_known = !self.measures || confidence.is_none_or(|confidence| confidence.knows(clip));
        if let Some(site) = &self.site
            && !is_known
            && site.radar != clip.radar
        {
            return Err(Error::input(format!(
                "the site was learned of the radar `{}`, and this is a recording of `{}`",
                site.radar, clip.radar
            )));
        }
        // What is measured holds for every board; the actions of the model hold for those that it learned.
        let measured =
            (!is_known && self.choices.is_none()).then(|| Measured::of(clip, self.site.as_ref()));
        let mut description = match &measured {
            Some(Measured::States(states)) => measured::description(clip, states),
            _ => {
                let options = DescribeOptions {
                    only_guesses: options.only_guesses || measured.is_some(),
                    ..*options
                };
                describe_between_gaps(self.model.networks(), clip, &options)?
            }
        };
        match (&self.choices, confidence, measured) {
            (Some(choices), ..) => self.choose(clip, choices, options, &mut description)?,
            (None, _, Some(Measured::States(_))) => {}
            (None, Some(confidence), in_points) => {
                confidence.apply(clip, is_known, &mut description);
                if let Some(Measured::InPoints(segments)) = in_points {
                    insert(&mut description, segments);
                }
            }
            (None, None, _) => {}
        }
        if let Some(recogniser) = &self.recogniser {
            insert_taught(&mut description, clip.moving(), recogniser);
        }
        Ok(description)
    }
}
