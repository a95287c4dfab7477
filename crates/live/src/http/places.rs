//! Places for connections: whom a crowded server lets in.
//!
//! A connection is a stranger's until one of its requests was admitted ([`super::guard`]): it may be silent, or of somebody
//! without the token. Strangers have places of their own. If these are taken, a newcomer gets the place of the stranger
//! that waits longest, at the address from which most strangers come, so that nobody keeps others out by holding
//! connections open.

use std::collections::{BTreeMap, VecDeque};
use std::net::IpAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

/// All places.
#[derive(Debug)]
pub(super) struct Places {
    max_known: usize,
    max_strangers: usize,
    taken: Mutex<Taken>,
}

#[derive(Debug, Default)]
struct Taken {
    next_id: u64,
    n_known: usize,
    /// In the order of their arrival.
    strangers: VecDeque<Stranger>,
}

#[derive(Debug)]
struct Stranger {
    id: u64,
    address: IpAddr,
    leave: Arc<Notify>,
}

/// The place of a connection; given back when it is dropped.
#[derive(Debug)]
pub(super) struct Place {
    places: Arc<Places>,
    id: u64,
    is_known: AtomicBool,
    leave: Arc<Notify>,
}

impl Places {
    pub(super) fn new(max_known: usize, max_strangers: usize) -> Arc<Self> {
        Arc::new(Self {
            max_known,
            max_strangers: max_strangers.max(1),
            taken: Mutex::default(),
        })
    }

    /// Gives a new connection a place. Returns also whether another one had to leave for it.
    pub(super) fn enter(self: &Arc<Self>, address: IpAddr) -> (Place, bool) {
        let mut taken = self.lock();
        let is_full = taken.strangers.len() >= self.max_strangers;
        if is_full && let Some(gone) = taken.remove_one_of_the_most() {
            gone.leave.notify_one();
        }
        let id = taken.next_id;
        taken.next_id += 1;
        let leave = Arc::new(Notify::new());
        taken.strangers.push_back(Stranger {
            id,
            address,
            leave: Arc::clone(&leave),
        });
        let place = Place {
            places: Arc::clone(self),
            id,
            is_known: AtomicBool::new(false),
            leave,
        };
        (place, is_full)
    }

    fn lock(&self) -> MutexGuard<'_, Taken> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Taken {
    /// Removes the oldest stranger of the address with the most strangers.
    fn remove_one_of_the_most(&mut self) -> Option<Stranger> {
        let mut counts = BTreeMap::<IpAddr, usize>::new();
        for stranger in &self.strangers {
            *counts.entry(stranger.address).or_default() += 1;
        }
        let max_count = counts.values().max().copied()?;
        let oldest = self
            .strangers
            .iter()
            .position(|s| counts[&s.address] == max_count);
        oldest.and_then(|at| self.strangers.remove(at))
    }
}

impl Place {
    /// Remembers that a request of the connection was admitted. Returns whether there is a place for it.
    pub(super) fn admit(&self) -> bool {
        let mut taken = self.places.lock();
        if self.is_known.load(Ordering::Relaxed) {
            return true;
        }
        if taken.n_known >= self.places.max_known {
            return false;
        }
        taken.n_known += 1;
        taken.strangers.retain(|stranger| stranger.id != self.id);
        self.is_known.store(true, Ordering::Relaxed);
        true
    }

    /// Waits until the connection must make room for another one.
    pub(super) async fn must_leave(&self) {
        self.leave.notified().await;
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.places.lock();
        match self.is_known.load(Ordering::Relaxed) {
            true => taken.n_known -= 1,
            false => taken.strangers.retain(|stranger| stranger.id != self.id),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ids(places: &Places) -> Vec<u64> {
        places.lock().strangers.iter().map(|s| s.id).collect()
    }

    #[test]
    fn the_oldest_of_the_busiest_address_makes_room() {
        let places = Places::new(1, 3);
        let [crowd, other] = [1, 2].map(|n| IpAddr::from([10, 0, 0, n]));
        let all = [other, crowd, crowd].map(|address| places.enter(address).0);
        let (newcomer, someone_left) = places.enter(other);
        assert!(someone_left);
        // 1 and 2 are of the crowd.
        assert_eq!(ids(&places), [0, 2, 3]);
        // Known ones are nobody's to send away, and their places are limited too.
        assert!(all[0].admit() && all[0].admit());
        assert!(!newcomer.admit());
        assert_eq!(ids(&places), [2, 3]);
        drop(all);
        assert_eq!(ids(&places), [3]);
        assert!(newcomer.admit());
        drop(newcomer);
        assert_eq!(places.lock().n_known, 0);
    }
}
