//! Which inputs there are, and what is looked at of each.

use super::{
    Outcome, Scratch, chosen, inputs,
    inputs::{ROOM, SMALL_CFG, TWO_PEOPLE},
    rounded,
};
use crate::made::{self, PcapStyle};

/// Name of the input, and what makes it and looks at what comes of it.
pub type Case = (&'static str, fn(&Scratch) -> Outcome);

pub const CASES: [Case; 34] = [
    ("built-in: walks backward", |s| {
        s.motion("builtin:walk?direction=backward&duration_s=3", &[])
    }),
    ("built-in: waves left", |s| {
        s.motion("builtin:wave?side=left", &["--seed", "3"])
    }),
    ("built-in: sits down", |s| s.motion("builtin:sit_down", &[])),
    ("built-in: falls", |s| {
        s.motion(
            "builtin:fall",
            &["--distance-m", "2.5", "--radar-height-m", "1.3"],
        )
    }),
    ("built-in: two motions in turn", |s| {
        s.motion("builtin:walk+then+sit_down?walk.speed=slow", &[])
    }),
    ("built-in: another radar", |s| {
        s.motion("builtin:clap?repetitions=2", &["--radar", "iwr6843isk"])
    }),
    ("built-in: other decoders", |s| {
        let input = "builtin:punch?side=right";
        let int8 = s.describe(&[input, "--decoder", "int8"]);
        Outcome::default()
            .everywhere("beam", s.describe(&[input, "--beam", "4"]))
            .everywhere("int8", chosen(&int8[0], "caption tokens"))
    }),
    ("scene: the slow exact path", |s| {
        let scene = ["duration_s = 0.2\n", inputs::LAMP, inputs::PASSER_BY];
        s.write("scene.toml", scene.concat());
        let args = ["simulate", "scene.toml", "--out", "points.parquet"];
        s.json(&[&args[..], &["--reference"]].concat());
        Outcome::default().computed("points", s.points("points.parquet"))
    }),
    ("BVH", |s| {
        s.write("take.bvh", inputs::bvh(90));
        s.motion("take.bvh", &[])
    }),
    ("ASF and AMC", |s| {
        let (asf, amc) = inputs::asf_amc(300);
        s.write("take.asf", asf);
        s.write("take.amc", amc);
        s.motion("take.amc", &[])
    }),
    ("scene with a room", |s| {
        s.write("room.toml", ROOM);
        s.json(&["simulate", "room.toml", "--out", "points.parquet"]);
        Outcome::default()
            .computed("points", s.points("points.parquet"))
            .everywhere("describe", s.describe(&["points.parquet"]))
    }),
    ("UART", |s| {
        s.write("uart.dat", inputs::uart(&walker()));
        s.recording("uart.dat", &["--frame-rate", "10"])
    }),
    ("UART, a tilted sensor", |s| {
        s.write("uart.dat", inputs::uart(&walker()));
        let options = [
            "--frame-rate",
            "20",
            "--tilt-deg",
            "15",
            "--yaw-deg",
            "-10",
            "--radar-height-m",
            "2.2",
        ];
        s.recording("uart.dat", &options)
    }),
    ("RadHAR", |s| {
        s.write("radhar.txt", inputs::radhar(&walker()));
        s.recording("radhar.txt", &[])
    }),
    ("MARS table", |s| {
        s.write("mars.csv", inputs::mars(&walker()));
        s.recording("mars.csv", &[])
    }),
    ("MARS feature maps", |s| {
        s.write("features.npy", inputs::mars_features(&walker()));
        s.recording("features.npy", &[])
    }),
    ("points table, CSV", |s| {
        s.write("points.csv", inputs::csv(&walker()));
        s.recording("points.csv", &[])
    }),
    ("points table, npy", |s| {
        s.write("table.npy", inputs::npy_table(&walker()));
        s.recording("table.npy", &[])
    }),
    ("points table, 5 frames/s", |s| {
        s.write("points.csv", inputs::csv(&walker()));
        let args = ["points.csv", "--out", "points.parquet", "--resample", "5"];
        s.json(&[&["process"], &args[..]].concat());
        Outcome::default()
            .everywhere("points", s.points("points.parquet"))
            .everywhere("describe", s.describe(&["points.parquet"]))
    }),
    ("MM-Fi", |s| {
        for (i, points) in walker().iter().enumerate() {
            s.write(
                &format!("mmwave/frame{:03}.bin", i + 1),
                inputs::mmfi(points),
            );
        }
        s.recording("mmwave", &["--orientation", "forward-left-up"])
    }),
    ("mmBody", |s| {
        for (i, points) in walker().iter().enumerate() {
            let name = format!("rain/sequence_0/radar/frame_{i}.npy");
            s.write(&name, inputs::mmbody(points));
        }
        s.recording("rain/sequence_0", &["--frame-rate", "10"])
    }),
    ("two people in a table", |s| {
        s.write("empty.csv", inputs::csv(&inputs::cloud(20, &[])));
        s.write("two.csv", inputs::csv(&two_walkers()));
        let args = [
            "process",
            "two.csv",
            "--out",
            "p.parquet",
            "--people",
            "auto",
            "--drop-ghosts",
        ];
        let report = s.json(&args);
        let people = report["people"].as_array().map_or(0, Vec::len);
        let mut outcome = Outcome::default()
            .everywhere("people", people.into())
            .everywhere("describe", s.describe(&["two.csv", "--people", "auto"]));
        for name in s.names(".", ".parquet") {
            let points = s.points(&name);
            outcome = outcome.everywhere(&name, points);
        }
        outcome
    }),
    ("raw samples, npy", |s| {
        let scene = [
            "duration_s = 0.4\n[noise]\nsnr_db = 20.0\n",
            inputs::LAMP,
            inputs::PASSER_BY,
        ];
        s.simulate_samples(&scene.concat(), "raw.npy");
        s.samples("raw.npy", &[])
    }),
    ("raw samples, an empty room subtracted", |s| {
        let scene = ["duration_s = 0.4\n", inputs::LAMP];
        s.simulate_samples(&scene.concat(), "empty.npy");
        s.simulate_samples(
            &[&scene[..], &[inputs::PASSER_BY]].concat().concat(),
            "raw.npy",
        );
        let options = ["--background", "empty.npy", "--remove-leakage", "0.3"];
        s.samples("raw.npy", &options)
    }),
    ("raw samples, two people", |s| {
        s.simulate_samples(TWO_PEOPLE, "raw.npy");
        s.samples("raw.npy", &["--people", "auto"]).everywhere(
            "describe raw",
            s.describe(&["raw.npy", "--radar", "small.cfg"]),
        )
    }),
    ("raw words", |s| {
        s.write("adc_data.bin", inputs::raw_words(24));
        s.samples("adc_data.bin", &["--iq", "i-first"])
    }),
    ("raw words, Q first and another chain", |s| {
        s.write("adc_data.bin", inputs::raw_words(3));
        let chain = "[processing]\nmax_points = 20\nmax_range_m = 5.0\nmap = \"coherent\"\n\
                     detector = { kind = \"top_k\" }\n";
        s.write("chain.toml", chain);
        let options = [
            "--iq",
            "q-first",
            "--processing",
            "chain.toml",
            "--frames",
            "2",
        ];
        s.samples("adc_data.bin", &options)
    }),
    ("DCA1000 records", |s| {
        let sent = made::datagrams(&inputs::raw_words(16), 1456);
        s.write("adc_Raw_0.bin", made::records(&sent));
        s.samples("adc_Raw_0.bin", &["--iq", "i-first"])
    }),
    ("pcap with a lost packet", |s| {
        let mut sent = made::datagrams(&inputs::raw_words(16), 1456);
        sent.swap(5, 6);
        sent.remove(20);
        let frames: Vec<Vec<u8>> = sent
            .iter()
            .map(|d| made::ethernet(0, &made::ipv4(4098, d)))
            .collect();
        let style = PcapStyle {
            is_big_endian: false,
            is_nanoseconds: false,
            link: 1,
        };
        s.write("a.pcap", made::pcap(&style, &frames));
        s.samples("a.pcap", &["--iq", "i-first"])
    }),
    ("radars", |s| {
        s.write("small.cfg", SMALL_CFG);
        let names = [
            "awr1843boost",
            "iwr6843isk",
            "iwrl6432",
            "awr2243-cascade",
            "small.cfg",
        ];
        names.iter().fold(Outcome::default(), |outcome, radar| {
            let shown = s.json(&["radar", "show", radar]);
            outcome.everywhere(radar, rounded(&shown))
        })
    }),
    ("caption scores", |s| {
        s.write("c.jsonl", inputs::CANDIDATES);
        s.write("r.jsonl", inputs::REFERENCES);
        let protocols = ["plain", "nlg-eval", "coco", "motiongpt"];
        protocols.iter().fold(Outcome::default(), |outcome, protocol| {
            let args = ["score", "--candidates", "c.jsonl", "--references", "r.jsonl"];
            let scores = s.json(&[&args[..], &["--protocol", protocol]].concat());
            let fields = "bleu_1 bleu_2 bleu_3 bleu_4 rouge_1 rouge_l rouge_l_coco meteor cider_d cider self_bleu \
                          protocol meteor_matchers ci95 items";
            outcome.everywhere(protocol, chosen(&scores, fields))
        })
    }),
    ("pose scores", |s| {
        let reference: Vec<f64> = (0..36).map(|i| 0.1 * f64::from(i)).collect();
        let moved = |(i, v): (usize, &f64)| v + [0.03, 0.04, -0.01][i % 3] * (i / 6) as f64;
        let estimated: Vec<f64> = reference.iter().enumerate().map(moved).collect();
        s.write("r.npy", inputs::npy("(2, 6, 3)", &reference));
        s.write("c.npy", inputs::npy("(2, 6, 3)", &estimated));
        let args = [
            "score",
            "--pose",
            "--candidates",
            "c.npy",
            "--references",
            "r.npy",
        ];
        let fields = "mpjre_deg mpjpe_cm mpvpe_cm mte_cm";
        Outcome::default().everywhere("scores", chosen(&s.json(&args), fields))
    }),
    ("data set", |s| {
        s.write("data.toml", inputs::DATA_SET);
        s.json(&["dataset", "build", "data.toml", "--out", "data"]);
        s.names("data/data", "")
            .iter()
            .fold(Outcome::default(), |outcome, name| {
                let hash = s.bytes(&format!("data/data/{name}"));
                outcome.fused(name, hash)
            })
    }),
    ("demo", |s| {
        let rows = s.json(&["demo"]);
        let captions = rows
            .as_array()
            .unwrap()
            .iter()
            .map(|row| row["caption"].clone());
        Outcome::default().everywhere("captions", captions.collect())
    }),
];

fn walker() -> Vec<Vec<inputs::Point>> {
    inputs::cloud(35, &[(0.3, 3.8, -0.7)])
}

fn two_walkers() -> Vec<Vec<inputs::Point>> {
    inputs::cloud(40, &[(-1.0, 2.0, 0.5), (1.0, 4.0, -0.5)])
}
