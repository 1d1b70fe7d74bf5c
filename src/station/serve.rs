//! The server: one thread, which the loops know nothing of.

use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;

use axum::Router;
use axum::extract::{DefaultBodyLimit, Request, State};
use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use tokio::sync::oneshot;

use super::access::Access;
use super::app::App;
use super::conduct::Conduct;
use super::hub::Hub;
use super::page::FILES;
use super::{StationError, events, headers, request};

/// Largest request that is read [bytes]; an entry has some hundred.
const LARGEST: usize = 16 << 10;

/// Largest recording that is taken [bytes].
const LARGEST_RECORDING: usize = 64 << 20;

/// A running server; it ends when it is dropped.
pub struct Server {
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Listens on an address; port 0 takes a free one.
///
/// # Errors
/// [`StationError::Listen`].
pub fn listen(address: &str) -> Result<(TcpListener, SocketAddr), StationError> {
    let failed = |source| StationError::Listen { address: address.into(), source };
    let listener = TcpListener::bind(address).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let bound = listener.local_addr().map_err(failed)?;
    Ok((listener, bound))
}

/// Serves the page of a station on a thread of its own.
///
/// # Errors
/// [`StationError::Listen`] where the thread cannot begin.
pub fn serve(listener: TcpListener, hub: Arc<Hub>, conduct: Arc<dyn Conduct>, access: Access) -> Result<Server, StationError> {
    let failed = |source| StationError::Listen { address: "(its thread)".into(), source };
    let app = Arc::new(App { hub, conduct, access });
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().max_blocking_threads(16).build().map_err(failed)?;
    let (stop, stopped) = oneshot::channel::<()>();
    let thread = std::thread::Builder::new().name("station".into()).spawn(move || {
        runtime.block_on(async move {
            use axum::serve::ListenerExt;
            let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
            // A frame is small and wants to be seen now.
            let listener = listener.tap_io(|stream| {
                let _ = stream.set_nodelay(true);
            });
            tokio::select! {
                _ = axum::serve(listener, router(app)) => {}
                _ = stopped => {}
            }
        });
        // Streams of events never end by themselves.
        runtime.shutdown_timeout(std::time::Duration::from_millis(500));
    });
    Ok(Server { stop: Some(stop), thread: Some(thread.map_err(failed)?) })
}

fn router(app: Arc<App>) -> Router {
    let mut open = Router::new().route("/enter", post(request::enter));
    for file in FILES {
        open = open.route(file.path, get(move || async move { ([(CONTENT_TYPE, file.kind)], file.text) }));
    }
    let guarded = Router::new()
        .route("/api/me", get(request::me))
        .route("/api/events", get(events::events))
        .route("/api/records", get(request::records))
        .route("/api/figures", get(request::figures))
        .route("/api/check", post(request::check))
        .route("/api/start", post(request::start))
        .route("/api/stop", post(request::stop))
        .route("/api/answer", post(request::give))
        .route("/picture/{site}", get(request::picture))
        .route("/api/acknowledge", post(request::acknowledge))
        .route("/api/close", post(request::close))
        .route("/api/diagnose", post(request::diagnose_file).layer(DefaultBodyLimit::max(LARGEST_RECORDING)))
        .route("/api/diagnose-record", post(request::diagnose_record))
        .route("/diagnosis/{number}", get(request::diagnosis))
        .route("/leave", post(request::leave))
        .route("/record/{id}", get(request::record))
        .route("/batch", get(request::batch))
        .route_layer(middleware::from_fn_with_state(Arc::clone(&app), guard));
    open.merge(guarded)
        .fallback(|| async { request::refuse(StatusCode::NOT_FOUND, "there is no such place") })
        .layer(middleware::from_fn_with_state(Arc::clone(&app), at_the_door))
        .layer(DefaultBodyLimit::max(LARGEST))
        .with_state(app)
}

/// Every request: it must come from the station's own page, and the answer says what it may do.
async fn at_the_door(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let open = FILES.iter().any(|f| f.path == request.uri().path());
    let mut response = match app.access.same_origin(request.headers(), open) {
        Ok(()) => next.run(request).await,
        Err((status, why)) => request::refuse(status, why),
    };
    headers::put(response.headers_mut());
    response
}

/// Every request but those of the open page: the bearer must have the right to it.
async fn guard(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let Some(role) = app.access.role(request.headers()) else {
        return request::refuse(StatusCode::UNAUTHORIZED, "enter with the token of this station");
    };
    match app.access.may_act(role, request.method(), request.headers()) {
        Ok(()) => next.run(request).await.into_response(),
        Err((status, why)) => request::refuse(status, why),
    }
}
