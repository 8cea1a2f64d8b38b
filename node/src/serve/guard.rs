//! Whom the server answers, and what browsers are told of its answers.
//!
//! A page of some site on the Web can have its own name point to 127.0.0.1 and then read what is there as if it were its own (DNS
//! rebinding). It cannot choose what its browser says of the name: so only requests that name this server by its number, or
//! as localhost, are answered.

use super::Shared;
use crate::error::NodeError;
use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::{IpAddr, SocketAddr};
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
        "--workshop takes runs and starts work, and --listen {listen} is not on loopback: whoever reaches this machine could, without          password or encryption. There is no flag that allows it; use a tunnel (ssh -L {port}:127.0.0.1:{port} THIS_MACHINE, then \
         http://localhost:{port}/ there)",
        port = listen.port()
    )))
}

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
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// Answers only requests that are meant for this server, and marks all answers.
pub(super) async fn watch(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    let mut response = match refusal(&shared.hosts, &request) {
        Some(refusal) => refusal,
        None => next.run(request).await,
    };
    for (name, value) in HEADERS {
        // A report has a policy of its own.
        response.headers_mut().entry(name).or_insert(HeaderValue::from_static(value));
    }
    response
}

fn refusal(hosts: &Hosts, request: &Request) -> Option<Response> {
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
    (foreign && request.uri().path() != "/")
        .then(|| (StatusCode::FORBIDDEN, "this is for the page of this server alone\n").into_response())
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
