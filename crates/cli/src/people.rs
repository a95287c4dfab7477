//! `--people`: who is in a recording, and the points of each.

use std::path::{Path, PathBuf};

use clap::Args;
use radarllm_base::PointFrame;
use radarllm_tracking::{Ghost, GhostPath, Track, TrackOptions, find_ghosts, track};
use serde::Serialize;

use crate::{error::CliResult, input::Clip, recording};

/// Whether to follow people.
#[derive(Args, Clone, Debug, Default)]
pub struct PeopleArgs {
    /// Follow people and hand on the points of each: at most so many, those with the most points, or `auto`.
    #[arg(long, value_name = "N|auto", value_parser = most)]
    pub people: Option<Most>,
    /// Leave out people who are reflections of others over a wall, and their points.
    #[arg(long)]
    pub drop_ghosts: bool,
}

/// How many people.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Most {
    /// As many as there are.
    Auto,
    /// At most so many.
    People(usize),
}

fn most(text: &str) -> Result<Most, String> {
    match text.parse::<usize>() {
        _ if text == "auto" => Ok(Most::Auto),
        Ok(n) if (1..=100).contains(&n) => Ok(Most::People(n)),
        _ => Err("must be 1 to 100, or auto".into()),
    }
}

/// A person, as scripts read it.
#[derive(Clone, Debug, Serialize)]
pub struct Person {
    /// Number of the track, from 1.
    pub id: u32,
    /// Start of the first frame in which the person was seen, s.
    pub start_s: f64,
    /// Start of the last one, s.
    pub end_s: f64,
    /// Points over all frames.
    pub points: usize,
}

/// A track that is a reflection, as scripts read it.
#[derive(Clone, Debug, Serialize)]
pub struct GhostReport {
    /// Number of the track.
    pub id: u32,
    /// Number of the person's.
    pub of: u32,
    /// `one way` or `both ways` over the wall.
    pub path: &'static str,
    /// Direction of the wall, degrees to the right.
    pub wall_azimuth_deg: f64,
    /// Distance of the wall, m.
    pub wall_m: f64,
    /// Loss against the person, range taken off, dB.
    pub loss_db: f64,
}

impl From<&Ghost> for GhostReport {
    fn from(ghost: &Ghost) -> Self {
        Self {
            id: ghost.id,
            of: ghost.of,
            path: match ghost.path {
                GhostPath::BothWays => "both ways",
                GhostPath::OneWay => "one way",
            },
            wall_azimuth_deg: ghost.wall_azimuth_rad.to_degrees(),
            wall_m: ghost.wall_m,
            loss_db: ghost.loss_db,
        }
    }
}

/// Who was found.
#[derive(Default)]
pub struct Found {
    /// People, in the order in which they were first seen.
    pub tracks: Vec<Track>,
    /// Reflections, which are not among them.
    pub ghosts: Vec<GhostReport>,
}

impl PeopleArgs {
    /// Whether anything is asked for.
    pub fn is_given(&self) -> bool {
        self.people.is_some() || self.drop_ghosts
    }

    /// Follows people. With `--drop-ghosts` their reflections go, and the reflections' points out of `frames`. Surroundings
    /// are nobody's points, which is noted, unless `keep_still`.
    pub fn find(
        &self,
        frames: &mut [PointFrame],
        keep_still: bool,
        notes: &mut Vec<String>,
    ) -> CliResult<Found> {
        if !self.is_given() {
            return Ok(Found::default());
        }
        let mut options = TrackOptions::default();
        if !keep_still && let Some(note) = recording::surroundings(frames) {
            options.cluster.slowest_mps = f64::from(recording::STANDING_MPS);
            notes.push(format!(
                "{note}: they are nobody's (--slowest 0 keeps them)"
            ));
        }
        let mut tracks = track(frames, &options)?;
        let mut ghosts = Vec::new();
        if self.drop_ghosts {
            ghosts = find_ghosts(&tracks, frames);
            let is_ghost = |track: &Track| ghosts.iter().any(|g| g.id == track.id);
            // What is left keeps its place: other tracks point at it.
            let mut gone: Vec<Vec<u32>> = vec![Vec::new(); frames.len()];
            for at in tracks
                .iter()
                .filter(|t| is_ghost(t))
                .flat_map(|t| &t.frames)
            {
                gone[at.frame].extend(&at.points);
            }
            tracks.retain(|t| !is_ghost(t));
            for at in tracks.iter_mut().flat_map(|t| &mut t.frames) {
                let gone = &gone[at.frame];
                for point in &mut at.points {
                    *point -= gone.iter().filter(|g| *g < point).count() as u32;
                }
            }
            for (frame, gone) in frames.iter_mut().zip(&gone) {
                let mut index = 0;
                frame.points.retain(|_| {
                    index += 1;
                    !gone.contains(&(index - 1))
                });
            }
        }
        if let Some(Most::People(n)) = self.people {
            let mut counts: Vec<(usize, u32)> =
                tracks.iter().map(|t| (t.n_points(), t.id)).collect();
            counts.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
            counts.truncate(n);
            tracks.retain(|t| counts.iter().any(|(_, id)| *id == t.id));
        }
        Ok(Found {
            tracks,
            ghosts: ghosts.iter().map(GhostReport::from).collect(),
        })
    }

    /// Clips of every person in a clip, each from the first to the last frame in which the person was seen. Without
    /// anybody the clip alone, with no points.
    pub fn clips(&self, clip: Clip) -> CliResult<Vec<(Option<Person>, Clip)>> {
        let mut clip = clip;
        // What stands still was left out, or kept, when the clip was prepared.
        let found = self.find(&mut clip.frames, true, &mut Vec::new())?;
        for ghost in &found.ghosts {
            eprintln!("{}: {}", clip.provenance.source, describe_ghost(ghost));
        }
        if self.people.is_none() {
            return Ok(vec![(None, clip)]);
        }
        if found.tracks.is_empty() {
            clip.frames.iter_mut().for_each(|f| f.points.clear());
            return Ok(vec![(None, clip)]);
        }
        let one = |track: &Track| {
            let person = Person::of(track, &clip.frames);
            let alone = Clip {
                frames: track.points(&clip.frames),
                frame_rate_hz: clip.frame_rate_hz,
                radar_height_m: clip.radar_height_m,
                provenance: clip.provenance.clone(),
                performed: None,
            };
            (Some(person), alone)
        };
        Ok(found.tracks.iter().map(one).collect())
    }
}

impl Person {
    /// Of a track through these frames.
    pub fn of(track: &Track, frames: &[PointFrame]) -> Self {
        let time_s = |at: Option<&radarllm_tracking::TrackFrame>| {
            at.and_then(|at| frames.get(at.frame))
                .map_or(0.0, |f| f.time_s)
        };
        Self {
            id: track.id,
            start_s: time_s(track.frames.first()),
            end_s: time_s(track.frames.last()),
            points: track.n_points(),
        }
    }
}

/// All frames with the points of one person only.
pub fn alone(track: &Track, frames: &[PointFrame]) -> Vec<PointFrame> {
    let mut alone: Vec<PointFrame> = frames
        .iter()
        .map(|f| PointFrame {
            points: Vec::new(),
            ..*f
        })
        .collect();
    for (at, points) in track.frames.iter().zip(track.points(frames)) {
        alone[at.frame].points = points.points;
    }
    alone
}

/// The file of one person's points beside the file of all.
pub fn path_of(out: &Path, id: u32) -> PathBuf {
    out.with_extension(format!("person-{id}.parquet"))
}

/// A ghost in words.
pub fn describe_ghost(ghost: &GhostReport) -> String {
    format!(
        "track {} is a reflection of track {}: {} over a wall {:.1} m away at {:+.0} degrees, {:.0} dB weaker",
        ghost.id, ghost.of, ghost.path, ghost.wall_m, ghost.wall_azimuth_deg, ghost.loss_db
    )
}
