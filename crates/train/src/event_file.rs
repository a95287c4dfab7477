//! Event files for TensorBoard.
//!
//! A file is a sequence of records. Each record consists of a length, the checksum of the length, a message and the
//! checksum of the message, in the layout of TensorFlow's `record_writer.cc`. The messages are defined in `event.proto`
//! and `summary.proto`.

/// The first record of a file.
pub(crate) fn header(wall_time_s: f64) -> Vec<u8> {
    let mut event = wall_time(wall_time_s);
    put_bytes(&mut event, 3, b"brain.Event:2");
    record(&event)
}

/// One record with the scalar values of a step.
pub(crate) fn scalars(wall_time_s: f64, step: u64, values: &[(String, f64)]) -> Vec<u8> {
    let mut summary = Vec::new();
    for (tag, value) in values {
        let mut entry = Vec::new();
        put_bytes(&mut entry, 1, tag.as_bytes());
        put_key(&mut entry, 2, FOUR_BYTES);
        entry.extend((*value as f32).to_le_bytes());
        put_bytes(&mut summary, 1, &entry);
    }
    let mut event = wall_time(wall_time_s);
    put_key(&mut event, 2, VARINT);
    put_varint(&mut event, step);
    put_bytes(&mut event, 5, &summary);
    record(&event)
}

/// Wire types of protocol buffers.
const VARINT: u64 = 0;
const EIGHT_BYTES: u64 = 1;
const BYTES: u64 = 2;
const FOUR_BYTES: u64 = 5;

fn wall_time(seconds: f64) -> Vec<u8> {
    let mut event = Vec::new();
    put_key(&mut event, 1, EIGHT_BYTES);
    event.extend(seconds.to_le_bytes());
    event
}

fn put_key(to: &mut Vec<u8>, field: u64, wire_type: u64) {
    put_varint(to, field << 3 | wire_type);
}

fn put_bytes(to: &mut Vec<u8>, field: u64, bytes: &[u8]) {
    put_key(to, field, BYTES);
    put_varint(to, bytes.len() as u64);
    to.extend(bytes);
}

fn put_varint(to: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        to.push(value as u8 | 0x80);
        value >>= 7;
    }
    to.push(value as u8);
}

fn record(message: &[u8]) -> Vec<u8> {
    let length = (message.len() as u64).to_le_bytes();
    let mut out = length.to_vec();
    out.extend(checksum(&length));
    out.extend(message);
    out.extend(checksum(message));
    out
}

/// CRC-32C, rotated and offset, so that the checksum of data that contain checksums differs from these.
fn checksum(bytes: &[u8]) -> [u8; 4] {
    crc32c::crc32c(bytes)
        .rotate_right(15)
        .wrapping_add(0xa282_ead8)
        .to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reference: bytes written by the record writer and the messages of the Python package tensorboard 2.21.
    #[test]
    fn records_are_those_of_tensorboard() {
        let golden = "1800000000000000a37f4b220900000000000029401a0d627261696e2e4576656e743a326394a44f\
                      3200000000000000241956ec090000000000802e4010ac022a240a110a0a747261696e2f6c6f7373\
                      150000803e0a0f0a08747261696e2f6c72156f12833aef3f9c98";
        let values = [("train/loss".to_string(), 0.25), ("train/lr".into(), 0.001)];
        let mut found = header(12.5);
        found.extend(scalars(15.25, 300, &values));
        let hex: String = found.iter().map(|b| format!("{b:02x}")).collect();
        assert_eq!(hex, golden);
    }
}
