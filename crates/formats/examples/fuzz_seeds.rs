//! Writes seeds for the fuzz targets: `cargo run -p radarllm-formats --example fuzz_seeds -- fuzz/corpus`.

#![allow(
    clippy::disallowed_methods,
    clippy::print_stderr,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "an example"
)]

use std::{env, fs, path::Path};

use radarllm_formats::adc::CubeShape;

// Captures are made as the tests make them.
#[allow(dead_code)]
#[path = "../tests/it/made.rs"]
mod made;

fn main() -> std::io::Result<()> {
    let Some(folder) = env::args().nth(1) else {
        eprintln!("usage: fuzz_seeds FOLDER");
        std::process::exit(1);
    };
    let write = |target: &str, name: &str, bytes: &[u8]| {
        let folder = Path::new(&folder).join(target);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join(name), bytes)
    };
    let shape = CubeShape {
        n_loops: 2,
        n_tx: 2,
        n_rx: 4,
        n_samples: 32,
    };
    let cube = made::echo(shape, 3.0, 50.0, 1);
    let layouts = [
        (0x00, "two_i", made::two(made::I_FIRST)),
        (0x02, "two_q", made::two(made::Q_FIRST)),
        (0xf1, "four_i", made::four(15, made::I_FIRST)),
    ];
    for (choice, name, layout) in layouts {
        let words = made::bytes(&made::words(&cube, layout));
        write("adc_bin", name, &[&[choice], &words[..]].concat())?;
    }
    let stream = made::bytes(&made::words(&cube, made::two(made::I_FIRST)));
    let mut sent = made::datagrams(&stream, 300);
    write(
        "dca1000",
        "whole",
        &[&[0, 2], &made::records(&sent)[..]].concat(),
    )?;
    let ip: Vec<Vec<u8>> = sent.iter().map(|d| made::ipv4(4098, d)).collect();
    let ethernet: Vec<Vec<u8>> = ip.iter().map(|p| made::ethernet(1, p)).collect();
    sent.swap(1, 3);
    sent.remove(4);
    write(
        "dca1000",
        "lossy",
        &[&[0, 2], &made::records(&sent)[..]].concat(),
    )?;
    for is_big_endian in [false, true] {
        let end = if is_big_endian { "be" } else { "le" };
        let style = |link| made::PcapStyle {
            is_big_endian,
            is_nanoseconds: is_big_endian,
            link,
        };
        write(
            "pcap",
            &format!("ethernet_{end}"),
            &made::pcap(&style(1), &ethernet),
        )?;
        write("pcap", &format!("raw_{end}"), &made::pcap(&style(101), &ip))?;
        write(
            "pcap",
            &format!("ng_{end}"),
            &made::pcapng(is_big_endian, 1, &ethernet),
        )?;
    }
    write(
        "log_csv",
        "lossy",
        b"LVDS lane mode : 2 lane\nRaw Data :\nOut of sequence count - 3\nNumber of received packets - 9\n\
          Number of zero filled packets - 1\nNumber of zero filled bytes - 1456\nDuration(sec) - 5\n",
    )?;
    write("ti_cfg", "clean", made::CLEAN_CFG.as_bytes())?;
    let radar = include_str!("../../../configs/radars/iwr1443-radhar.toml");
    write("radar_toml", "radar", radar.as_bytes())?;
    let channel = "radar = \"awr1843boost\"\n[[channel]]\ngain_db = 0.5\nphase_deg = -12.5\n";
    write("radar_toml", "calibration", channel.as_bytes())?;
    let export = include_str!("../tests/data/awr1843.mmwave.json");
    write("studio_json", "awr1843", export.as_bytes())?;
    write(
        "studio_json",
        "setup",
        br#"{"mmWaveDevice": "awr1843", "capturedFiles": {"files": [{"processedFileName": "a.bin"}]}}"#,
    )
}
