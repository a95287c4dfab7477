//! pcap and pcapng files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::{
    dca1000::{PacketSource, PcapPackets},
    pcap::PcapReader,
};

fuzz_target!(|input: &[u8]| {
    if let Ok(mut reader) = PcapReader::new(input) {
        let mut datagram = Vec::new();
        let mut bytes = 0;
        while let Ok(Some(_)) = reader.next_udp(&mut datagram) {
            bytes += datagram.len();
        }
        assert!(bytes <= input.len());
    }
    if let Ok(mut packets) = PcapPackets::new(input) {
        while let Ok(Some(_)) = packets.next_packet() {}
    }
});
