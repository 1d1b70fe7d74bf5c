//! Who may see the station and who may act on it.
//!
//! A page in another tab must not be able to start, stop or read anything. The token makes a cookie that scripts cannot read and that
//! no other site's page can send; the `Host` must be one that the station answers to, so that a name pointed at this address is
//! none; the `Origin` must be the station's own, so that a page from another port of the same host is refused too; and whatever acts
//! carries a second value that only the station's own page was given.

use axum::http::header::{COOKIE, HOST, ORIGIN};
use axum::http::{HeaderMap, Method, StatusCode};
use sha2::{Digest, Sha256};

use super::error::{SHORTEST, StationError};
use crate::digest;

/// The header that carries the second value.
pub(super) const ACT: &str = "x-hil-act";

/// What somebody may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Looks.
    Viewer,
    /// Looks and acts.
    Operator,
}

/// A secret, and what is derived from it.
#[derive(Debug, Clone)]
pub struct Token {
    text: String,
    cookie: String,
    act: String,
}

impl Token {
    /// A token that somebody chose.
    ///
    /// # Errors
    /// [`StationError::Token`] where it is too easy to guess.
    pub fn chosen(text: &str, what: &str) -> Result<Self, StationError> {
        let text = text.trim();
        if text.len() < SHORTEST || !text.chars().all(|c| c.is_ascii_graphic()) {
            return Err(StationError::Token { what: what.into() });
        }
        Ok(Self::from(text.to_string()))
    }

    /// A new token that nobody can guess: 128 bits.
    pub fn random() -> Self {
        let bits: u128 = rand::random();
        Self::from(format!("{bits:032x}"))
    }

    /// The token itself, to be given to a person.
    pub fn text(&self) -> &str {
        &self.text
    }
}

impl From<String> for Token {
    /// Derived values are the same after a restart with the same token, so that a browser stays where it is.
    fn from(text: String) -> Self {
        let derive = |what: &str| digest::sha256(format!("hil station {what} {text}"));
        Self { cookie: derive("cookie"), act: derive("act"), text }
    }
}

/// The rules of one station.
#[derive(Debug, Clone)]
pub struct Access {
    operator: Token,
    viewer: Option<Token>,
    /// Values of `Host` that are answered, with their ports.
    hosts: Vec<String>,
    cookie: String,
}

/// Why a request is refused.
pub(super) type Denied = (StatusCode, &'static str);

impl Access {
    /// The rules of a station that listens on `port`; `hosts` are further names that it is reached by, as a reverse proxy gives them.
    pub fn new(operator: Token, viewer: Option<Token>, address: std::net::SocketAddr, hosts: &[String]) -> Self {
        let port = address.port();
        let mut own: Vec<String> = ["localhost", "127.0.0.1", "[::1]"].iter().map(|h| format!("{h}:{port}")).collect();
        if !address.ip().is_unspecified() {
            own.push(address.to_string());
        }
        own.extend(hosts.iter().map(|h| h.to_ascii_lowercase()));
        Self { operator, viewer, hosts: own, cookie: format!("hil_station_{port}") }
    }

    /// Refuses what does not come from the station's own page or from the address bar.
    pub(super) fn same_origin(&self, headers: &HeaderMap, open: bool) -> Result<(), Denied> {
        let text = |name: &str| headers.get(name).map(|v| v.to_str().unwrap_or("?").to_ascii_lowercase());
        let known = |host: &str| self.hosts.iter().any(|h| h == host);
        if !text(HOST.as_str()).is_some_and(|h| known(&h)) {
            return Err((StatusCode::FORBIDDEN, "this station does not answer to that host name; start it with --host NAME"));
        }
        if let Some(origin) = text(ORIGIN.as_str()) {
            let host = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
            if !host.is_some_and(known) {
                return Err((StatusCode::FORBIDDEN, "a request from the page of another origin"));
            }
        }
        // A link to the page itself may stand anywhere; what it shows may be asked for by nobody else's page.
        let site = text("sec-fetch-site");
        if !open && site.is_some_and(|s| s != "same-origin" && s != "none") {
            return Err((StatusCode::FORBIDDEN, "a request from the page of another origin"));
        }
        Ok(())
    }

    /// What the bearer of a request's cookie may do.
    pub(super) fn role(&self, headers: &HeaderMap) -> Option<Role> {
        let given = headers.get_all(COOKIE).iter().filter_map(|v| v.to_str().ok()).flat_map(|v| v.split(';'));
        let own = |pair: &str| pair.trim().strip_prefix(&self.cookie)?.strip_prefix('=').map(String::from);
        let cookies: Vec<String> = given.filter_map(own).collect();
        let bears = |token: &Token| cookies.iter().any(|c| equal(c, &token.cookie));
        if bears(&self.operator) {
            return Some(Role::Operator);
        }
        self.viewer.as_ref().filter(|t| bears(t)).map(|_| Role::Viewer)
    }

    /// Refuses an act of somebody who may not, or that the station's own page did not send.
    pub(super) fn may_act(&self, role: Role, method: &Method, headers: &HeaderMap) -> Result<(), Denied> {
        if method == Method::GET || method == Method::HEAD {
            return Ok(());
        }
        if role != Role::Operator {
            return Err((StatusCode::FORBIDDEN, "a viewer may not act"));
        }
        let given = headers.get(ACT).and_then(|v| v.to_str().ok()).unwrap_or_default();
        if equal(given, &self.operator.act) { Ok(()) } else { Err((StatusCode::FORBIDDEN, "the act carries no token of this station")) }
    }

    /// The cookie that a token is worth, with its role.
    pub(super) fn enter(&self, token: &str, https: bool) -> Option<(Role, String)> {
        let tokens = [Some((Role::Operator, &self.operator)), self.viewer.as_ref().map(|t| (Role::Viewer, t))];
        let (role, token) = tokens.into_iter().flatten().find(|(_, t)| equal(token.trim(), &t.text))?;
        Some((role, self.set_cookie(&token.cookie, https)))
    }

    /// The cookie that takes the right away again.
    pub(super) fn leave(&self) -> String {
        format!("{}; Max-Age=0", self.set_cookie("", false))
    }

    fn set_cookie(&self, value: &str, https: bool) -> String {
        let secure = if https { "; Secure" } else { "" };
        format!("{}={value}; Path=/; HttpOnly; SameSite=Strict{secure}", self.cookie)
    }

    /// The second value, for the page of somebody who may act.
    pub(super) fn act(&self, role: Role) -> Option<&str> {
        (role == Role::Operator).then_some(self.operator.act.as_str())
    }
}

/// Compares in a time that says nothing of where two texts differ.
fn equal(a: &str, b: &str) -> bool {
    Sha256::digest(a) == Sha256::digest(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn access() -> Access {
        let token = |text: &str| Token::chosen(text, "test").unwrap();
        Access::new(token("operator-token-1"), Some(token("viewer-token-123")), ([127, 0, 0, 1], 8080).into(), &["bench.example".into()])
    }

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        pairs.iter().map(|(name, value)| (axum::http::HeaderName::from_static(name), value.parse().unwrap())).collect()
    }

    #[test]
    fn only_the_stations_own_page_is_answered() {
        let access = access();
        let answered = |pairs: &[(&'static str, &str)], open| access.same_origin(&headers(pairs), open).is_ok();
        assert!(answered(&[("host", "127.0.0.1:8080")], false));
        assert!(answered(&[("host", "localhost:8080"), ("origin", "http://localhost:8080"), ("sec-fetch-site", "same-origin")], false));
        assert!(answered(&[("host", "bench.example"), ("origin", "https://bench.example")], false));
        assert!(!answered(&[], false), "no Host");
        assert!(!answered(&[("host", "evil.example:8080")], true), "a name that was pointed at this address");
        assert!(!answered(&[("host", "127.0.0.1:8080"), ("origin", "http://evil.example")], false));
        assert!(!answered(&[("host", "127.0.0.1:8080"), ("origin", "null")], false), "a sandboxed page");
        assert!(!answered(&[("host", "127.0.0.1:8080"), ("origin", "http://127.0.0.1:9999")], false), "another port");
        assert!(!answered(&[("host", "127.0.0.1:8080"), ("sec-fetch-site", "same-site")], false), "another port, without an Origin");
        assert!(answered(&[("host", "127.0.0.1:8080"), ("sec-fetch-site", "cross-site")], true), "a link to the page");
    }

    #[test]
    fn a_token_gives_a_cookie_and_the_cookie_a_role() {
        let access = access();
        assert!(access.enter("operator-token-2", false).is_none());
        let role_of = |token: &str| {
            let (role, cookie) = access.enter(token, false).unwrap();
            assert!(cookie.ends_with("; Path=/; HttpOnly; SameSite=Strict"), "{cookie}");
            assert!(!cookie.contains(token), "the token itself is in no cookie");
            let cookie = format!("other=1; {}", cookie.split(';').next().unwrap());
            assert_eq!(access.role(&headers(&[("cookie", &cookie)])), Some(role));
            role
        };
        assert_eq!((role_of("operator-token-1"), role_of("viewer-token-123")), (Role::Operator, Role::Viewer));
        assert_eq!(access.role(&headers(&[("cookie", "hil_station_8080=")])), None);
        assert!(access.enter("operator-token-1", true).unwrap().1.ends_with("; Secure"));
    }

    #[test]
    fn an_act_needs_the_right_and_the_second_value() {
        let access = access();
        let act = access.act(Role::Operator).unwrap().to_string();
        let may = |role, method: Method, value: &str| access.may_act(role, &method, &headers(&[(ACT, value)])).is_ok();
        assert!(may(Role::Operator, Method::POST, &act));
        assert!(!may(Role::Operator, Method::POST, ""));
        assert!(!may(Role::Viewer, Method::POST, &act));
        assert!(may(Role::Viewer, Method::GET, ""));
        assert_eq!(access.act(Role::Viewer), None);
    }

    #[test]
    fn a_short_token_is_refused() {
        assert!(Token::chosen("short", "token.txt").unwrap_err().to_string().starts_with("token.txt: "));
        assert!(Token::chosen("has blanks in between", "t").is_err());
        assert_ne!(Token::random().text(), Token::random().text());
    }
}
