//! What systemd is notified of: that the service is ready, alive, and about to stop.
//!
//! The protocol is that of `sd_notify(3)`: a datagram with assignments to the socket that `$NOTIFY_SOCKET` names. A name
//! that begins with `@` is one of the abstract name space of Linux.

use std::time::{Duration, Instant};

/// The supervisor of this process, if it has one that wants to be notified.
#[derive(Debug)]
pub struct Supervisor {
    #[cfg(unix)]
    socket: Option<std::os::unix::net::UnixDatagram>,
    /// Time between two signs of life: half of what the supervisor permits.
    interval: Option<Duration>,
    notified: Option<Instant>,
}

impl Supervisor {
    /// The supervisor that the environment names. A socket that cannot be reached is as none, because a service that
    /// runs must not end for it.
    pub fn from_environment() -> Self {
        let text = |name| std::env::var(name).unwrap_or_default();
        let is_for_another = |pid: &str| !pid.is_empty() && pid != std::process::id().to_string();
        let interval = match is_for_another(&text("WATCHDOG_PID")) {
            true => None,
            false => interval(&text("WATCHDOG_USEC")),
        };
        Self {
            #[cfg(unix)]
            socket: connect(&text("NOTIFY_SOCKET")).ok(),
            interval,
            notified: None,
        }
    }

    /// The service answers from now on.
    pub fn ready(&self) {
        self.send("READY=1");
    }

    /// The service is alive. To be called more often than the supervisor wants to hear of it; most calls send nothing.
    pub fn alive(&mut self) {
        let is_due = |notified: Instant, interval| notified.elapsed() >= interval;
        if let Some(interval) = self.interval
            && self
                .notified
                .is_none_or(|notified| is_due(notified, interval))
        {
            self.notified = Some(Instant::now());
            self.send("WATCHDOG=1");
        }
    }

    /// The service ends.
    pub fn stopping(&self) {
        self.send("STOPPING=1");
    }

    fn send(&self, assignment: &str) {
        #[cfg(unix)]
        if let Some(socket) = &self.socket {
            // A supervisor that does not listen acts on its own clock.
            let _ = socket.send(assignment.as_bytes());
        }
        #[cfg(not(unix))]
        let _ = assignment;
    }
}

/// Half of a number of microseconds, which is not zero.
fn interval(usec: &str) -> Option<Duration> {
    let usec: u64 = usec.parse().ok()?;
    (usec > 1).then(|| Duration::from_micros(usec / 2))
}

#[cfg(unix)]
fn connect(name: &str) -> std::io::Result<std::os::unix::net::UnixDatagram> {
    let socket = std::os::unix::net::UnixDatagram::unbound()?;
    // A supervisor that takes nothing must not stop the radar.
    socket.set_nonblocking(true)?;
    match name.strip_prefix('@') {
        #[cfg(target_os = "linux")]
        Some(name) => {
            use std::os::linux::net::SocketAddrExt;
            let address = std::os::unix::net::SocketAddr::from_abstract_name(name)?;
            socket.connect_addr(&address)?;
        }
        #[cfg(not(target_os = "linux"))]
        Some(_) => return Err(std::io::ErrorKind::Unsupported.into()),
        None => socket.connect(name)?,
    }
    Ok(socket)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_of_life_come_twice_as_often_as_they_are_wanted() {
        assert_eq!(interval("30000000"), Some(Duration::from_secs(15)));
        for none in ["", "0", "1", "-5", "soon", "99999999999999999999"] {
            assert_eq!(interval(none), None, "{none}");
        }
    }
}
