//! The stream of events to one watcher.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::State;
use axum::http::StatusCode;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use tokio::sync::broadcast::Receiver;
use tokio::sync::broadcast::error::RecvError;
use tokio::time::timeout;

use super::app::App;
use super::hub::{Event, event};
use super::request::refuse;

/// Something is sent at least so often, so that the page sees within a second that nobody is there any more.
const BEAT: Duration = Duration::from_millis(400);
/// Watchers at once.
const MOST: usize = 64;

/// Where a watcher stands.
struct Watcher {
    app: Arc<App>,
    /// What is to be sent before anything new, the next last.
    first: Vec<Event>,
    receiver: Receiver<Event>,
}

/// The stream: what is the case, then everything that happens.
pub(super) async fn events(State(app): State<Arc<App>>) -> Response {
    if app.hub.watchers() >= MOST {
        return refuse(StatusCode::SERVICE_UNAVAILABLE, "too many pages watch this station");
    }
    let (mut first, receiver) = app.hub.join();
    first.reverse();
    let watcher = Watcher { app, first, receiver };
    let body = Body::from_stream(stream::unfold(watcher, |mut watcher| async move {
        let event = watcher.next().await?;
        Some((Ok::<_, std::convert::Infallible>(event), watcher))
    }));
    // A proxy must not hold events back.
    ([(CONTENT_TYPE.as_str(), "text/event-stream"), (CACHE_CONTROL.as_str(), "no-store"), ("x-accel-buffering", "no")], body)
        .into_response()
}

impl Watcher {
    async fn next(&mut self) -> Option<Event> {
        if let Some(event) = self.first.pop() {
            return Some(event);
        }
        match timeout(BEAT, self.receiver.recv()).await {
            Err(_) => Some(event("beat", "{}")),
            Ok(Ok(event)) => Some(event),
            // It fell behind and has lost pictures: it is shown the present anew.
            Ok(Err(RecvError::Lagged(_))) => {
                (self.first, self.receiver) = self.app.hub.join();
                self.first.reverse();
                self.first.pop()
            }
            Ok(Err(RecvError::Closed)) => None,
        }
    }
}
