//! Data sets: are the motions that are held out really unseen?

pub mod held_out;
pub mod near_duplicates;
