//! Answers: JSON, texts and refusals.

use axum::body::Body;
use axum::http::header::{CONTENT_TYPE, HeaderValue};
use axum::http::{Response, StatusCode};
use radarllm_memory::StoreError;
use serde::Serialize;
use serde_json::json;

/// An answer of the server.
pub(super) type Answer = Response<Body>;

/// A refusal or a failure.
#[derive(Debug)]
pub(super) struct Refused {
    pub status: StatusCode,
    pub why: String,
}

impl Refused {
    pub(super) fn new(status: StatusCode, why: impl Into<String>) -> Self {
        Self {
            status,
            why: why.into(),
        }
    }

    pub(super) fn answer(&self) -> Answer {
        json(self.status, &json!({ "error": self.why }))
    }
}

/// What the client asked wrongly is its fault; everything else is ours, and its cause stays here.
impl From<StoreError> for Refused {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::Invalid { .. } => Self::new(StatusCode::BAD_REQUEST, error.to_string()),
            StoreError::Missing { .. } => Self::new(StatusCode::NOT_FOUND, error.to_string()),
            StoreError::Locked { .. } => Self::new(
                StatusCode::SERVICE_UNAVAILABLE,
                "the memory is in use; try again",
            ),
            StoreError::LogInUse { .. } => Self::new(
                StatusCode::SERVICE_UNAVAILABLE,
                "the rows are deleted, but another process is reading, so that their bytes remain; try again",
            ),
            StoreError::Full { .. } => {
                Self::new(StatusCode::INSUFFICIENT_STORAGE, "the disk is full")
            }
            StoreError::Io { .. }
            | StoreError::Replaced { .. }
            | StoreError::Newer { .. }
            | StoreError::Unusable { .. }
            | StoreError::Damaged { .. }
            | StoreError::Sqlite { .. } => Self::new(
                StatusCode::SERVICE_UNAVAILABLE,
                "the memory cannot be used at present",
            ),
        }
    }
}

/// An answer from a result.
pub(super) fn either(result: Result<Answer, Refused>) -> Answer {
    result.unwrap_or_else(|refused| refused.answer())
}

/// A value as JSON.
pub(super) fn json(status: StatusCode, value: &impl Serialize) -> Answer {
    match serde_json::to_string(value) {
        Ok(json) => text(status, "application/json", json),
        Err(_) => text(
            StatusCode::INTERNAL_SERVER_ERROR,
            "application/json",
            "{\"error\":\"the answer has no JSON form\"}",
        ),
    }
}

/// A text.
pub(super) fn text(
    status: StatusCode,
    content_type: &'static str,
    body: impl Into<Body>,
) -> Answer {
    let mut answer = Response::new(body.into());
    *answer.status_mut() = status;
    let content_type = HeaderValue::from_static(content_type);
    answer.headers_mut().insert(CONTENT_TYPE, content_type);
    answer
}
