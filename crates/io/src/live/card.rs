//! Commands of a DCA1000: connects, configures and starts the card.
//!
//! A command is the word 0xA55A, its code, the length of its data, the data and the word 0xEEAA, all little-endian. The
//! card answers with the same frame, in which a status of 0 means success. Source: TI SPRUIJ4 "DCA1000EVM Data Capture
//! Card", section on the configuration of the FPGA.

use std::{
    io::{self, ErrorKind},
    net::{SocketAddr, UdpSocket},
    time::{Duration, Instant},
};

use radarllm_formats::{adc::LvdsLanes, dca1000::HEADER_BYTES, dca1000::MAX_PAYLOAD};

use crate::udp::is_quiet;

/// UDP port of the commands.
pub(super) const CONTROL_PORT: u16 = 4096;
const HEAD: [u8; 2] = [0x5A, 0xA5];
const FOOT: [u8; 2] = [0xAA, 0xEE];
/// Bytes of an answer: head, code, status, foot.
const ANSWER_BYTES: usize = 8;
/// Time between two packets, in steps of 8 ns: 25 us, with which a packet of 1466 bytes fits a gigabit link.
const PACKET_DELAY: u16 = 3125;

/// The commands before samples arrive, with their names.
fn commands(lanes: LvdsLanes) -> [(u16, &'static str, Vec<u8>); 4] {
    let lanes = match lanes {
        LvdsLanes::Four { .. } => 1,
        LvdsLanes::Two => 2,
    };
    let packet_bytes = (HEADER_BYTES + MAX_PAYLOAD) as u16 + 6;
    let packet = [packet_bytes, PACKET_DELAY, 0].map(u16::to_le_bytes);
    [
        (9, "connect", Vec::new()),
        // Raw mode, lanes, samples from LVDS, to the network, 16 bits, a timer of 30 s.
        (3, "configure the FPGA", vec![1, lanes, 1, 2, 3, 30]),
        (11, "configure packets", packet.concat()),
        (5, "start", Vec::new()),
    ]
}

/// A card that is being started.
pub(super) struct Starting {
    socket: UdpSocket,
    commands: [(u16, &'static str, Vec<u8>); 4],
    next: usize,
    /// When the answer to the command that was sent last must have arrived; `None` between commands.
    deadline: Option<Instant>,
    answer_time: Duration,
}

impl Starting {
    /// Binds the port from which commands are sent, `here`, and connects it to the card.
    pub(super) fn open(
        card: SocketAddr,
        here: SocketAddr,
        lanes: LvdsLanes,
        answer_time: Duration,
    ) -> io::Result<Self> {
        let socket = UdpSocket::bind(here)?;
        // Datagrams of other senders are not received.
        socket.connect(card)?;
        Ok(Self {
            socket,
            commands: commands(lanes),
            next: 0,
            deadline: None,
            answer_time,
        })
    }

    /// Goes on until `until`. Returns true once the card has accepted every command.
    pub(super) fn step(&mut self, until: Instant) -> io::Result<bool> {
        while let Some((code, name, data)) = self.commands.get(self.next) {
            let failed = |kind, what: String| io::Error::new(kind, format!("{name}: {what}"));
            let Some(deadline) = self.deadline else {
                let length = (data.len() as u16).to_le_bytes();
                let datagram = [&HEAD, &code.to_le_bytes(), &length, &data[..], &FOOT].concat();
                self.socket.send(&datagram)?;
                self.deadline = Some(Instant::now() + self.answer_time);
                continue;
            };
            let now = Instant::now();
            if now >= deadline {
                let seconds = self.answer_time.as_secs_f64();
                let what = format!("the card did not answer in {seconds} s");
                return Err(failed(ErrorKind::TimedOut, what));
            }
            if now >= until {
                return Ok(false);
            }
            let left = until.min(deadline).saturating_duration_since(now);
            self.socket.set_read_timeout(Some(left))?;
            let mut answer = [0; ANSWER_BYTES + 1];
            let n = match self.socket.recv(&mut answer) {
                Ok(n) => n,
                Err(e) if is_quiet(&e) => continue,
                Err(e) => return Err(failed(e.kind(), e.to_string())),
            };
            match answer[..n] {
                // Answers to other commands are late ones, and messages of the card about itself.
                [0x5A, 0xA5, c0, c1, s0, s1, 0xAA, 0xEE] if [c0, c1] == code.to_le_bytes() => {
                    let status = u16::from_le_bytes([s0, s1]);
                    if status != 0 {
                        let what = format!("the card refused it with status {status}");
                        return Err(failed(ErrorKind::Other, what));
                    }
                    self.deadline = None;
                    self.next += 1;
                }
                _ => {}
            }
        }
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    const PATIENCE: Duration = Duration::from_secs(20);

    /// Starts a card that answers with these statuses. Returns the commands it received and the outcome.
    fn started(statuses: &'static [u16], answer_time: Duration) -> (Vec<Vec<u8>>, io::Result<()>) {
        let card = UdpSocket::bind("127.0.0.1:0").unwrap();
        card.set_read_timeout(Some(PATIENCE)).unwrap();
        let address = card.local_addr().unwrap();
        let thread = thread::spawn(move || {
            let mut received = Vec::new();
            for status in statuses {
                let mut buffer = [0; 64];
                let (n, from) = card.recv_from(&mut buffer).unwrap();
                received.push(buffer[..n].to_vec());
                let [s0, s1] = status.to_le_bytes();
                // An answer to another command, something else, and the answer.
                let (c0, c1) = (buffer[2], buffer[3]);
                for answer in [
                    &[0x5A, 0xA5, 0x77, 0, 1, 0, 0xAA, 0xEE][..],
                    &[1, 2, 3],
                    &[0x5A, 0xA5, c0, c1, s0, s1, 0xAA, 0xEE],
                ] {
                    card.send_to(answer, from).unwrap();
                }
            }
            // Keeps the port until nobody sends any more.
            (received, card)
        });
        let here = "127.0.0.1:0".parse().unwrap();
        let mut starting = Starting::open(address, here, LvdsLanes::Two, answer_time).unwrap();
        let end = Instant::now() + PATIENCE;
        let outcome = loop {
            match starting.step(Instant::now() + Duration::from_millis(5)) {
                Ok(true) => break Ok(()),
                Ok(false) => assert!(Instant::now() < end),
                Err(e) => break Err(e),
            }
        };
        (thread.join().unwrap().0, outcome)
    }

    #[test]
    fn commands_are_the_documented_bytes() {
        let (received, outcome) = started(&[0, 0, 0, 0], PATIENCE);
        outcome.unwrap();
        let expected: [&[u8]; 4] = [
            &[0x5A, 0xA5, 9, 0, 0, 0, 0xAA, 0xEE],
            &[0x5A, 0xA5, 3, 0, 6, 0, 1, 2, 1, 2, 3, 30, 0xAA, 0xEE],
            &[
                0x5A, 0xA5, 11, 0, 6, 0, 0xC0, 5, 0x35, 0x0C, 0, 0, 0xAA, 0xEE,
            ],
            &[0x5A, 0xA5, 5, 0, 0, 0, 0xAA, 0xEE],
        ];
        assert_eq!(received, expected);
    }

    #[test]
    fn refusals_and_silence_are_errors() {
        let (_, outcome) = started(&[0, 1], PATIENCE);
        let error = outcome.unwrap_err().to_string();
        assert_eq!(
            error,
            "configure the FPGA: the card refused it with status 1"
        );
        let (_, outcome) = started(&[0], Duration::from_millis(100));
        assert!(
            outcome
                .unwrap_err()
                .to_string()
                .contains("configure the FPGA")
        );
    }
}
