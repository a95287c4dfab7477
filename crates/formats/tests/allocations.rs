//! No reader asks for memory by a number it found: lengths and counters of small hostile files.
//!
//! A test program of its own: it watches what the global allocator is asked for.

#![allow(clippy::unwrap_used, unreachable_pub, reason = "a test")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use radarllm_formats::{
    adc::{AdcReader, CubeShape, FrameDecoder, FrameSource, StudioCapture},
    dca1000::{Assembler, DataPacket, PacketSource, PcapPackets, RecordReader},
    recordings::{read_matlab_points, read_visualizer_json},
};

// Captures are made as the other tests make them.
#[allow(dead_code)]
#[path = "it/made.rs"]
mod made;
#[allow(dead_code)]
#[path = "it/make.rs"]
mod make;

thread_local! {
    /// Largest request of this thread, bytes; the test harness's own threads do not count.
    static LARGEST: Cell<usize> = const { Cell::new(0) };
}

struct Watching;

fn saw(size: usize) {
    LARGEST.with(|largest| largest.set(largest.get().max(size)));
}

// SAFETY: passes everything on to the system's allocator; watching allocates nothing.
unsafe impl GlobalAlloc for Watching {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        saw(layout.size());
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        saw(layout.size());
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        saw(size);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Watching = Watching;

/// Largest request while `read` runs, bytes.
fn largest(read: impl FnOnce()) -> usize {
    LARGEST.set(0);
    read();
    LARGEST.get()
}

#[test]
fn hostile_lengths_and_counters_cost_no_memory() {
    // Twice the window of the assembler (93 kB) and the frame, for a growing buffer.
    const MAX: usize = 300_000;
    let stream: Vec<u8> = (0..8000_u32).map(|i| i as u8).collect();
    let sent = made::datagrams(&stream, 1456);
    let framed: Vec<Vec<u8>> = sent
        .iter()
        .map(|d| made::ethernet(0, &made::ipv4(4098, d)))
        .collect();
    let style = made::PcapStyle {
        is_big_endian: false,
        is_nanoseconds: false,
        link: 1,
    };
    let drain =
        |mut source: Box<dyn PacketSource + '_>| while let Ok(Some(_)) = source.next_packet() {};

    // Every word of the headers in turn as large as it can be, and as large as is still accepted.
    for value in [u32::MAX, 0x7fff_fffc, 262_144] {
        for at in 0..60 {
            let damage = |mut file: Vec<u8>| {
                file[at * 2..at * 2 + 4].copy_from_slice(&value.to_le_bytes());
                file
            };
            let pcap = damage(made::pcap(&style, &framed));
            let ng = damage(made::pcapng(false, 1, &framed));
            let records = damage(made::records(&sent));
            let size = largest(|| {
                for file in [&pcap, &ng] {
                    if let Ok(packets) = PcapPackets::new(&file[..]) {
                        drain(Box::new(packets));
                    }
                }
                drain(Box::new(RecordReader::new(&records[..])));
            });
            assert!(size < MAX, "{value:#x} at {}: {size} bytes", at * 2);
        }
    }

    let forged: Vec<Vec<u8>> = (0..64)
        .flat_map(|i| {
            // Pairs that confirm each other, far apart.
            let count = (i * 0x0123_4567_89ab) % (1 << 48);
            [
                made::datagram(7, count, &[1; 100]),
                made::datagram(8, count + 100, &[2; 100]),
            ]
        })
        .collect();
    let size = largest(|| {
        let mut assembler = Assembler::new(5000).unwrap();
        for datagram in sent.iter().chain(&forged) {
            if let Ok(packet) = DataPacket::parse(datagram) {
                drop(assembler.push(&packet));
            }
        }
        drop(assembler.finish());
    });
    assert!(size < MAX, "forged counters: {size} bytes");

    // A frame of 200 MiB, and a file of 8 kB.
    let shape = CubeShape {
        n_loops: 4096,
        n_tx: 4,
        n_rx: 4,
        n_samples: 800,
    };
    let decoder = FrameDecoder::new(shape, made::two(made::I_FIRST)).unwrap();
    assert_eq!(decoder.frame_bytes(), 200 << 20);
    let size = largest(|| {
        let mut cube = CubeShape {
            n_loops: 1,
            ..shape
        }
        .zeros()
        .unwrap();
        let mut reader = AdcReader::new(&stream[..], decoder);
        assert_eq!(reader.next_frame(&mut cube).unwrap(), None);
        assert_eq!(reader.trailing_bytes(), 8000);
    });
    assert!(size < MAX, "a frame larger than its file: {size} bytes");

    let export = include_str!("data/awr1843.mmwave.json");
    for (from, to) in [
        ("256", "4294967295"),
        ("\"numLoops\": 128", "\"numLoops\": 1e300"),
        ("\"0x7\"", "\"0xFFFFFFFF\""),
    ] {
        assert!(export.contains(from), "{from}");
        let text = export.replace(from, to);
        let size = largest(|| assert!(StudioCapture::parse(&text, None).is_err()));
        assert!(size < MAX, "{to}: {size} bytes");
    }
}

/// MATLAB files whose lengths and shapes are damaged, and a variable that inflates to far more than it states.
#[test]
fn hostile_matlab_and_json_files_cost_no_memory() {
    const MAX: usize = 300_000;
    for value in [u32::MAX, 0x7fff_fff8, 1 << 26] {
        for at in (124..260).step_by(2) {
            let mut file = make::mars_mat(2, false);
            file[at..at + 4].copy_from_slice(&value.to_le_bytes());
            let size = largest(|| drop(read_matlab_points(&file)));
            assert!(size < MAX, "{value:#x} at {at}: {size} bytes");
        }
    }
    let zeros = vec![0.0; 1 << 20];
    for name in ["marsData", "other"] {
        let mut file = make::mat(&[(name, &[1, 64, 5], &zeros)], true);
        let size = largest(|| drop(read_matlab_points(&file)));
        // The wanted one is inflated: 4 MiB of zeros, in a buffer that doubles.
        let max = if name == "other" { MAX } else { 9 << 20 };
        assert!(size < max, "{name}: {size} bytes");
        file.truncate(file.len() / 2);
        assert!(largest(|| drop(read_matlab_points(&file))) < max);
    }
    // Lists of nothing: what is refused is not kept.
    for element in ["[]", "{}", "0", "[[]]", "\"\""] {
        let list = vec![element; 50_000].join(",");
        for key in ["data", "cfg", "x"] {
            let text = format!("{{\"{key}\": [{list}]}}");
            let size = largest(|| drop(read_visualizer_json(&text)));
            assert!(size < MAX, "{key} {element}: {size} bytes");
        }
    }
}
