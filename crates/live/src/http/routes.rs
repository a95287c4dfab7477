//! What is answered.

use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::extract::rejection::QueryRejection;
use axum::extract::{Path, Query, State};
use axum::http::header::{CONNECTION, CONTENT_LENGTH};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, Request, StatusCode};
use axum::middleware::{self, Next};
use axum::routing::{get, post};
use serde_json::json;
use tokio::sync::{Semaphore, watch};
use tokio::time::timeout;

use super::answer::{Answer, Refused, either, json, text};
use super::guard::Guard;
use super::history::{self, AskParameters, HistoryParameters, Memory, RangeParameters};
use super::places::Place;
use super::{MAX_BODY_BYTES, MAX_LISTENERS, MAX_READING, Sources, events};
use crate::mqtt::Status;

const PAGE: &str = include_str!("../page/live.html");
const SCRIPT: &str = concat!(
    include_str!("../page/scene.js"),
    include_str!("../page/lanes.js"),
    include_str!("../page/timeline.js"),
    include_str!("../page/live.js"),
);
const STYLE: &str = include_str!("../page/live.css");
/// The text format of Prometheus.
const PROMETHEUS: &str = "text/plain; version=0.0.4; charset=utf-8";

/// What all requests share.
pub(super) struct App {
    guard: Guard,
    pub sources: Sources,
    pub memory: Memory,
    /// Places for listeners.
    pub listeners: Arc<Semaphore>,
    /// Places for those who read the memory.
    pub reading: Arc<Semaphore>,
    pub patience: Duration,
    pub stopping: watch::Receiver<bool>,
}

type Shared = State<Arc<App>>;
type Asked<T> = Result<Query<T>, QueryRejection>;

impl App {
    pub(super) fn new(
        guard: Guard,
        sources: Sources,
        patience: Duration,
        stopping: watch::Receiver<bool>,
    ) -> Self {
        Self {
            guard,
            memory: Memory::new(sources.database.clone()),
            sources,
            listeners: Arc::new(Semaphore::new(MAX_LISTENERS)),
            reading: Arc::new(Semaphore::new(MAX_READING)),
            patience,
            stopping,
        }
    }

    fn metrics_text(&self) -> String {
        let Sources {
            bus,
            metrics,
            liveness,
            broker,
            ..
        } = &self.sources;
        let broker = broker.as_ref().map(Status::counts);
        let n_problems = liveness.problems().len();
        metrics.to_text(&bus.about(), &bus.counts(), broker.as_ref(), n_problems)
    }

    /// Whether the broker is connected, and why not; null without one. It is no reason to start the program anew.
    fn broker(&self) -> serde_json::Value {
        let status = |broker: &Status| json!({ "connected": broker.counts().connected, "problem": broker.problem() });
        self.sources.broker.as_ref().map(status).into()
    }
}

impl App {
    /// Whether the memory can be written, and why not; null without one. It is no reason to start the program anew.
    fn store(&self) -> serde_json::Value {
        let problem = self.sources.metrics.store_problem.get();
        let status = json!({ "written": problem.is_none(), "problem": problem });
        self.sources.database.as_ref().map(|_| status).into()
    }
}

impl App {
    /// How often the model failed, and why it did last, if it has not described a window since. A new start of the
    /// program would not help.
    fn model(&self) -> serde_json::Value {
        let counters = &self.sources.metrics.monitor;
        json!({ "errors": counters.model_errors.get(), "problem": counters.model_problem.get() })
    }
}

/// The routes, behind the checks that hold for all of them.
pub(super) fn router(app: Arc<App>) -> Router {
    let page = || async { text(StatusCode::OK, "text/html; charset=utf-8", PAGE) };
    let script = || async { text(StatusCode::OK, "text/javascript; charset=utf-8", SCRIPT) };
    let style = || async { text(StatusCode::OK, "text/css; charset=utf-8", STYLE) };
    let refuse =
        |status, why: &'static str| move || async move { Refused::new(status, why).answer() };
    Router::new()
        .route("/", get(page))
        .route("/live.js", get(script))
        .route("/live.css", get(style))
        .route("/api/live", get(live))
        .route("/api/state", get(state))
        .route("/api/history", get(read_history).delete(forget))
        .route("/api/lanes", get(read_lanes))
        .route("/api/ask", get(ask))
        .route("/api/activity/{id}/points", get(points))
        .route("/api/falls/{id}/acknowledge", post(acknowledge))
        .route("/api/bug-bundle", get(bug_bundle))
        .route("/metrics", get(metrics))
        .route("/healthz", get(healthz))
        .fallback(refuse(StatusCode::NOT_FOUND, "there is no such page"))
        .method_not_allowed_fallback(refuse(
            StatusCode::METHOD_NOT_ALLOWED,
            "this page does not answer that method",
        ))
        .layer(middleware::from_fn_with_state(Arc::clone(&app), check))
        .with_state(app)
}

/// Checks who asks, reads the body away (no route needs one), and adds the headers that every answer has.
async fn check(State(app): Shared, request: Request<Body>, next: Next) -> Answer {
    let (head, body) = request.into_parts();
    let refusal = match app.guard.admit(&head) {
        Ok(_) if !has_place(&head) => {
            let why = "too many connections are open; try again";
            Refused::new(StatusCode::SERVICE_UNAVAILABLE, why)
        }
        Ok(admitted) => match drain(&head.headers, body, app.patience).await {
            Ok(()) => {
                let request = Request::from_parts(head, Body::empty());
                let mut answer = next.run(request).await;
                app.guard.seal(Some(&admitted), &mut answer);
                app.sources.metrics.responded(answer.status().as_u16());
                return answer;
            }
            Err(refused) => refused,
        },
        Err(refused) => refused,
    };
    let mut answer = refusal.answer();
    app.guard.seal(None, &mut answer);
    // Who is refused does not keep the connection.
    let close = HeaderValue::from_static("close");
    answer.headers_mut().insert(CONNECTION, close);
    app.sources.metrics.responded(answer.status().as_u16());
    answer
}

/// Takes a place for a connection of which a request is admitted. Requests that came in another way need none.
fn has_place(head: &Parts) -> bool {
    let place = head.extensions.get::<Arc<Place>>();
    place.is_none_or(|place| place.admit())
}

/// Reads a body to its end.
async fn drain(headers: &HeaderMap, body: Body, patience: Duration) -> Result<(), Refused> {
    let too_large = || {
        let why = format!("the body is longer than {MAX_BODY_BYTES} bytes");
        Refused::new(StatusCode::PAYLOAD_TOO_LARGE, why)
    };
    let length = headers.get(CONTENT_LENGTH).and_then(|l| l.to_str().ok());
    let length = length.and_then(|l| l.parse::<u64>().ok());
    if length.is_some_and(|l| l > MAX_BODY_BYTES as u64) {
        return Err(too_large());
    }
    match timeout(patience, to_bytes(body, MAX_BODY_BYTES)).await {
        Ok(Ok(_)) => Ok(()),
        Ok(Err(_)) => Err(too_large()),
        Err(_) => Err(Refused::new(
            StatusCode::REQUEST_TIMEOUT,
            "the body did not arrive in time",
        )),
    }
}

async fn live(State(app): Shared) -> Answer {
    either(events::live(&app))
}

async fn state(State(app): Shared) -> Answer {
    let hello = app.sources.bus.hello();
    text(StatusCode::OK, "application/json", hello.json.clone())
}

async fn read_history(State(app): Shared, asked: Asked<HistoryParameters>) -> Answer {
    match parameters(asked) {
        Ok(asked) => either(history::history(&app, asked).await),
        Err(refused) => refused.answer(),
    }
}

async fn read_lanes(State(app): Shared, asked: Asked<RangeParameters>) -> Answer {
    match parameters(asked) {
        Ok(asked) => either(history::lanes(&app, asked).await),
        Err(refused) => refused.answer(),
    }
}

async fn forget(State(app): Shared, asked: Asked<RangeParameters>) -> Answer {
    match parameters(asked) {
        Ok(asked) => either(history::forget(&app, asked).await),
        Err(refused) => refused.answer(),
    }
}

async fn ask(State(app): Shared, asked: Asked<AskParameters>) -> Answer {
    match parameters(asked) {
        Ok(asked) => either(history::ask(&app, asked).await),
        Err(refused) => refused.answer(),
    }
}

async fn points(State(app): Shared, Path(id): Path<String>) -> Answer {
    either(history::points(&app, &id).await)
}

/// Hands the fall to the pipeline, which ends it with its next frame.
async fn acknowledge(State(app): Shared, Path(id): Path<String>) -> Answer {
    let known = id.parse().ok().filter(|id| app.sources.bus.has_fall(*id));
    let (Some(fall), Some(acknowledge)) = (known, &app.sources.acknowledge) else {
        let why = "there is no such fall, or it is over";
        return Refused::new(StatusCode::NOT_FOUND, why).answer();
    };
    match acknowledge(fall) {
        true => json(StatusCode::ACCEPTED, &json!({ "acknowledged": fall })),
        false => {
            let why = "too many falls are being acknowledged; try again";
            Refused::new(StatusCode::SERVICE_UNAVAILABLE, why).answer()
        }
    }
}

async fn metrics(State(app): Shared) -> Answer {
    text(StatusCode::OK, PROMETHEUS, app.metrics_text())
}

async fn healthz(State(app): Shared) -> Answer {
    let problems = app.sources.liveness.problems();
    let status = match problems.is_empty() {
        true => StatusCode::OK,
        false => StatusCode::SERVICE_UNAVAILABLE,
    };
    json(
        status,
        &json!({
            "ok": problems.is_empty(),
            "problems": problems,
            "broker": app.broker(),
            "memory": app.store(),
            "model": app.model(),
        }),
    )
}

/// What a report of a fault should have: neither sentences nor places, nor the token.
async fn bug_bundle(State(app): Shared) -> Answer {
    let about = app.sources.bus.about();
    let bundle = json!({
        "version": about.origin.version,
        "radar": about.origin.radar,
        "model": about.origin.model,
        "decoder": about.origin.decoder,
        "synthetic": about.origin.synthetic,
        "frame_period_s": about.frame_period_s,
        "n_zones": about.zones.len(),
        "has_memory": app.sources.database.is_some(),
        "problems": app.sources.liveness.problems(),
        "broker": app.broker(),
        "memory": app.store(),
        "model": app.model(),
        "metrics": app.metrics_text(),
    });
    json(StatusCode::OK, &bundle)
}

fn parameters<T>(asked: Asked<T>) -> Result<T, Refused> {
    match asked {
        Ok(Query(parameters)) => Ok(parameters),
        Err(rejection) => Err(Refused::new(StatusCode::BAD_REQUEST, rejection.body_text())),
    }
}
