//! `baselines render` and `baselines answers`: the same videos twice, answers that do not belong to them, and a server.

use std::{
    collections::BTreeMap,
    fs,
    io::{Read, Write},
    net::TcpListener,
    path::Path,
    thread,
};

use serde_json::{Value, json};

use crate::command::{radarllm, refused};

/// A folder with a data set of three test clips in `data`.
struct Fixture {
    folder: tempfile::TempDir,
}

impl Fixture {
    fn new() -> Self {
        let fixture = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        let config = "name = \"few\"\nseed = 3\nmax_frames = 12\nfacet_edge_m = 0.05\n[[source]]\nkind = \"procedural\"\ntrain = 1\nval = 1\ntest = 3\n";
        fixture.write("data.toml", config);
        let (config, data) = (fixture.path("data.toml"), fixture.path("data"));
        done(&["dataset", "build", &config, "--out", &data]);
        fixture
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().into()
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.folder.path().join(name), text).unwrap();
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.folder.path().join(name)).unwrap()
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).unwrap()
    }

    fn json_lines(&self, name: &str) -> Vec<Value> {
        let text = self.read(name);
        text.lines()
            .map(|l| serde_json::from_str(l).unwrap())
            .collect()
    }

    fn render(&self, out: &str, more: &[&str]) {
        let (data, out) = (self.path("data"), self.path(out));
        let args = [
            "baselines",
            "render",
            &data,
            "--true",
            "--count",
            "2",
            "--out",
            &out,
        ];
        done(&[&args[..], more].concat());
    }

    /// `baselines answers` of `renders` with these arguments.
    fn answers<T>(&self, run: impl Fn(&[&str]) -> T, more: &[&str]) -> T {
        let (renders, data, out) = (self.path("renders"), self.path("data"), self.path("out"));
        let args = [
            "baselines",
            "answers",
            &renders,
            "--data",
            &data,
            "--out",
            &out,
        ];
        run(&[&args[..], more].concat())
    }

    /// The message with which answers are refused.
    fn refused_answers(&self, answers: &str) -> String {
        self.write("bad.jsonl", answers);
        let bad = self.path("bad.jsonl");
        let message = self.answers(refused, &[&bad, "--as", "row"]);
        assert!(
            !self.folder.path().join("out/captions").exists(),
            "{message}"
        );
        message
    }
}

fn done(args: &[&str]) -> String {
    let output = radarllm(args);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args:?}: {stderr}");
    String::from_utf8(output.stdout).unwrap()
}

/// The bytes of all files below a folder, by their names in it.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_string();
        if path.is_dir() {
            let inside = contents(&path);
            found.extend(inside.into_iter().map(|(n, b)| (format!("{name}/{n}"), b)));
        } else {
            found.insert(name, fs::read(&path).unwrap());
        }
    }
    found
}

#[test]
fn videos_are_the_same_twice_and_prompts_have_their_hashes() {
    let fixture = Fixture::new();
    fixture.render("a", &[]);
    fixture.render("b", &[]);
    fixture.render("side", &["--camera", "three-quarter"]);
    fixture.render("png", &["--frames", "png"]);
    let of = |name: &str| contents(&fixture.folder.path().join(name));
    let (a, png) = (of("a"), of("png"));
    assert_eq!(a, of("b"));
    let prompts = fixture.json_lines("a/prompts.jsonl");
    assert_eq!((prompts.len(), a.len()), (2, 4));
    for (i, prompt) in prompts.iter().enumerate() {
        let (id, video) = (
            prompt["id"].as_str().unwrap(),
            prompt["video"].as_str().unwrap(),
        );
        assert_eq!(
            video,
            format!("{i:05}-{}.avi", id.replace([':', '#', '?', '='], "_"))
        );
        assert!(a[video].starts_with(b"RIFF"));
        assert_eq!(prompt["blake3"], blake3::hash(&a[video]).to_hex().as_str());
        assert_ne!(a[video], of("side")[video]);
    }
    let render = fixture.json("a/render.json");
    let shown = ["data", "seed", "split", "bodies", "camera", "count"].map(|key| &render[key]);
    let expected = [
        json!("few"),
        json!(3),
        json!("test"),
        json!("true"),
        json!("radar"),
        json!(2),
    ];
    assert_eq!(shown, expected.each_ref());
    // Frames of a folder have the hash of their bytes in the order of their names.
    let first = &fixture.json_lines("png/prompts.jsonl")[0];
    let folder = format!("{}/", first["video"].as_str().unwrap());
    let mut hasher = blake3::Hasher::new();
    for (_, bytes) in png.iter().filter(|(name, _)| name.starts_with(&folder)) {
        assert!(bytes.starts_with(b"\x89PNG"));
        hasher.update(bytes);
    }
    assert_eq!(first["blake3"], hasher.finalize().to_hex().as_str());
    // A finished folder is not overwritten, and one of the two kinds of bodies has to be chosen.
    let (data, a, c) = (fixture.path("data"), fixture.path("a"), fixture.path("c"));
    let again = refused(&["baselines", "render", &data, "--true", "--out", &a]);
    assert!(again.contains("exists already"), "{again}");
    let none = refused(&["baselines", "render", &data, "--out", &c]);
    assert!(none.contains("--pose"), "{none}");
    assert!(!Path::new(&c).exists());
}

#[test]
fn answers_become_captions_or_are_refused_with_the_clip_and_both_sides() {
    let fixture = Fixture::new();
    fixture.render("renders", &[]);
    let prompts = fixture.json_lines("renders/prompts.jsonl");
    let [a, b] = [0, 1].map(|i| prompts[i]["id"].as_str().unwrap());
    let [hash_a, hash_b] = [0, 1].map(|i| prompts[i]["blake3"].as_str().unwrap());
    let answer = |id: &str, hash: &str, changes: Value| {
        let mut answer = json!({
            "id": id, "text": " A person walks. Slowly.\n", "blake3": hash,
            "model": "m", "weights": "w", "commit": "c",
        });
        for (key, value) in changes.as_object().unwrap() {
            answer[key] = value.clone();
        }
        format!("{answer}\n")
    };
    let good = |id, hash| answer(id, hash, json!({}));
    let (first, second) = (good(a, hash_a), good(b, hash_b));
    let with = |changes: Value| first.clone() + &answer(b, hash_b, changes);
    for (answers, parts) in [
        (first.clone(), vec!["no answer about", b, "prompts.jsonl"]),
        (String::new(), vec!["no answer about", a]),
        (
            first.clone() + &second + &second,
            vec![b, "line 2", "line 3"],
        ),
        (
            first.clone() + &second + &good("z#9", hash_a),
            vec!["line 3", "z#9"],
        ),
        (with(json!({ "blake3": hash_a })), vec![b, hash_a, hash_b]),
        (with(json!({ "model": "n" })), vec![a, b, "`m`", "`n`"]),
        (
            with(json!({ "weights": "v" })),
            vec!["weights", "`v`", "`w`"],
        ),
        (with(json!({ "commit": "d" })), vec!["commit", "`d`", "`c`"]),
        (
            with(json!({ "commit": "" })),
            vec!["does not state its commit", b],
        ),
        (with(json!({ "text": " \n" })), vec!["empty", b]),
        (
            with(json!({ "text": null })),
            vec!["line 2", "expected a string"],
        ),
        (
            with(json!({ "sha256": "x" })),
            vec!["line 2", "unknown field"],
        ),
        (first.clone() + "[[[[", vec!["line 2"]),
        (
            first.clone() + &"x".repeat(2 << 20),
            vec!["line 2", "longer than"],
        ),
    ] {
        let message = fixture.refused_answers(&answers);
        for part in parts {
            assert!(message.contains(part), "{part:?} is not in {message}");
        }
    }
    // In another order they are good; the first sentences are a second row.
    fixture.write("good.jsonl", &(second + &first));
    let good = fixture.path("good.jsonl");
    let named = |name| fixture.answers(refused, &[&good, "--as", name]);
    assert!(named("../row").contains("not a name of a row"));
    fixture.answers(done, &[&good, "--as", "row@1", "--first-sentence"]);
    let captions = fixture.json_lines("out/captions/row@1.jsonl");
    assert_eq!(
        captions[0],
        json!({ "id": a, "text": " A person walks. Slowly.\n" })
    );
    assert_eq!(captions[1]["id"], b);
    let short = fixture.json_lines("out/captions/row@1-first-sentence.jsonl");
    assert_eq!(short[1], json!({ "id": b, "text": "A person walks." }));
    let head = fixture.json("out/captions/row@1.json");
    let render = fs::read(fixture.path("renders/render.json")).unwrap();
    assert_eq!(
        head["renders_blake3"],
        blake3::hash(&render).to_hex().as_str()
    );
    assert_eq!(
        [&head["name"], &head["model"], &head["commit"]],
        ["row@1", "m", "c"]
    );
    assert!(named("row@1").contains("exists already"));
    // Prompts that are not those of the folder, and a data set that is another one.
    let text = fixture.read("renders/prompts.jsonl");
    fixture.write(
        "renders/prompts.jsonl",
        &text.replacen("one person", "two people", 1),
    );
    assert!(named("other").contains("render.json"));
    fixture.write("renders/prompts.jsonl", &text);
    let config = fixture.read("data.toml").replace("seed = 3", "seed = 4");
    fixture.write("data.toml", &config);
    let (config, data) = (fixture.path("data.toml"), fixture.path("data"));
    done(&["dataset", "build", &config, "--out", &data, "--force"]);
    let other = named("other");
    assert!(
        other.contains("seed 3") && other.contains("seed 4"),
        "{other}"
    );
}

/// Answers this number of requests, one a connection, as servers of chat completions do; returns their bodies.
fn server(n_requests: usize) -> (String, thread::JoinHandle<Vec<Value>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}/v1", listener.local_addr().unwrap());
    let requests = thread::spawn(move || {
        let one = |number: usize| {
            let (mut stream, _) = listener.accept().unwrap();
            let (mut bytes, mut buffer) = (Vec::new(), vec![0; 1 << 16]);
            let body = loop {
                let n = stream.read(&mut buffer).unwrap();
                bytes.extend_from_slice(&buffer[..n]);
                let text = String::from_utf8_lossy(&bytes).into_owned();
                let Some((head, body)) = text.split_once("\r\n\r\n") else {
                    continue;
                };
                let length = head.split("Content-Length: ").nth(1).unwrap();
                let length: usize = length.lines().next().unwrap().parse().unwrap();
                assert!(
                    head.starts_with("POST /v1/chat/completions HTTP/1.1"),
                    "{head}"
                );
                assert!(head.contains("Authorization: Bearer t0ken"), "{head}");
                if body.len() >= length {
                    break serde_json::from_str(body).unwrap();
                }
            };
            let reply = json!({
                "model": "org/Video-Model",
                "choices": [{ "message": { "content": format!("A person walks, {number}.") } }],
            });
            let reply = reply.to_string();
            let length = reply.len();
            write!(
                stream,
                "HTTP/1.1 200 OK\r\nContent-Length: {length}\r\n\r\n{reply}"
            )
            .unwrap();
            body
        };
        (0..n_requests).map(one).collect()
    });
    (url, requests)
}

#[test]
fn a_server_is_shown_frames_and_names_the_row() {
    let fixture = Fixture::new();
    fixture.render("renders", &[]);
    let (url, requests) = server(2);
    let ask = |args: &[&str]| {
        std::process::Command::new(env!("CARGO_BIN_EXE_radarllm"))
            .args(args)
            .env("RADARLLM_ENDPOINT_TOKEN", "t0ken")
            .output()
            .unwrap()
    };
    let more = [
        "--endpoint",
        &url,
        "--endpoint-model",
        "v",
        "--sample-frames",
        "3",
    ];
    let output = fixture.answers(ask, &more);
    assert!(output.status.success(), "{output:?}");
    let captions = fixture.json_lines("out/captions/org_Video-Model.jsonl");
    assert_eq!(captions[1]["text"], "A person walks, 1.");
    let head = fixture.json("out/captions/org_Video-Model.json");
    assert_eq!(head["model"], "org/Video-Model");
    for request in requests.join().unwrap() {
        assert_eq!(request["model"], "v");
        let content = request["messages"][0]["content"].as_array().unwrap();
        assert_eq!(content.len(), 4);
        let image = content[0]["image_url"]["url"].as_str().unwrap();
        // The first bytes of a JPEG file in Base64.
        assert!(
            image.starts_with("data:image/jpeg;base64,/9j/"),
            "{image:.60}"
        );
        assert!(
            content[3]["text"]
                .as_str()
                .unwrap()
                .contains("one short sentence")
        );
    }
    // Nothing is asked twice: the server is gone, and the answers are there.
    let output = fixture.answers(ask, &[&more[..], &["--force"]].concat());
    assert!(output.status.success(), "{output:?}");
    let gone = fixture.answers(refused, &["--endpoint", &url]);
    assert!(gone.contains("cannot connect"), "{gone}");
    let secure = fixture.answers(refused, &["--endpoint", "https://example.org/v1"]);
    assert!(secure.contains("proxy"), "{secure}");
    // A video that was changed is not shown.
    let prompts = fixture.json_lines("renders/prompts.jsonl");
    let video = format!("renders/{}", prompts[0]["video"].as_str().unwrap());
    let mut bytes = fs::read(fixture.path(&video)).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(fixture.path(&video), bytes).unwrap();
    let changed = fixture.answers(refused, &["--endpoint", "http://127.0.0.1:9/v1"]);
    assert!(
        changed.contains("BLAKE3") && changed.contains(&*video),
        "{changed}"
    );
}
