//! Checks the host and origin of requests, and sets the security headers of responses.
//!
//! A foreign web site can let its own host name point to 127.0.0.1 and then read this server as if it were its own (DNS
//! rebinding). It cannot change the `Host` header that the browser sends. Therefore only requests that address this server by
//! IP address or as localhost are answered.

use super::Shared;
use crate::error::ServeError;
use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;
use std::sync::Arc;

/// The `Host` names under which the server answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hosts {
    address: SocketAddr,
    any: bool,
}

impl Hosts {
    /// The names of a server that listens on `address`. With `any` every IP address is allowed.
    #[must_use]
    pub const fn new(address: SocketAddr, any: bool) -> Self {
        Self { address, any }
    }

    /// True when a request whose header `Host` is `host` is meant for this server.
    #[must_use]
    pub fn allows(&self, host: &str) -> bool {
        let Ok(authority) = host.parse::<Authority>() else { return false };
        if host.contains('@') {
            return false;
        }
        // Any port is allowed: it differs behind a tunnel, and the check of the name is sufficient.
        let name = authority.host();
        let number = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
        match number.parse::<IpAddr>() {
            // DNS rebinding needs a name; an IP address cannot be rebound.
            Ok(number) => self.any || number.is_loopback() || number == self.address.ip(),
            Err(_) => name.eq_ignore_ascii_case("localhost"),
        }
    }
}

/// Origin of another page that may read the values: `http://HOST:PORT` or `https://HOST`, without a path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AllowedOrigin(HeaderValue);

impl AllowedOrigin {
    /// True if this is the origin.
    pub(crate) fn is(&self, origin: &str) -> bool {
        self.0 == origin
    }
}

impl FromStr for AllowedOrigin {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        const EXPECTED: &str = "give an origin as a browser sends it, such as http://localhost:8000 or https://example.org: lower case, no \
                              path, no slash at the end";
        let host = text.strip_prefix("http://").or_else(|| text.strip_prefix("https://"));
        let host = host.filter(|host| {
            !host.is_empty() && !host.contains(['@', '*']) && text.to_ascii_lowercase() == text
        });
        let host = host.and_then(|host| host.parse::<Authority>().ok());
        let value = host.and_then(|_| HeaderValue::from_str(text).ok());
        value.map(Self).ok_or(EXPECTED)
    }
}

/// Paths that pages of allowed origins may read.
const CROSS_ORIGIN_PATHS: [&str; 2] = ["/events", "/snapshot"];

/// The origin of the request, if it is one of `allowed_origins`.
pub(super) fn allowed_origin<'a>(
    allowed_origins: &'a [AllowedOrigin],
    headers: &HeaderMap,
) -> Option<&'a HeaderValue> {
    let origin = headers.get(header::ORIGIN)?;
    allowed_origins.iter().map(|AllowedOrigin(allowed)| allowed).find(|allowed| *allowed == origin)
}

/// Refuses an address beyond loopback without `--any-host`.
///
/// # Errors
/// [`ServeError::PageBeyondLoopback`], which names the alternatives.
pub fn require_loopback(listen: SocketAddr, any_host: bool) -> Result<(), ServeError> {
    if listen.ip().is_loopback() || any_host {
        return Ok(());
    }
    Err(ServeError::PageBeyondLoopback { listen })
}

/// Refuses a workshop beyond loopback, even with `--any-host`.
///
/// # Errors
/// [`ServeError::WorkshopBeyondLoopback`], which names the alternative.
pub fn require_loopback_for_workshop(listen: SocketAddr) -> Result<(), ServeError> {
    if listen.ip().is_loopback() {
        return Ok(());
    }
    Err(ServeError::WorkshopBeyondLoopback { listen })
}

/// The header that restricts which origins may use a response.
const RESOURCE_POLICY: HeaderName = HeaderName::from_static("cross-origin-resource-policy");

/// Security headers of every response: only this server's own files, no MIME sniffing, no caching, no framing, no referrer.
const HEADERS: [(HeaderName, &str); 5] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; base-uri 'none'; \
         form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::CACHE_CONTROL, "no-store"),
    (header::REFERRER_POLICY, "no-referrer"),
    (RESOURCE_POLICY, "same-origin"),
];

/// Answers only requests that are meant for this server, and adds the security headers to all responses.
pub(super) async fn check(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    let reads = request.method().is_safe() && CROSS_ORIGIN_PATHS.contains(&request.uri().path());
    let allowed = allowed_origin(&shared.allowed_origins, request.headers()).filter(|_| reads).cloned();
    let mut response = match refusal(&shared.hosts, &request, allowed.is_some()) {
        Some(refusal) => refusal,
        None => next.run(request).await,
    };
    if let Some(origin) = allowed {
        let headers = response.headers_mut();
        headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, origin);
        headers.insert(header::VARY, HeaderValue::from_static("origin"));
        headers.insert(RESOURCE_POLICY, HeaderValue::from_static("cross-origin"));
    }
    for (name, value) in HEADERS {
        // A report sets its own content security policy.
        response.headers_mut().entry(name).or_insert(HeaderValue::from_static(value));
    }
    response
}

fn refusal(hosts: &Hosts, request: &Request, is_allowed: bool) -> Option<Response> {
    let text = |name: &str| request.headers().get(name).and_then(|value| value.to_str().ok());
    let host = text("host").unwrap_or_default();
    if !hosts.allows(host) {
        let says = format!(
            "this server is not \"{host}\"; open it by IP address or as localhost: http://{}/\n",
            hosts.address
        );
        return Some((StatusCode::MISDIRECTED_REQUEST, says).into_response());
    }
    // Another site cannot read the response, but could use up the streams of legitimate readers.
    let foreign = text("sec-fetch-site").is_some_and(|site| site != "same-origin" && site != "none");
    (foreign && !is_allowed && request.uri().path() != "/").then(|| {
        let says = "only the page of this server may read this; --allow-origin lets another page read /events and /snapshot\n";
        (StatusCode::FORBIDDEN, says).into_response()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(address: &str) -> SocketAddr {
        address.parse().expect("an address")
    }

    #[test]
    fn only_requests_to_its_own_names_are_answered() {
        let own = Hosts::new(at("127.0.0.1:8330"), false);
        for good in [
            "127.0.0.1:8330",
            "localhost:8330",
            "LOCALHOST:8330",
            "localhost:9000",
            "localhost",
            "[::1]:8330",
            "127.0.0.2",
        ] {
            assert!(own.allows(good), "{good}");
        }
        for bad in [
            "",
            "evil.example:8330",
            "evil.example",
            "localhost.evil.example:8330",
            "localhost@evil.example:8330",
            "evil@127.0.0.1:8330",
            "192.168.0.9:8330",
            "127.0.0.1:8330, evil.example:8330",
            "127.0.0.1:8330/",
            "0x7f.1:8330",
            "[::1:8330",
        ] {
            assert!(!own.allows(bad), "{bad}");
        }
        let open = Hosts::new(at("0.0.0.0:8330"), true);
        assert!(
            open.allows("192.168.0.9:8330") && open.allows("[fe80::1]:8330") && open.allows("localhost:8330")
        );
        assert!(!open.allows("evil.example:8330") && !open.allows(""));
    }

    #[test]
    fn an_allowed_origin_must_match_exactly() {
        let allowed_origins: Vec<AllowedOrigin> =
            ["http://localhost:8000", "https://example.org"].map(|text| text.parse().expect(text)).into();
        let says = |origin: &'static str| {
            let headers = HeaderMap::from_iter([(header::ORIGIN, HeaderValue::from_static(origin))]);
            allowed_origin(&allowed_origins, &headers).is_some()
        };
        assert!(says("http://localhost:8000") && says("https://example.org"));
        for other in ["http://localhost:8001", "http://example.org", "https://www.example.org", "null", ""] {
            assert!(!says(other), "{other}");
        }
        for bad in [
            "",
            "*",
            "null",
            "http://",
            "http://*",
            "localhost:8000",
            "http://a/",
            "http://a/b",
            "http://A",
            "http://u@a",
            "ftp://a",
        ] {
            assert!(bad.parse::<AllowedOrigin>().is_err(), "{bad}");
        }
    }

    #[test]
    fn an_address_beyond_loopback_needs_a_flag() {
        for fine in ["127.0.0.1:8330", "[::1]:1", "127.9.9.9:80"] {
            assert!(require_loopback(at(fine), false).is_ok(), "{fine}");
        }
        for (open, port) in [("0.0.0.0:8330", "8330"), ("192.168.0.9:99", "99"), ("[::]:7", "7")] {
            let refused = require_loopback(at(open), false).expect_err(open).to_string();
            assert!(refused.contains(&format!("--listen {open} is not on loopback")), "{refused}");
            assert!(
                refused.contains("--any-host") && refused.contains(&format!("ssh -L {port}:")),
                "{refused}"
            );
            assert!(require_loopback(at(open), true).is_ok());
        }
    }
}
