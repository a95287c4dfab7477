//! The page of a described clip.

use radarllm_base::Clip;
use radarllm_inference::Segment;
use radarllm_render::page::PageSegment;

/// Segments with times from the first frame of their clip, as [`radarllm_render::page::Page`] shows them.
pub fn page_segments<'a>(segments: &'a [Segment], clip: &Clip) -> Vec<PageSegment<'a>> {
    let first_s = clip.frames.first().map_or(0.0, |f| f.time_s);
    let shown = |segment: &'a Segment| PageSegment {
        start_s: segment.start_s - first_s,
        end_s: segment.end_s - first_s,
        caption: &segment.caption,
        confidence: segment.confidence,
    };
    segments.iter().map(shown).collect()
}
