//! Whom the server answers, and what browsers are told of its answers.
//!
//! A page of some site on the Web can have its own name point to 127.0.0.1 and then read what is there as if it were its own (DNS
//! rebinding). It cannot choose what its browser says of the name: so only requests that name this server by its number, or
//! as localhost, are answered.

use super::Shared;
use crate::error::NodeError;
use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;
use std::sync::Arc;

/// The names by which the server may be asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hosts {
    address: SocketAddr,
    any: bool,
}

impl Hosts {
    /// The names of a server that listens on `address`; with `any` also each number that leads to it.
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
        // Any port: behind a tunnel it is another one, and whoever strays here by name cannot choose the name.
        let name = authority.host();
        let number = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
        match number.parse::<IpAddr>() {
            // Rebinding takes a name: a number is what it is.
            Ok(number) => self.any || number.is_loopback() || number == self.address.ip(),
            Err(_) => name.eq_ignore_ascii_case("localhost"),
        }
    }
}

/// Another page's origin, to which the figures may be read: `http://HOST:PORT` or `https://HOST`, without a path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Guest(HeaderValue);

impl FromStr for Guest {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        const WANTED: &str = "give an origin as a browser says it, such as http://localhost:8000 or https://example.org: small letters, no \
                              path, no slash at the end";
        let host = text.strip_prefix("http://").or_else(|| text.strip_prefix("https://"));
        let host = host.filter(|host| {
            !host.is_empty() && !host.contains(['@', '*']) && text.to_ascii_lowercase() == text
        });
        let host = host.and_then(|host| host.parse::<Authority>().ok());
        let value = host.and_then(|_| HeaderValue::from_str(text).ok());
        value.map(Self).ok_or(WANTED)
    }
}

/// Paths that guests may read.
const FOR_GUESTS: [&str; 2] = ["/events", "/snapshot"];

/// The origin of a request that one of `guests` makes.
pub(super) fn guest<'a>(guests: &'a [Guest], headers: &HeaderMap) -> Option<&'a HeaderValue> {
    let origin = headers.get(header::ORIGIN)?;
    guests.iter().map(|Guest(allowed)| allowed).find(|allowed| *allowed == origin)
}

/// Refuses an address beyond loopback that was not asked for twice.
///
/// # Errors
/// [`NodeError::Usage`], which says what else there is.
pub fn require_loopback(listen: SocketAddr, any_host: bool) -> Result<(), NodeError> {
    if listen.ip().is_loopback() || any_host {
        return Ok(());
    }
    Err(NodeError::Usage(format!(
        "--listen {listen} is not on loopback: whoever reaches this machine could watch, without password or encryption. Use a \
         tunnel (ssh -L {port}:127.0.0.1:{port} THIS_MACHINE, then http://localhost:{port}/ there), or allow it with --any-host",
        port = listen.port()
    )))
}

/// Refuses a workshop beyond loopback, whatever is allowed besides.
///
/// # Errors
/// [`NodeError::Usage`], which says what else there is.
pub fn require_loopback_for_workshop(listen: SocketAddr) -> Result<(), NodeError> {
    if listen.ip().is_loopback() {
        return Ok(());
    }
    Err(NodeError::Usage(format!(
        "--workshop takes runs and starts work, and --listen {listen} is not on loopback: whoever reaches this machine could, without \
         password or encryption. There is no flag that allows it; use a tunnel (ssh -L {port}:127.0.0.1:{port} THIS_MACHINE, then \
         http://localhost:{port}/ there)",
        port = listen.port()
    )))
}

/// The header that says who may use an answer.
const RESOURCE_POLICY: HeaderName = HeaderName::from_static("cross-origin-resource-policy");

/// What every answer says to browsers: nothing but this server's own files, no guessing, no keeping, no framing, no telling.
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

/// Answers only requests that are meant for this server, and marks all answers.
pub(super) async fn watch(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    let reads = request.method().is_safe() && FOR_GUESTS.contains(&request.uri().path());
    let guest = guest(&shared.guests, request.headers()).filter(|_| reads).cloned();
    let mut response = match refusal(&shared.hosts, &request, guest.is_some()) {
        Some(refusal) => refusal,
        None => next.run(request).await,
    };
    if let Some(guest) = guest {
        let headers = response.headers_mut();
        headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, guest);
        headers.insert(header::VARY, HeaderValue::from_static("origin"));
        headers.insert(RESOURCE_POLICY, HeaderValue::from_static("cross-origin"));
    }
    for (name, value) in HEADERS {
        // A report has a policy of its own.
        response.headers_mut().entry(name).or_insert(HeaderValue::from_static(value));
    }
    response
}

fn refusal(hosts: &Hosts, request: &Request, is_guest: bool) -> Option<Response> {
    let text = |name: &str| request.headers().get(name).and_then(|value| value.to_str().ok());
    let host = text("host").unwrap_or_default();
    if !hosts.allows(host) {
        let says = format!(
            "this server is not \"{host}\"; open it by number or as localhost: http://{}/\n",
            hosts.address
        );
        return Some((StatusCode::MISDIRECTED_REQUEST, says).into_response());
    }
    // Another site cannot read what comes, but could fill the places of those who can.
    let foreign = text("sec-fetch-site").is_some_and(|site| site != "same-origin" && site != "none");
    (foreign && !is_guest && request.uri().path() != "/").then(|| {
        let says = "this is for the page of this server alone; --allow-origin lets another one read /events and /snapshot\n";
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
    fn only_its_own_names_are_answered() {
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
    fn a_guest_is_an_exact_origin() {
        let guests: Vec<Guest> =
            ["http://localhost:8000", "https://example.org"].map(|text| text.parse().expect(text)).into();
        let says = |origin: &'static str| {
            let headers = HeaderMap::from_iter([(header::ORIGIN, HeaderValue::from_static(origin))]);
            guest(&guests, &headers).is_some()
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
            assert!(bad.parse::<Guest>().is_err(), "{bad}");
        }
    }

    #[test]
    fn an_address_beyond_loopback_has_to_be_wanted() {
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
