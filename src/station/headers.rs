//! What every answer says of itself: what it may load, who may frame it, that nobody keeps it.

use axum::http::HeaderMap;
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, HeaderName, HeaderValue, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS};
use sha2::{Digest, Sha256};

/// The page of the station: its own files, and nothing inline.
pub(super) const OWN: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
    frame-src 'self'; form-action 'none'; frame-ancestors 'none'; base-uri 'none'";

/// Says what holds for every answer; one that says more strictly what it may load keeps that.
pub(super) fn put(headers: &mut HeaderMap) {
    let fixed = |value: &'static str| HeaderValue::from_static(value);
    headers.entry(CONTENT_SECURITY_POLICY).or_insert_with(|| fixed(OWN));
    headers.entry(CACHE_CONTROL).or_insert_with(|| fixed("no-store"));
    headers.insert(X_CONTENT_TYPE_OPTIONS, fixed("nosniff"));
    headers.insert(REFERRER_POLICY, fixed("no-referrer"));
    headers.insert(HeaderName::from_static("cross-origin-opener-policy"), fixed("same-origin"));
    headers.insert(HeaderName::from_static("cross-origin-resource-policy"), fixed("same-origin"));
}

/// For a report: a page of an origin of its own, which can ask this station for nothing. Of its scripts only those run that stand in
/// `page` as this program wrote it.
pub(super) fn of_report(page: &str) -> HeaderValue {
    let hashes: String = scripts(page).map(|s| format!(" 'sha256-{}'", base64(&Sha256::digest(s)))).collect();
    let text = format!(
        "sandbox allow-scripts allow-downloads allow-modals; default-src 'none'; script-src{}; style-src 'unsafe-inline'; \
         img-src data: blob:; frame-ancestors 'self'; base-uri 'none'",
        if hashes.is_empty() { " 'none'".into() } else { hashes }
    );
    HeaderValue::from_str(&text).unwrap_or_else(|_| HeaderValue::from_static("sandbox; default-src 'none'"))
}

/// The texts of the `<script>` elements without attributes.
fn scripts(page: &str) -> impl Iterator<Item = &str> {
    page.split("<script>").skip(1).filter_map(|rest| rest.split("</script>").next())
}

/// RFC 4648 base64.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::new();
    for chunk in bytes.chunks(3) {
        let word = chunk.iter().fold(0u32, |w, b| (w << 8) | u32::from(*b)) << (8 * (3 - chunk.len()));
        for k in 0..4 {
            let letter = LETTERS[(word >> (18 - 6 * k)) as usize & 63];
            out.push(if k <= chunk.len() { char::from(letter) } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_as_in_rfc_4648() {
        for (plain, coded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }

    #[test]
    fn a_report_runs_its_own_script_and_no_other() {
        let page = crate::report::page("t", &maud::html! { p { "<script>alert(1)</script>" } });
        let policy = of_report(&page).to_str().unwrap().to_string();
        assert_eq!(policy.matches("sha256-").count(), 1, "a text that looks like a script is none: {policy}");
        assert!(policy.starts_with("sandbox ") && !policy.contains("allow-same-origin") && !policy.contains("script-src 'unsafe"));
    }
}
