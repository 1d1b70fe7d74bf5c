//! What the page asks for, and the answers.

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::{Path, Query, State};
use axum::http::header::{CONTENT_SECURITY_POLICY, CONTENT_TYPE, ORIGIN, SET_COOKIE};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::app::App;
use super::conduct::{Conduct, Diagnose, Entry, Given, Refused};
use super::headers;

/// JSON, or what is wrong in words.
fn answer(status: StatusCode, value: &Value) -> Response {
    (status, [(CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

/// An answer that says why not.
pub(super) fn refuse(status: StatusCode, why: &str) -> Response {
    answer(status, &json!({ "refused": why }))
}

fn done<T: serde::Serialize>(result: Result<T, Refused>) -> Response {
    match result {
        Ok(value) => answer(StatusCode::OK, &serde_json::to_value(value).unwrap_or_default()),
        Err(why) => refuse(StatusCode::CONFLICT, &why.0),
    }
}

fn read<T: DeserializeOwned>(body: &[u8]) -> Result<T, Box<Response>> {
    serde_json::from_slice(body).map_err(|e| Box::new(refuse(StatusCode::BAD_REQUEST, &format!("the request cannot be read: {e}"))))
}

/// Carries out work that may wait for the disk, away from the thread that serves everybody.
async fn work<T: Send + 'static>(app: Arc<App>, work: impl FnOnce(&dyn Conduct) -> T + Send + 'static) -> Result<T, Box<Response>> {
    let result = tokio::task::spawn_blocking(move || work(app.conduct.as_ref())).await;
    result
        .map_err(|_| Box::new(refuse(StatusCode::INTERNAL_SERVER_ERROR, "a bug in hil; its message stands in the terminal of the station")))
}

async fn act<A: DeserializeOwned + Send + 'static, T: serde::Serialize + Send + 'static>(
    app: Arc<App>,
    body: Bytes,
    carry_out: impl FnOnce(&dyn Conduct, A) -> Result<T, Refused> + Send + 'static,
) -> Response {
    let asked = match read::<A>(&body) {
        Ok(asked) => asked,
        Err(response) => return *response,
    };
    match work(app, move |conduct| carry_out(conduct, asked)).await {
        Ok(result) => done(result),
        Err(response) => *response,
    }
}

#[derive(Deserialize)]
pub(super) struct Entering {
    token: String,
}

/// A token comes in, a cookie goes out.
pub(super) async fn enter(State(app): State<Arc<App>>, headers: HeaderMap, body: Bytes) -> Response {
    let Ok(entering) = serde_json::from_slice::<Entering>(&body) else {
        return refuse(StatusCode::BAD_REQUEST, "the request cannot be read");
    };
    let https = headers.get(ORIGIN).is_some_and(|o| o.as_bytes().starts_with(b"https:"));
    match app.access.enter(&entering.token, https) {
        Some((role, cookie)) => {
            let mut response = answer(StatusCode::OK, &json!({ "role": role, "act": app.access.act(role) }));
            if let Ok(value) = cookie.parse() {
                response.headers_mut().insert(SET_COOKIE, value);
            }
            response
        }
        None => {
            // Whoever guesses waits.
            tokio::time::sleep(std::time::Duration::from_millis(300)).await;
            refuse(StatusCode::UNAUTHORIZED, "this is not the token of this station")
        }
    }
}

/// Takes the cookie away.
pub(super) async fn leave(State(app): State<Arc<App>>) -> Response {
    let mut response = answer(StatusCode::OK, &json!({}));
    if let Ok(value) = app.access.leave().parse() {
        response.headers_mut().insert(SET_COOKIE, value);
    }
    response
}

/// Who the bearer of the cookie is, with the value that acts must carry.
pub(super) async fn me(State(app): State<Arc<App>>, headers: HeaderMap) -> Response {
    match app.access.role(&headers) {
        Some(role) => answer(StatusCode::OK, &json!({ "role": role, "act": app.access.act(role) })),
        None => refuse(StatusCode::UNAUTHORIZED, "enter with the token of this station"),
    }
}

pub(super) async fn check(State(app): State<Arc<App>>, body: Bytes) -> Response {
    act(app, body, |conduct, entry: Entry| conduct.check(&entry)).await
}

pub(super) async fn start(State(app): State<Arc<App>>, body: Bytes) -> Response {
    act(app, body, |conduct, entry: Entry| conduct.start(&entry)).await
}

#[derive(Deserialize)]
struct AtSite {
    site: usize,
}

pub(super) async fn stop(State(app): State<Arc<App>>, body: Bytes) -> Response {
    act(app, body, |conduct, at: AtSite| conduct.stop(at.site)).await
}

pub(super) async fn give(State(app): State<Arc<App>>, body: Bytes) -> Response {
    act(app, body, |conduct, given: Given| conduct.answer(&given)).await
}

/// The picture of the question that stands at a site; its kind was read off its bytes.
pub(super) async fn picture(State(app): State<Arc<App>>, Path(site): Path<usize>) -> Response {
    match work(app, move |conduct| conduct.picture(site)).await {
        Ok(Some((kind, bytes))) => ([(CONTENT_TYPE, HeaderValue::from_static(kind))], bytes.to_vec()).into_response(),
        Ok(None) => refuse(StatusCode::NOT_FOUND, "there is no such picture"),
        Err(response) => *response,
    }
}

pub(super) async fn acknowledge(State(app): State<Arc<App>>, body: Bytes) -> Response {
    act(app, body, |conduct, at: AtSite| conduct.acknowledge(at.site)).await
}

pub(super) async fn close(State(app): State<Arc<App>>) -> Response {
    match work(app, |conduct| conduct.close()).await {
        Ok(result) => done(result),
        Err(response) => *response,
    }
}

#[derive(Deserialize)]
pub(super) struct OfSerial {
    serial: Option<String>,
}

pub(super) async fn records(State(app): State<Arc<App>>, Query(of): Query<OfSerial>) -> Response {
    let serial = of.serial.filter(|s| !s.trim().is_empty());
    match work(app, move |conduct| conduct.records(serial.as_deref())).await {
        Ok(result) => done(result),
        Err(response) => *response,
    }
}

pub(super) async fn figures(State(app): State<Arc<App>>) -> Response {
    match work(app, |conduct| conduct.figures()).await {
        Ok(result) => done(result),
        Err(response) => *response,
    }
}

pub(super) async fn record(State(app): State<Arc<App>>, Path(id): Path<String>) -> Response {
    report(app, move |conduct| conduct.record_page(&id)).await
}

pub(super) async fn batch(State(app): State<Arc<App>>) -> Response {
    report(app, |conduct| conduct.batch_page()).await
}

#[derive(Deserialize)]
pub(super) struct Dropped {
    name: String,
    model: String,
}

pub(super) async fn diagnose_file(State(app): State<Arc<App>>, Query(of): Query<Dropped>, body: Bytes) -> Response {
    let begin = move |conduct: &dyn Conduct| conduct.diagnose(&Diagnose::Bytes { name: &of.name, bytes: &body, model: &of.model });
    match work(app, begin).await {
        Ok(result) => done(result),
        Err(response) => *response,
    }
}

#[derive(Deserialize)]
struct OfRecord {
    record: String,
    model: String,
}

pub(super) async fn diagnose_record(State(app): State<Arc<App>>, body: Bytes) -> Response {
    act(app, body, |conduct, of: OfRecord| conduct.diagnose(&Diagnose::Record { id: &of.record, model: &of.model })).await
}

pub(super) async fn diagnosis(State(app): State<Arc<App>>, Path(number): Path<u64>) -> Response {
    report(app, move |conduct| conduct.diagnosis_page(number)).await
}

/// A report, as a page that can ask this station for nothing.
async fn report(app: Arc<App>, page: impl FnOnce(&dyn Conduct) -> Result<String, Refused> + Send + 'static) -> Response {
    match work(app, page).await {
        Ok(Ok(page)) => {
            let policy = headers::of_report(&page);
            let html = HeaderValue::from_static("text/html; charset=utf-8");
            ([(CONTENT_TYPE, html), (CONTENT_SECURITY_POLICY, policy)], page).into_response()
        }
        Ok(Err(why)) => refuse(StatusCode::NOT_FOUND, &why.0),
        Err(response) => *response,
    }
}
