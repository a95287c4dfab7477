//! What a sentence about a person states: its actions, in order of time, each with side and direction.
//!
//! Scores and labels must depend on what a sentence means, not on its wording. "A person raises the left hand and
//! waves" states one action, `wave`, with the left side; it does not state `raise_arms`. [`parse()`] reads the sentences
//! of the project's motion library and common words of people's own descriptions. Words that it does not know state
//! nothing.
//!
//! ```
//! use radarllm_facts::{Direction, Side, parse};
//!
//! let clauses = parse("a person walks backward while waving with the left hand, then sits down");
//! assert_eq!(clauses.len(), 2);
//! let [walk, wave] = &clauses[0].actions[..] else { panic!() };
//! assert_eq!((walk.name, walk.direction), ("walk", Some(Direction::Backward)));
//! assert_eq!((wave.name, wave.side), ("wave", Some(Side::Left)));
//! assert_eq!(clauses[1].actions[0].name, "sit_down");
//! ```
//!
//! Names of actions are those of the motion library (`radarllm motion list`) where it has the action.
//!
//! [`facts()`] adds the subject; the notation of [`Facts`] is one line.
//!
//! Reading order: [`action`] (what can be stated), [`parse`](mod@parse) (sentences to clauses), [`lexicon`] (words that
//! state an action), [`tables`] (the words of actions as data), [`words`] (spelling), `attributes` (what else the words state), [`write`](mod@write) (facts to
//! sentences), [`inflect`] (verb forms), `mirror` (left and right exchanged), [`score`] (facts beside facts), [`attach`]
//! (whether a sentence may describe a motion).

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod action;
pub mod attach;
mod attributes;
pub mod inflect;
pub mod lexicon;
mod mirror;
pub mod parse;
pub mod score;
pub mod tables;
pub mod words;
pub mod write;

pub use action::{
    Action, BodyPart, Count, Direction, Duration, Extent, Facts, Height, Kind, Manner, Path,
    Posture, Side, Subject, Tempo,
};
pub use mirror::swap_sides;
pub use parse::{Clause, facts, parse};
