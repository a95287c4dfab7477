//! The page of points and sentences in a notebook.

use radarllm::{Clip, Segment, page_segments, render::page::Page};

/// What is said about the points of a page.
pub(crate) struct Said<'a> {
    /// The sentence.
    pub caption: &'a str,
    /// The sentences with their times.
    pub segments: &'a [Segment],
    /// Model and confidence.
    pub by: &'a str,
}

/// The self-contained page of a clip.
pub(crate) fn page(clip: &Clip, said: Option<Said<'_>>) -> String {
    let mut provenance = format!(
        "{} radar {} · source {}",
        clip.provenance.kind(),
        clip.radar,
        clip.provenance.input()
    );
    if let Some(said) = &said {
        provenance += &format!(" · {}", said.by);
    }
    let counts = format!("{} points in {} frames", clip.n_points(), clip.frames.len());
    let page = Page {
        caption: said.as_ref().map_or(&counts, |s| s.caption),
        segments: said
            .as_ref()
            .map_or_else(Vec::new, |s| page_segments(s.segments, clip)),
        provenance: &provenance,
        frames: &clip.frames,
        frame_rate_hz: clip.frame_rate_hz,
        radar_height_m: clip.radar_height_m,
        mesh: None,
    };
    page.to_html()
}

/// The page inside another one, as notebooks show it. It may run its script and nothing else.
pub(crate) fn inline(page: &str) -> String {
    let escaped = page.replace('&', "&amp;").replace('"', "&quot;");
    format!(
        "<iframe sandbox=\"allow-scripts\" style=\"width:100%;height:560px;border:0\" srcdoc=\"{escaped}\"></iframe>"
    )
}
