//! Arguments of `live` and `ask`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use radarllm_monitor::{
    falls::FallOptions, pipeline::windows::WindowOptions, presence::PresenceOptions,
};

use crate::{model_args::DecoderName, recording_args::InputArgs};

/// `live`.
#[derive(Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct LiveArgs {
    #[command(subcommand)]
    pub verb: Option<LiveVerb>,
    /// A serial port, `udp:PORT` for a DCA1000, a recording of any format to replay, or `sim:` for a simulated room.
    #[arg(required = true)]
    pub inputs: Vec<PathBuf>,
    /// Serial port of the board's command line: the .cfg of --radar is sent there. Low-power boards have one
    /// port for both.
    #[arg(long, value_name = "PORT")]
    pub cli_port: Option<PathBuf>,
    /// Address of the DCA1000, which is configured and started.
    #[arg(long, value_name = "ADDRESS")]
    pub dca: Option<std::net::IpAddr>,
    /// How fast a recording is replayed: times its own speed, or `max`; 1 if omitted.
    #[arg(long)]
    pub speed: Option<String>,
    /// When the first frame of a recording was recorded, such as 2026-11-20T08:00:00Z; a replay ends now if omitted.
    #[arg(long, value_name = "UTC")]
    pub start: Option<String>,
    /// Replay the recording again and again.
    #[arg(long = "loop")]
    pub repeats: bool,
    /// Seed of the simulated room; 1 if omitted.
    #[arg(long)]
    pub sim_seed: Option<u64>,
    /// Let the person in the simulated room fall after this time and again, s.
    #[arg(long, value_name = "S")]
    pub sim_fall_every: Option<f64>,
    /// Name of this radar, for topics and titles: a-z, 0-9 and _.
    #[arg(long, default_value = "radar")]
    pub name: String,
    /// Model folder, or a bundled model: `features` (the default) or `tokens`.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Decoder of the language model.
    #[arg(long, value_enum, default_value = "f32")]
    pub decoder: DecoderName,
    /// File with taught activities; the user's own if omitted and there is one.
    #[arg(long, value_name = "FILE")]
    pub memory: Option<PathBuf>,
    /// File of the site, by `radarllm site`: tilt of the radar and height of a standing person.
    #[arg(long, value_name = "FILE")]
    pub site: Option<PathBuf>,
    /// How to read the input.
    #[command(flatten)]
    pub input: InputArgs,
    /// Address of the page. One that is not loopback needs --token-file.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8741")]
    pub http: std::net::SocketAddr,
    /// Serve no page.
    #[arg(long)]
    pub no_http: bool,
    /// File with the secret of those who may look, 16 characters or more.
    #[arg(long, value_name = "FILE", conflicts_with = "no_http")]
    pub token_file: Option<PathBuf>,
    /// Another name under which the page is reached.
    #[arg(long, value_name = "NAME", conflicts_with = "no_http")]
    pub allow_host: Vec<String>,
    /// Origin of pages that may show this one in a frame, such as http://homeassistant.local:8123.
    #[arg(long, value_name = "ORIGIN", conflicts_with = "no_http")]
    pub allow_frame: Vec<String>,
    /// Database of what was seen; live.db in $STATE_DIRECTORY if omitted, or none.
    #[arg(long, value_name = "FILE")]
    pub db: Option<PathBuf>,
    /// How long sentences are kept, days.
    #[arg(long, value_name = "DAYS", default_value_t = 30)]
    pub keep_captions: u32,
    /// How long events such as falls are kept, days.
    #[arg(long, value_name = "DAYS", default_value_t = 365)]
    pub keep_events: u32,
    /// Largest size of the database, MB.
    #[arg(long, value_name = "MB", default_value_t = 512)]
    pub db_max_mb: u32,
    /// File with zones of the room: [[zone]] with name, kind (room, ignore, door or bed), polygon_m and, to
    /// ignore pets, below_m.
    #[arg(long, value_name = "FILE")]
    pub zones: Option<PathBuf>,
    /// Length of the windows that are described, s: 1 to 9.6.
    #[arg(long, value_name = "S", default_value_t = WindowOptions::default().window_s)]
    pub window: f64,
    /// Time between the starts of two windows, s.
    #[arg(long, value_name = "S", default_value_t = WindowOptions::default().stride_s)]
    pub stride: f64,
    /// Learn the empty room for this long at the start, 300 s at most: what moves there, such as a fan or a curtain, is
    /// removed from then on. Nobody is seen meanwhile. See also --background.
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub learn_empty: f64,
    /// Time for which somebody must be tracked before the room counts as occupied, s.
    #[arg(long, value_name = "S", default_value_t = PresenceOptions::default().occupancy_on_s)]
    pub occupancy_on: f64,
    /// Time for which the room counts as occupied while nobody is seen, s.
    #[arg(long, value_name = "S", default_value_t = PresenceOptions::default().occupancy_hold_s)]
    pub occupancy_hold: f64,
    /// Time for which nobody must rise before a fall is confirmed, s.
    #[arg(long, value_name = "S", default_value_t = FallOptions::default().fall_dwell_s)]
    pub fall_dwell: f64,
    /// Height below which somebody is down, m.
    #[arg(long, value_name = "M", default_value_t = FallOptions::default().fall_height_m)]
    pub fall_height: f64,
    /// MQTT broker, such as mqtt://homeassistant.local.
    #[arg(long, value_name = "URL")]
    pub mqtt: Option<String>,
    /// User name at the broker.
    #[arg(long, value_name = "NAME", requires = "mqtt")]
    pub mqtt_user: Option<String>,
    /// File with the password at the broker.
    #[arg(long, value_name = "FILE", requires = "mqtt_user")]
    pub mqtt_password_file: Option<PathBuf>,
    /// First part of Home Assistant's topics of discovery.
    #[arg(long, value_name = "PREFIX", default_value = "homeassistant")]
    pub discovery_prefix: String,
    /// Publish a simulated radar, too.
    #[arg(long, requires = "mqtt")]
    pub mqtt_simulated: bool,
    /// Print no sentences. What is printed may be kept by others, such as the journal of systemd, where forgetting does
    /// not reach it.
    #[arg(long, conflicts_with = "json")]
    pub quiet: bool,
    /// Print every message but points as a line of JSON.
    #[arg(long)]
    pub json: bool,
}

/// What is done to the memory of `live`.
#[derive(Subcommand)]
pub(crate) enum LiveVerb {
    /// Delete what was seen before a date from the database, while `live` does not run. (A file of this name is
    /// ./forget.)
    ///
    /// Example: radarllm live forget --before 2026-11-01 --db live.db
    Forget(LiveForgetArgs),
}

/// `live forget`.
#[derive(Args)]
pub(crate) struct LiveForgetArgs {
    /// First date that is kept, YYYY-MM-DD in local time, or `now` to delete everything.
    #[arg(long, value_name = "DATE")]
    pub before: String,
    /// Database of `live`; live.db in $STATE_DIRECTORY if omitted.
    #[arg(long, value_name = "FILE")]
    pub db: Option<PathBuf>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `ask`.
#[derive(Args)]
pub(crate) struct AskArgs {
    /// The question, such as "when did she last get up?".
    ///
    /// It asks when, how often, how long or whether somebody did something, was there, came or left; what is so at
    /// present ("is anybody there?", "what is she doing?", "is the radar working?"); or what happened.
    /// Known times: today, yesterday morning, last night, on Monday, on 28 November, two days ago, in the last 3 hours,
    /// this week, this month, since 22:00, between 14:00 and 15:00, before 6 am, at 3 am yesterday.
    pub question: String,
    /// Database of `live`; live.db in $STATE_DIRECTORY if omitted.
    #[arg(long, value_name = "FILE")]
    pub db: Option<PathBuf>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}
