//! The timeline: history, questions, points, and forgetting.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use axum::http::StatusCode;
use base64::prelude::{BASE64_STANDARD, Engine};
use radarllm_memory::StoreError;
use radarllm_memory::store::{ActivityQuery, Cursor, EventQuery, PointsOf, Timeline};
use radarllm_monitor::points::frame_bytes;
use radarllm_monitor::rows::{ActivityRow, EventRow};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::answer::{Answer, Refused, json};
use super::routes::App;

/// Rows of a page, if the client does not say.
const DEFAULT_ROWS: usize = 100;

/// The database, opened when it is first asked.
pub(super) struct Memory {
    path: Option<PathBuf>,
    timeline: Mutex<Option<Timeline>>,
}

/// Parameters of `GET /api/history`. Others are refused, because a misspelt one would widen the answer.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct HistoryParameters {
    from: Option<i64>,
    to: Option<i64>,
    person: Option<u32>,
    /// Actions, separated by commas.
    action: Option<String>,
    q: Option<String>,
    limit: Option<usize>,
    before: Option<String>,
}

/// Parameters of `DELETE /api/history` and of `GET /api/lanes`, milliseconds since 1970 in UTC.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RangeParameters {
    from: i64,
    to: i64,
}

/// Parameters of `GET /api/ask`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AskParameters {
    q: String,
}

/// Answer to `GET /api/history`.
#[derive(Serialize)]
struct History {
    rows: Vec<ActivityRow>,
    /// Events of the time that the rows cover; none if the rows are a selection by person, action or text.
    events: Vec<EventRow>,
    next: Option<String>,
    synthetic: bool,
}

impl Memory {
    pub(super) fn new(path: Option<PathBuf>) -> Self {
        Self {
            path,
            timeline: Mutex::new(None),
        }
    }

    /// Reads the database. After an error it is opened anew by the next one who asks.
    fn read<T>(&self, work: impl FnOnce(&Timeline) -> Result<T, StoreError>) -> Result<T, Refused> {
        let path = self.path.as_deref().ok_or_else(no_memory)?;
        let mut open = self.timeline.lock().unwrap_or_else(PoisonError::into_inner);
        // A database that was deleted or replaced is opened anew.
        let timeline = match open.take().filter(Timeline::is_in_place) {
            Some(timeline) => timeline,
            None => Timeline::open(path)?,
        };
        let result = work(&timeline);
        if matches!(result, Ok(_) | Err(StoreError::Invalid { .. })) {
            *open = Some(timeline);
        }
        Ok(result?)
    }
}

/// Activities and events, newest first.
pub(super) async fn history(
    app: &Arc<App>,
    parameters: HistoryParameters,
) -> Result<Answer, Refused> {
    let before = parameters.before.as_deref().map(str::parse::<Cursor>);
    let before = before.transpose()?;
    let limit = parameters.limit.unwrap_or(DEFAULT_ROWS);
    if limit == 0 {
        let why = "`limit`: expected 1 or more; a page has up to 500 rows";
        return Err(Refused::new(StatusCode::BAD_REQUEST, why));
    }
    let actions = parameters.action.unwrap_or_default();
    let query = ActivityQuery {
        from_ms: parameters.from,
        to_ms: parameters.to,
        person: parameters.person,
        actions: actions
            .split(',')
            .filter(|a| !a.is_empty())
            .map(String::from)
            .collect(),
        text: parameters.q.filter(|q| !q.trim().is_empty()),
    };
    blocking(app, move |app| {
        app.memory.read(|timeline| {
            let page = timeline.activities(&query, before, limit)?;
            let is_selection =
                query.person.is_some() || !query.actions.is_empty() || query.text.is_some();
            let events = match is_selection {
                true => Vec::new(),
                false => {
                    let query = EventQuery {
                        from_ms: page.next.map(|next| next.at_ms).or(query.from_ms),
                        to_ms: before.map(|b| b.at_ms).or(query.to_ms),
                        ..EventQuery::default()
                    };
                    timeline.events(&query, None, usize::MAX)?.rows
                }
            };
            let synthetic = page.rows.iter().any(|row| row.origin.synthetic)
                || events.iter().any(|event| event.origin.synthetic);
            Ok(History {
                rows: page.rows,
                events,
                next: page.next.map(|next| next.to_string()),
                synthetic,
            })
        })
    })
    .await
    .map(|history| json(StatusCode::OK, &history))
}

/// A range of time as lanes.
pub(super) async fn lanes(
    app: &Arc<App>,
    RangeParameters { from, to }: RangeParameters,
) -> Result<Answer, Refused> {
    blocking(app, move |app| app.memory.read(|t| t.lanes(from, to)))
        .await
        .map(|lanes| json(StatusCode::OK, &lanes))
}

/// The answer to a question in English.
pub(super) async fn ask(app: &Arc<App>, parameters: AskParameters) -> Result<Answer, Refused> {
    blocking(app, move |app| {
        let clock = (app.sources.clock)();
        app.memory
            .read(|timeline| radarllm_memory::ask(timeline, &parameters.q, clock))
    })
    .await
    .map(|answer| json(StatusCode::OK, &answer))
}

/// The points of an activity.
pub(super) async fn points(app: &Arc<App>, id: &str) -> Result<Answer, Refused> {
    let none = || {
        Refused::new(
            StatusCode::NOT_FOUND,
            "no points are kept for that activity",
        )
    };
    let id: i64 = id.parse().map_err(|_| none())?;
    let frames = blocking(app, move |app| {
        app.memory.read(|t| t.points(PointsOf::Activity(id)))
    })
    .await?
    .ok_or_else(none)?;
    let frames: Vec<_> = frames
        .iter()
        .map(|frame| {
            let (bytes, _) = frame_bytes(&frame.points, usize::MAX);
            json!({ "offset_ms": frame.offset_ms, "points": BASE64_STANDARD.encode(bytes) })
        })
        .collect();
    Ok(json(StatusCode::OK, &json!({ "frames": frames })))
}

/// Forgets a range of time, in the memory and in what new listeners get.
pub(super) async fn forget(app: &Arc<App>, parameters: RangeParameters) -> Result<Answer, Refused> {
    let RangeParameters { from, to } = parameters;
    if from >= to {
        let why = "`to`: expected a time after `from`";
        return Err(Refused::new(StatusCode::BAD_REQUEST, why));
    }
    let deleted = blocking(app, move |app| {
        let forget = app.sources.forget.as_ref().ok_or_else(no_memory)?;
        let deleted = forget(from, to);
        // Also if bytes remain in the log: the rows are gone.
        if matches!(deleted, Ok(_) | Err(StoreError::LogInUse { .. })) {
            app.sources.bus.forget(from, to);
        }
        Ok(deleted?)
    })
    .await?;
    Ok(json(StatusCode::OK, &json!({ "deleted": deleted })))
}

fn no_memory() -> Refused {
    let why = "no memory is kept: the program was started without a database";
    Refused::new(StatusCode::NOT_FOUND, why)
}

/// Works on a thread that may wait for the disk.
async fn blocking<T: Send + 'static>(
    app: &Arc<App>,
    work: impl FnOnce(&App) -> Result<T, Refused> + Send + 'static,
) -> Result<T, Refused> {
    let failed = || Refused::new(StatusCode::INTERNAL_SERVER_ERROR, "the work failed");
    let place = Arc::clone(&app.reading).acquire_owned().await;
    let (app, place) = (Arc::clone(app), place.map_err(|_| failed())?);
    let work = move || {
        let result = work(&app);
        drop(place);
        result
    };
    match tokio::task::spawn_blocking(work).await {
        Ok(result) => result,
        Err(_) => Err(failed()),
    }
}
