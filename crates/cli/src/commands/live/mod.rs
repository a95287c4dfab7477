//! `live` and `ask`: a running radar, questions about what it saw, and forgetting it.

mod args;

use std::{
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use radarllm_base::civil::{midnight_ms, utc_ms};
use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};
use radarllm_io::{
    live::{Dca1000, DcaOptions, LiveSource, TiBoard, TiBoardOptions},
    serial, udp,
};
use radarllm_live::{
    Input, Live, LiveOptions, Speed,
    bus::Silence,
    http::{self, Token},
    local_time::{self, now_ms},
    mqtt::{self, Password},
    notify::Supervisor,
    room::RoomOptions,
    zones,
};
use radarllm_memory::{
    Clock, Store, StoreError, Timeline, ask,
    store::{Deleted, Retention},
};
use radarllm_monitor::{
    falls::FallOptions,
    options::OptionError,
    pipeline::{
        PipelineOptions,
        empty::EmptyRoom,
        windows::{WindowOptions, Windows},
    },
    presence::PresenceOptions,
    watch::WatchOptions,
};

use crate::{
    error::{CliError, CliResult},
    model, output,
    user_memory::load_memory,
};

pub(crate) use args::{AskArgs, LiveArgs};
use args::{LiveForgetArgs, LiveVerb};

const DAY_MS: i64 = 86_400_000;

/// Runs a radar until it ends or until Ctrl-C, or deletes from its memory.
pub(crate) fn run(args: &LiveArgs) -> CliResult {
    match &args.verb {
        Some(LiveVerb::Forget(args)) => forget(args),
        None => watch(args),
    }
}

fn watch(args: &LiveArgs) -> CliResult {
    let stop = Arc::new(AtomicBool::new(false));
    let stopping = Arc::clone(&stop);
    ctrlc::set_handler(move || stopping.store(true, Ordering::Release))
        .map_err(|e| CliError::new(format!("Ctrl-C: {e}")))?;
    let mut captioner = model::captioner(args.model.as_deref(), args.decoder)?;
    if let Some(memory) = load_memory(args.memory.as_deref())? {
        captioner = captioner.with_memory(&memory);
    }
    let site = args.site.as_deref().map(radarllm::read_site).transpose()?;
    captioner = captioner.with_site(site);
    let options = options(args)?;
    let input = input(args)?;
    for note in input.notes() {
        note!("{}: {note}", args.inputs[0].display());
    }
    let (live, mut messages) = Live::start_and_listen(input, captioner, options)?;
    if let Some(moved) = live.damaged_database() {
        note!(
            "warning: the database was damaged; it is now {}, and a new one was begun",
            moved.display()
        );
    }
    if let Some(address) = live.address() {
        note!("http://{address}/");
    }
    let mut supervisor = Supervisor::from_environment();
    supervisor.ready();
    let mut unprinted = None;
    let (mut broker_problem, mut memory_problem) = (None, None);
    let (mut is_model_reported, mut is_source_reported) = (false, false);
    let mut is_room_reported = false;
    while !stop.load(Ordering::Acquire) {
        match messages.recv_timeout(Duration::from_millis(200)) {
            Ok(_) if args.quiet => {}
            Ok(message) => match print(&message.json, args.json) {
                Ok(true) => {}
                // The reader of the sentences has gone, as with any other command.
                Ok(false) => break,
                // A supervisor starts the program anew, and meanwhile knows that it stopped.
                Err(error) => {
                    unprinted = Some(error);
                    break;
                }
            },
            Err(_) if live.is_over() => break,
            // The radar goes on, whether or not anybody reads what is printed.
            Err(Silence::Closed) => {
                note!("warning: messages were not printed: the output is read too slowly");
                messages = live.subscribe();
            }
            Err(Silence::Timeout) => {}
        }
        let problem = live.broker_problem();
        if problem != broker_problem {
            match &problem {
                Some(problem) => note!("warning: the broker cannot be used: {problem}"),
                None => note!("the broker is connected again"),
            }
            broker_problem = problem;
        }
        let problem = live.memory_problem();
        if problem != memory_problem {
            match &problem {
                Some(problem) => note!("warning: {problem}; it is tried again every minute"),
                None => note!("the memory can be written again"),
            }
            memory_problem = problem;
        }
        // Once: a model that fails in every other window would fill the journal.
        if let Some(problem) = live.model_problem().filter(|_| !is_model_reported) {
            note!("warning: {problem}; /healthz and /metrics count further errors");
            is_model_reported = true;
        }
        if let Some(learnt) = live.room_learnt().filter(|_| !is_room_reported) {
            note!("{learnt}");
            is_room_reported = true;
        }
        // Once: nothing is lost meanwhile, and what is not known today is not known tomorrow.
        if let Some(problem) = live.source_problem().filter(|_| !is_source_reported) {
            note!("warning: {problem}; live goes on");
            is_source_reported = true;
        }
        if live.is_moving() {
            supervisor.alive();
        }
    }
    supervisor.stopping();
    live.stop()?;
    unprinted.map_or(Ok(()), Err)
}

/// Deletes what was seen before a date.
fn forget(args: &LiveForgetArgs) -> CliResult {
    let path = existing_database(args.db.as_deref())?;
    let before_ms = match args.before.as_str() {
        "now" => now_ms(),
        date => {
            let utc_ms = midnight_ms(date).ok_or_else(|| {
                CliError::new(format!("--before: `{date}` is no date"))
                    .hint("write it as 2026-11-01, or `now` for everything")
            })?;
            utc_ms - 1_000 * i64::from(local_time::offset_s(utc_ms))
        }
    };
    // A store that is opened is created where there is none; a wrong name must not make a database.
    Timeline::open(&path).map_err(CliError::new)?;
    let opened = Store::open(&path, now_ms()).map_err(|error| {
        let is_locked = matches!(error, StoreError::Locked { .. });
        let error = CliError::new(error);
        match is_locked {
            true => error.hint("stop `live` first, or use `Forget this range` on its page"),
            false => error,
        }
    })?;
    if let Some(damaged) = opened.set_aside {
        return Err(CliError::new(format!(
            "the database is damaged ({}); it is now {}",
            damaged.problem,
            damaged.path.display()
        ))
        .hint("delete that file to forget what it holds"));
    }
    let mut store = opened.store;
    let deleted = store.forget(None, before_ms).map_err(CliError::new)?;
    match args.json {
        true => output::print_json(&deleted),
        false => {
            let Deleted {
                activities, events, ..
            } = deleted;
            output::print_line(&format!(
                "forgot {activities} activities and {events} events"
            ));
            Ok(())
        }
    }
}

/// Answers a question about what was seen.
pub(crate) fn answer(args: &AskArgs) -> CliResult {
    let path = existing_database(args.db.as_deref())?;
    let timeline = Timeline::open(&path).map_err(CliError::new)?;
    let now_ms = now_ms();
    let clock = Clock {
        now_ms,
        offset_s: local_time::offset_s(now_ms),
    };
    let answer = ask(&timeline, &args.question, clock).map_err(CliError::new)?;
    match args.json {
        true => output::print_json(&answer),
        false => {
            output::print_line(&answer.answer);
            Ok(())
        }
    }
}

fn input(args: &LiveArgs) -> CliResult<Input> {
    let input = source(args)?;
    let Some(start) = &args.start else {
        return Ok(input);
    };
    let start_ms = utc_ms(start).ok_or_else(|| {
        CliError::new(format!("--start: `{start}` is no time in UTC"))
            .hint("write it as 2026-11-20T08:00:00Z")
    })?;
    Ok(input.starting_at(start_ms)?)
}

/// What frames come from.
#[derive(Clone, Copy, PartialEq, Eq)]
enum SourceKind {
    Room,
    Board,
    Card,
    Recording,
}

/// Refuses options that mean nothing for the source, because they would be ignored.
fn check_source(args: &LiveArgs, kind: SourceKind) -> CliResult {
    use SourceKind::{Board, Card, Recording, Room};
    let options = [
        ("--speed", args.speed.is_some(), Recording),
        ("--start", args.start.is_some(), Recording),
        ("--loop", args.repeats, Recording),
        ("--cli-port", args.cli_port.is_some(), Board),
        ("--dca", args.dca.is_some(), Card),
        ("--sim-seed", args.sim_seed.is_some(), Room),
        ("--sim-fall-every", args.sim_fall_every.is_some(), Room),
    ];
    let mut foreign = options
        .iter()
        .filter(|(_, is_given, of)| *is_given && *of != kind);
    let Some((flag, _, of)) = foreign.next() else {
        return Ok(());
    };
    let of = match of {
        Room => "the simulated room, `sim:`",
        Board => "a board on a serial port",
        Card => "a DCA1000, `udp:PORT`",
        Recording => "a recording, which is replayed",
    };
    let input = args.inputs[0].display();
    Err(CliError::new(format!(
        "{flag} has no meaning for `{input}`: it is an option of {of}"
    )))
}

fn source(args: &LiveArgs) -> CliResult<Input> {
    let name = args.inputs[0].to_string_lossy().into_owned();
    let kind = if name == "sim:" {
        SourceKind::Room
    } else if serial::is_port(&args.inputs[0]) {
        SourceKind::Board
    } else if udp::address(&name).is_some() {
        SourceKind::Card
    } else {
        SourceKind::Recording
    };
    check_source(args, kind)?;
    if kind == SourceKind::Room {
        let defaults = RoomOptions::default();
        return Ok(Input::room(&RoomOptions {
            radar: args.input.radar.clone().unwrap_or(defaults.radar),
            seed: args.sim_seed.unwrap_or(defaults.seed),
            fall_every_s: args.sim_fall_every,
        })?);
    }
    let capture = args.input.options()?;
    let source: Box<dyn LiveSource> = if kind == SourceKind::Board {
        Box::new(TiBoard::open(TiBoardOptions {
            data: args.inputs[0].clone(),
            cli: args.cli_port.clone(),
            capture,
            ..TiBoardOptions::default()
        })?)
    } else if kind == SourceKind::Card {
        Box::new(Dca1000::open(DcaOptions {
            input: name.clone(),
            card: args.dca,
            configure: args.dca.is_some(),
            capture,
            ..DcaOptions::default()
        })?)
    } else {
        let speed = match args.speed.as_deref() {
            None => Speed::Times(1.0),
            Some("max") => Speed::Max,
            Some(times) => Speed::Times(times.parse().map_err(|_| {
                CliError::new(format!(
                    "--speed: expected a number or `max`, found `{times}`"
                ))
            })?),
        };
        let recording = radarllm::open_parts(&args.inputs).with_options(capture);
        return Ok(Input::replay(
            &name,
            recording.points()?,
            speed,
            args.repeats,
        )?);
    };
    Ok(Input::radar(&name, source))
}

/// Text of a file with a secret. Warns if every user of the computer may read it.
fn read_secret(path: &Path) -> CliResult<String> {
    let secret = bounded::read_text(path, MAX_CONFIG_BYTES)?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = path.metadata().map_or(0, |file| file.permissions().mode());
        if mode & 0o004 != 0 {
            let path = path.display();
            note!(
                "warning: {path}: every user of this computer may read the secret (mode {:04o}); \
                 `chmod 600 {path}` keeps it to its owner",
                mode & 0o7777
            );
        }
    }
    Ok(secret)
}

fn options(args: &LiveArgs) -> CliResult<LiveOptions> {
    let token = |path| Token::new(&read_secret(path)?).map_err(CliError::new);
    let page = http::Options {
        token: args.token_file.as_deref().map(token).transpose()?,
        allow_hosts: args.allow_host.clone(),
        allow_frames: args.allow_frame.clone(),
        ..http::Options::new(args.http)
    };
    let broker = match &args.mqtt {
        Some(url) => Some(mqtt::Options {
            user: args.mqtt_user.clone(),
            password: match &args.mqtt_password_file {
                Some(path) => Some(Password::new(&read_secret(path)?)),
                None => None,
            },
            discovery_prefix: args.discovery_prefix.clone(),
            allow_synthetic: args.mqtt_simulated,
            ..mqtt::Options::new(url.parse().map_err(CliError::new)?)
        }),
        None => None,
    };
    Ok(LiveOptions {
        name: args.name.clone(),
        pipeline: pipeline_options(args)?,
        page: (!args.no_http).then_some(page),
        database: database(args.db.as_deref()),
        retention: Retention {
            activities_ms: i64::from(args.keep_captions) * DAY_MS,
            events_ms: i64::from(args.keep_events) * DAY_MS,
            max_bytes: u64::from(args.db_max_mb) << 20,
            ..Retention::default()
        },
        broker,
    })
}

fn pipeline_options(args: &LiveArgs) -> CliResult<PipelineOptions> {
    let options = PipelineOptions {
        watch: WatchOptions {
            presence: PresenceOptions {
                occupancy_on_s: args.occupancy_on,
                occupancy_hold_s: args.occupancy_hold,
            },
            falls: FallOptions {
                fall_dwell_s: args.fall_dwell,
                fall_height_m: args.fall_height,
            },
            zones: match &args.zones {
                Some(path) => zones::parse(path, &bounded::read_text(path, MAX_CONFIG_BYTES)?)?,
                None => Default::default(),
            },
            ..WatchOptions::default()
        },
        windows: WindowOptions {
            window_s: args.window,
            stride_s: args.stride,
            ..WindowOptions::default()
        },
        learn_empty_s: args.learn_empty,
        ..PipelineOptions::default()
    };
    // Checked here, where their flags are known.
    options.watch.presence.validate().map_err(by_flag)?;
    options.watch.falls.validate().map_err(by_flag)?;
    Windows::new(options.windows).map_err(by_flag)?;
    EmptyRoom::new(options.learn_empty_s).map_err(by_flag)?;
    Ok(options)
}

/// An option of the pipeline that is out of range, by its flag.
fn by_flag(error: OptionError) -> CliError {
    let flag = match error.field {
        "window_s" => "--window",
        "stride_s" => "--stride",
        "learn_empty_s" => "--learn-empty",
        "occupancy_on_s" => "--occupancy-on",
        "occupancy_hold_s" => "--occupancy-hold",
        "fall_dwell_s" => "--fall-dwell",
        "fall_height_m" => "--fall-height",
        _ => return CliError::new(error),
    };
    let OptionError {
        expected, found, ..
    } = error;
    CliError::new(format!("{flag}: expected {expected}, found {found}"))
}

/// The database that is named, or that of the service.
fn database(named: Option<&Path>) -> Option<PathBuf> {
    let of_service = || {
        let folder = std::env::var_os("STATE_DIRECTORY").filter(|v| !v.is_empty())?;
        Some(PathBuf::from(folder).join("live.db"))
    };
    named.map(PathBuf::from).or_else(of_service)
}

fn existing_database(named: Option<&Path>) -> CliResult<PathBuf> {
    database(named).ok_or_else(|| {
        CliError::new("no database is named").hint("--db wants the file that `live --db` writes")
    })
}

/// Prints a message: sentences and falls, or everything but points as JSON. Returns whether there is still a reader.
fn print(json: &str, as_json: bool) -> CliResult<bool> {
    let message: serde_json::Value = serde_json::from_str(json).unwrap_or_default();
    let text = |key: &str| message[key].as_str().unwrap_or_default().to_owned();
    let kind = text("type");
    if as_json {
        return match kind.as_str() {
            "frame" => Ok(true),
            _ => output::try_print_line(json),
        };
    }
    let simulated = match message["synthetic"].as_bool() {
        Some(true) => "SIMULATED ",
        _ => "",
    };
    let (utc, person) = (text("utc"), &message["person"]);
    match (kind.as_str(), message["caption"].as_str()) {
        ("now", Some(caption)) => {
            let confidence = match message["confidence"].as_f64() {
                Some(confidence) => format!(" ({confidence:.2})"),
                None => String::new(),
            };
            output::try_print_line(&format!(
                "{utc} {simulated}person {person}: {caption}{confidence}"
            ))
        }
        ("fall", _) => {
            let state = text("state");
            output::try_print_line(&format!("{utc} {simulated}person {person}: fall {state}"))
        }
        ("presence", _) => {
            let state = text("state");
            output::try_print_line(&format!("{utc} {simulated}room: {state}"))
        }
        _ => Ok(true),
    }
}
