//! Live packets of a capture card from the network.
//!
//! A separate thread empties the socket, because processing a frame takes longer than the system's buffer can bridge.
//! Packets wait in a queue of bounded length.

use std::{
    io::{self, ErrorKind},
    net::{IpAddr, SocketAddr, UdpSocket},
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
        mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel},
    },
    thread,
    time::Duration,
};

use radarllm_formats::{
    adc::AdcError,
    dca1000::{DATA_PORT, DataPacket, PacketSource},
};

/// Timeout for the first packet, and for each packet after it.
const FIRST_WAIT: Duration = Duration::from_secs(60);
const NEXT_WAIT: Duration = Duration::from_secs(2);
/// Interval at which the thread checks whether it should stop.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// Maximum number of queued packets: 48 MB, half a second at the card's maximum rate.
const MAX_WAITING: usize = 32_768;
/// Requested size of the system's buffer, bytes: two frames of a large radar. The system may grant less.
pub(crate) const SYSTEM_BUFFER_BYTES: usize = 8 << 20;
/// One byte more than the longest packet, so that longer datagrams can be recognised.
const BUFFER_BYTES: usize = 1467;

/// Counters of the thread.
#[derive(Default)]
struct Shared {
    skipped: AtomicU64,
    overruns: AtomicU64,
    forgets_sender: AtomicBool,
    is_over: AtomicBool,
}

/// A bound socket. The stream ends when the card has sent nothing for two seconds.
pub struct UdpPackets {
    address: SocketAddr,
    system_buffer_bytes: Option<usize>,
    waiting: Receiver<io::Result<Vec<u8>>>,
    shared: Arc<Shared>,
    has_begun: bool,
    datagram: Vec<u8>,
}

/// Parses the address in `udp:PORT`, `udp:ADDRESS:PORT` or `udp:`. Returns `None` for other texts.
pub fn address(input: &str) -> Option<Result<SocketAddr, String>> {
    let text = input.strip_prefix("udp:")?;
    let everywhere = IpAddr::from([0, 0, 0, 0]);
    if text.is_empty() {
        return Some(Ok(SocketAddr::new(everywhere, DATA_PORT)));
    }
    Some(match text.parse::<u16>() {
        Ok(port) => Ok(SocketAddr::new(everywhere, port)),
        Err(_) => text
            .parse()
            .map_err(|_| format!("`{text}` is neither a port nor ADDRESS:PORT")),
    })
}

impl UdpPackets {
    /// Binds the socket to an address of this machine.
    ///
    /// # Errors
    /// The error of the system if the address is in use or does not belong to this machine.
    pub fn bind(address: SocketAddr) -> io::Result<Self> {
        Self::bind_for(address, None)
    }

    /// Like [`Self::bind`], for the packets of one card. Without its address, the first sender is the card.
    ///
    /// # Errors
    /// Those of [`Self::bind`].
    pub fn bind_for(address: SocketAddr, card: Option<IpAddr>) -> io::Result<Self> {
        let socket = UdpSocket::bind(address)?;
        let system_buffer_bytes = enlarge_system_buffer(&socket);
        socket.set_read_timeout(Some(LOOK_EVERY))?;
        let address = socket.local_addr()?;
        let shared = Arc::new(Shared::default());
        let (sender, waiting) = sync_channel(MAX_WAITING);
        let for_thread = Arc::clone(&shared);
        thread::Builder::new()
            .name("udp".into())
            .spawn(move || receive(&socket, card, &sender, &for_thread))?;
        Ok(Self {
            address,
            system_buffer_bytes,
            waiting,
            shared,
            has_begun: false,
            datagram: Vec::new(),
        })
    }

    /// Local address of the socket.
    pub fn local_address(&self) -> SocketAddr {
        self.address
    }

    /// Size of the system's buffer, bytes; `None` if the system does not say.
    pub fn system_buffer_bytes(&self) -> Option<usize> {
        self.system_buffer_bytes
    }

    /// Waits at most `timeout` for the next packet.
    ///
    /// # Errors
    /// The error of the system that ended reception. After it was returned, [`ErrorKind::BrokenPipe`].
    pub fn receive(&mut self, timeout: Duration) -> io::Result<Option<DataPacket<'_>>> {
        match self.waiting.recv_timeout(timeout) {
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(ErrorKind::BrokenPipe.into()),
            Ok(Err(error)) => Err(error),
            Ok(Ok(datagram)) => {
                self.datagram = datagram;
                Ok(DataPacket::parse(&self.datagram).ok())
            }
        }
    }

    /// The next sender becomes the card, unless the card's address is known.
    pub fn forget_sender(&self) {
        self.shared.forgets_sender.store(true, Ordering::Relaxed);
    }

    /// Number of packets that were lost because they arrived faster than they were processed.
    pub fn overruns(&self) -> u64 {
        self.shared.overruns.load(Ordering::Relaxed)
    }
}

impl Drop for UdpPackets {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
    }
}

/// Asks for a large buffer, unless there is one, so that no packet is lost while the thread waits for the processor.
/// Returns the size that the system granted.
#[cfg(target_os = "linux")]
fn enlarge_system_buffer(socket: &UdpSocket) -> Option<usize> {
    use std::os::fd::AsRawFd as _;
    let granted = || {
        let mut size: libc::c_int = 0;
        let mut length = size_of::<libc::c_int>() as libc::socklen_t;
        // SAFETY: the socket is open; the value is an integer of the stated length and outlives the call.
        let result = unsafe {
            libc::getsockopt(
                socket.as_raw_fd(),
                libc::SOL_SOCKET,
                libc::SO_RCVBUF,
                (&raw mut size).cast(),
                &raw mut length,
            )
        };
        // Linux reports twice the usable size.
        (result == 0).then(|| usize::try_from(size).unwrap_or(0) / 2)
    };
    if granted().is_some_and(|size| size < SYSTEM_BUFFER_BYTES) {
        let wanted = SYSTEM_BUFFER_BYTES as libc::c_int;
        // SAFETY: as above.
        unsafe {
            libc::setsockopt(
                socket.as_raw_fd(),
                libc::SOL_SOCKET,
                libc::SO_RCVBUF,
                (&raw const wanted).cast(),
                size_of::<libc::c_int>() as libc::socklen_t,
            );
        }
    }
    granted()
}

#[cfg(not(target_os = "linux"))]
fn enlarge_system_buffer(_socket: &UdpSocket) -> Option<usize> {
    None
}

/// Moves packets of the card, or of the first sender, from the socket to the queue.
fn receive(
    socket: &UdpSocket,
    known_card: Option<IpAddr>,
    sender: &SyncSender<io::Result<Vec<u8>>>,
    shared: &Shared,
) {
    let mut buffer = [0; BUFFER_BYTES];
    let mut card = known_card;
    while !shared.is_over.load(Ordering::Relaxed) {
        let received = match socket.recv_from(&mut buffer) {
            Ok((length, from)) => {
                if shared.forgets_sender.swap(false, Ordering::Relaxed) {
                    card = known_card;
                }
                let is_ours = card.is_none_or(|card| card == from.ip());
                if !is_ours || DataPacket::parse(&buffer[..length]).is_err() {
                    shared.skipped.fetch_add(1, Ordering::Relaxed);
                    continue;
                }
                card = Some(from.ip());
                Ok(buffer[..length].to_vec())
            }
            Err(e) if is_quiet(&e) => continue,
            Err(e) => Err(e),
        };
        let is_error = received.is_err();
        match sender.try_send(received) {
            Ok(()) => {}
            Err(TrySendError::Full(_)) => {
                shared.overruns.fetch_add(1, Ordering::Relaxed);
            }
            Err(TrySendError::Disconnected(_)) => return,
        }
        if is_error {
            return;
        }
    }
}

impl PacketSource for UdpPackets {
    fn next_packet(&mut self) -> Result<Option<DataPacket<'_>>, AdcError> {
        let wait = if self.has_begun {
            NEXT_WAIT
        } else {
            FIRST_WAIT
        };
        self.has_begun = true;
        match self.receive(wait) {
            // `None`: the card is silent. A broken pipe: the thread ended after an error.
            Ok(packet) => Ok(packet),
            Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(None),
            Err(source) => Err(AdcError::Read { offset: 0, source }),
        }
    }

    fn skipped(&self) -> u64 {
        self.shared.skipped.load(Ordering::Relaxed)
    }
}
/// Whether a socket only had nothing to read within its time limit.
pub(crate) fn is_quiet(error: &io::Error) -> bool {
    use ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted)
}
