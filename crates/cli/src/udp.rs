//! Packets of a capture card from the network, live. The only socket of the project.

use std::{
    io::ErrorKind,
    net::{IpAddr, SocketAddr, UdpSocket},
    time::Duration,
};

use radarllm_capture::{
    adc::AdcError,
    dca1000::{DATA_PORT, DataPacket, PacketSource},
};

/// How long to wait for the first packet, and for the next one after it.
const FIRST_WAIT: Duration = Duration::from_secs(60);
const NEXT_WAIT: Duration = Duration::from_secs(2);
/// One byte more than the longest packet, to tell longer datagrams from whole ones.
const BUFFER_BYTES: usize = 1467;

/// A bound socket; ends when the card has been silent for two seconds.
pub struct UdpPackets {
    socket: UdpSocket,
    /// Who sent the first packet: others are not listened to.
    sender: Option<IpAddr>,
    buffer: Vec<u8>,
    skipped: u64,
}

/// The address in `udp:PORT`, `udp:ADDRESS:PORT` or `udp:`; `None` for other texts.
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
    /// Listens at an address of this machine.
    ///
    /// # Errors
    /// What the system says when the address is taken or not ours.
    pub fn bind(address: SocketAddr) -> std::io::Result<Self> {
        let socket = UdpSocket::bind(address)?;
        socket.set_read_timeout(Some(FIRST_WAIT))?;
        Ok(Self {
            socket,
            sender: None,
            buffer: vec![0; BUFFER_BYTES],
            skipped: 0,
        })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// What the system says.
    pub fn local_address(&self) -> std::io::Result<SocketAddr> {
        self.socket.local_addr()
    }
}

impl PacketSource for UdpPackets {
    fn next_packet(&mut self) -> Result<Option<DataPacket<'_>>, AdcError> {
        let fail = |source| AdcError::Read { offset: 0, source };
        let length = loop {
            match self.socket.recv_from(&mut self.buffer) {
                Ok((length, from)) => {
                    let is_ours = self.sender.is_none_or(|sender| sender == from.ip());
                    if is_ours && DataPacket::parse(&self.buffer[..length]).is_ok() {
                        if self.sender.is_none() {
                            self.sender = Some(from.ip());
                            let wait = self.socket.set_read_timeout(Some(NEXT_WAIT));
                            wait.map_err(fail)?;
                        }
                        break length;
                    }
                    self.skipped += 1;
                }
                Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    return Ok(None);
                }
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(fail(e)),
            }
        };
        Ok(DataPacket::parse(&self.buffer[..length]).ok())
    }

    fn skipped(&self) -> u64 {
        self.skipped
    }
}
