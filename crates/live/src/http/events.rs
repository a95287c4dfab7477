//! The live messages as server-sent events.

use std::convert::Infallible;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use axum::http::{HeaderValue, StatusCode};
use axum::response::IntoResponse;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures_core::Stream;
use tokio::sync::OwnedSemaphorePermit;

use super::answer::{Answer, Refused};
use super::routes::App;
use super::{MAX_LISTENERS, stopped};
use crate::bus::Reader;

/// How often a silent stream shows that it is alive.
const KEEP_ALIVE: Duration = Duration::from_secs(15);
/// After what time a browser comes back.
const RETRY: Duration = Duration::from_secs(2);

/// Live messages for one listener.
struct Live {
    reader: Reader,
    /// Wakes the stream when the server stops.
    stop: Pin<Box<dyn Future<Output = ()> + Send>>,
    is_first: bool,
    _permit: OwnedSemaphorePermit,
}

impl Stream for Live {
    type Item = Result<Event, Infallible>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        if self.stop.as_mut().poll(context).is_ready() {
            return Poll::Ready(None);
        }
        let Some(published) = ready!(Pin::new(&mut self.reader).poll_next(context)) else {
            return Poll::Ready(None);
        };
        let mut event = Event::default().data(&published.json);
        if std::mem::take(&mut self.is_first) {
            event = event.retry(RETRY);
        }
        Poll::Ready(Some(Ok(event)))
    }
}

/// Begins a stream, if there is room for one more listener.
pub(super) fn live(app: &App) -> Result<Answer, Refused> {
    let permit = app.listeners.clone().try_acquire_owned().map_err(|_| {
        let why = format!("{MAX_LISTENERS} listeners are connected, which is the most");
        Refused::new(StatusCode::SERVICE_UNAVAILABLE, why)
    })?;
    let live = Live {
        reader: app.sources.bus.subscribe(),
        stop: Box::pin(stopped(app.stopping.clone())),
        is_first: true,
        _permit: permit,
    };
    let mut answer = Sse::new(live)
        .keep_alive(KeepAlive::new().interval(KEEP_ALIVE))
        .into_response();
    // For proxies that collect answers.
    let value = HeaderValue::from_static("no");
    answer.headers_mut().insert("x-accel-buffering", value);
    Ok(answer)
}
