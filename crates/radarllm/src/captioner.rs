//! The captioner: a clip in, a sentence out.

use radarllm_base::{Clip, PointFrame};
use radarllm_inference::{DescribeOptions, Description, PreparedClip, lm::NO_PERSON};
use radarllm_io::{Error, Result};

use radarllm_measure::{Before, Posture, Site};
use radarllm_teach::{Memory, Recogniser};

use crate::{
    Choices, LongDescription, LongRecording, Model,
    findings::Findings,
    gaps::describe_between_gaps,
    general,
    measured::{Measured, unlearned_site},
    taught::taught_segments,
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

    /// Names of the taught activities, in alphabetical order.
    pub fn taught_names(&self) -> Vec<&str> {
        let recogniser = self.recogniser.as_ref();
        recogniser.map(Recogniser::names).unwrap_or_default()
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

    /// What is known of the site.
    pub fn site(&self) -> Option<&Site> {
        self.site.as_ref()
    }

    /// As [`Self::with_site`], for a captioner that is in use.
    pub fn set_site(&mut self, site: Option<Site>) {
        self.site = site;
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

    /// Whether what is said of a clip is measured, and the model only guesses: the clip is a recording of a board that it did
    /// not learn. Taught activities are recognised nevertheless.
    pub fn measures(&self, clip: &Clip) -> bool {
        self.measures && !self.knows_board(clip) && self.choices.is_none()
    }

    /// Whether the model learned recordings of the board of a clip, or the clip is simulated; also if the model does not say
    /// what it learned.
    pub fn knows_board(&self, clip: &Clip) -> bool {
        let confidence = self.model.confidence();
        confidence.is_none_or(|confidence| confidence.knows(clip))
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
        self.describe_at(clip, options, None)
    }

    /// As [`Self::describe_prepared`], of a person in a recording that shows the site: it counts if the captioner has none of
    /// its own.
    ///
    /// # Errors
    /// As [`Self::describe_prepared`].
    pub fn describe_at(
        &self,
        clip: &PreparedClip,
        options: &DescribeOptions,
        site: Option<&Site>,
    ) -> Result<Description> {
        let site = self.site.as_ref().or(site);
        let findings = self.findings(clip, options, site, Before::Nothing)?;
        Ok(findings.description(clip.duration_s()))
    }

    /// Describes a window of one person before a running radar. `earlier` are the frames before it; at its beginning
    /// the person was in this posture, if it is known.
    ///
    /// # Errors
    /// As [`Self::describe_prepared`].
    pub fn describe_window(
        &self,
        clip: &PreparedClip,
        options: &DescribeOptions,
        earlier: &[PointFrame],
        posture: Option<Posture>,
    ) -> Result<Description> {
        let before = Before::Window { earlier, posture };
        let findings = self.findings(clip, options, self.site.as_ref(), before)?;
        Ok(findings.description(clip.duration_s()))
    }

    /// Describes a recording that is too long to be kept in memory, part by part. `each` is called after each part with the
    /// share of the recording that was read, if it is known.
    ///
    /// Radar tokens are not returned.
    ///
    /// # Errors
    /// What the networks refuse, and a recording that cannot be read again.
    pub fn describe_long(
        &self,
        recording: LongRecording,
        options: &DescribeOptions,
        mut each: impl FnMut(Option<f64>),
    ) -> Result<LongDescription> {
        let learned = recording.site.clone().and_then(std::result::Result::ok);
        let site = self.site.clone().or(learned).unwrap_or_else(|| {
            // What is learned of a part would not hold for the next one.
            unlearned_site(&recording.about)
        });
        let mut long = LongDescription::default();
        let mut findings: Option<Findings> = None;
        let mut parts = recording.parts()?;
        while let Some(part) = parts.next().transpose()? {
            let clip = &part.prepared.clip;
            let at_s = part.offset_s + clip.frames.first().map_or(0.0, |frame| frame.time_s);
            let known = findings.as_ref().map(|findings| findings.postures_at(at_s));
            let before = known.as_deref().map_or(Before::Nothing, Before::Part);
            let mut found = self.findings(clip, options, Some(&site), before)?;
            found.shift(part.offset_s);
            found.clip(part.span_s);
            match &mut findings {
                Some(findings) => findings.join(found),
                None => findings = Some(found),
            }
            long.add(&part);
            each(parts.share_read());
        }
        let mut description = findings.unwrap_or_default().description(long.seconds);
        description.tokens.clear();
        let segments = std::mem::take(&mut description.segments);
        description.set_segments(segments);
        if description.segments.is_empty() {
            description.caption = NO_PERSON.into();
        }
        long.description = description;
        Ok(long)
    }

    /// Whether the site belongs to the radar of a clip, whose frames do not matter.
    ///
    /// # Errors
    /// A site of another radar, or of one that was mounted elsewhere.
    pub fn check_site(&self, clip: &Clip) -> Result<()> {
        let is_used = self.measures && !self.knows_board(clip);
        match self.site.as_ref().filter(|_| is_used) {
            Some(site) => fits(site, clip),
            None => Ok(()),
        }
    }

    /// What is found in a clip. Without a site, it is learned from the clip where somebody walks in it.
    fn findings(
        &self,
        clip: &PreparedClip,
        options: &DescribeOptions,
        site: Option<&Site>,
        before: Before,
    ) -> Result<Findings> {
        let confidence = self.model.confidence();
        let is_learned = self.knows_board(clip);
        self.check_site(clip)?;
        let mut findings = Findings::default();
        // What is measured holds for every board; the actions of the model hold for those that it learned.
        let measures = self.measures(clip);
        match measures.then(|| Measured::of(clip, site, before)) {
            Some(Measured::States(states)) => findings.states = Some(states),
            Some(Measured::InPoints(segments)) => findings.in_points = segments,
            None => {}
        }
        if findings.states.is_none() {
            let options = DescribeOptions {
                only_guesses: options.only_guesses || measures,
                weighed: options.weighed && is_learned,
                ..*options
            };
            let model_says = || describe_between_gaps(self.model.networks()?, clip, &options);
            findings.said = Some(match (measures, &self.choices, confidence) {
                (true, ..) => {
                    let mut said = general::describe(clip, &options);
                    if options.guesses && !said.segments.is_empty() {
                        let mut guessed = model_says()?;
                        for guess in &mut guessed.segments {
                            guess.confidence = confidence.map_or(guess.confidence, |fitted| {
                                fitted.of_guess(clip, guessed.windows, guess.confidence)
                            });
                        }
                        general::add_guesses(&mut said, guessed);
                    }
                    said
                }
                (false, Some(choices), _) => {
                    let mut said = model_says()?;
                    self.choose(clip, choices, &options, &mut said)?;
                    said
                }
                (false, None, Some(confidence)) => {
                    let mut said = model_says()?;
                    confidence.apply(clip, &mut said);
                    said
                }
                (false, None, None) => model_says()?,
            });
        }
        if let Some(recogniser) = &self.recogniser {
            findings.taught = taught_segments(clip.moving(), recogniser);
        }
        Ok(findings)
    }
}

/// Refuses a site of another radar, or of one that was mounted elsewhere.
fn fits(site: &Site, clip: &Clip) -> Result<()> {
    /// Difference of two stated heights of one mounting, m.
    const SAME_HEIGHT_M: f32 = 0.1;
    if site.radar != clip.radar {
        return Err(Error::input(format!(
            "the site was learned of the radar `{}`, and this is a recording of `{}`",
            site.radar, clip.radar
        )));
    }
    let stated_m = (!clip.is_height_assumed).then_some(clip.radar_height_m);
    match site.stated_height_m.zip(stated_m) {
        Some((site_m, own_m)) if (site_m - own_m).abs() > SAME_HEIGHT_M => {
            Err(Error::input(format!(
                "the site was learned of a radar {site_m} m above the floor, and this is a recording of one at {own_m} m"
            )))
        }
        _ => Ok(()),
    }
}
