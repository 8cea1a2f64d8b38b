//! The settings of the Zenoh session, from the parameters.

use super::Config;
use crate::zenoh::session::{Encoding, Rmw, SessionMode, ZenohConfig};

/// The exchange with nodes on rmw_zenoh. The parameter table allows only valid names.
#[must_use]
pub fn rmw(config: &Config) -> Rmw {
    Rmw::named(&config.zenoh.rmw).unwrap_or_default()
}

/// The Zenoh session given by `config`, if any.
#[must_use]
pub fn zenoh_config(config: &Config) -> Option<ZenohConfig> {
    let zenoh = &config.zenoh;
    let rmw = rmw(config);
    // Commands or rmw presence without an endpoint are an error, which the check of the settings reports.
    let requested = !(zenoh.listen.is_empty()
        && zenoh.connect.is_empty()
        && zenoh.config.is_empty()
        && zenoh.commands.is_empty()
        && rmw == Rmw::Off);
    requested.then(|| ZenohConfig {
        file: (!zenoh.config.is_empty()).then(|| zenoh.config.clone().into()),
        listen: zenoh.listen.clone(),
        connect: zenoh.connect.clone(),
        mode: SessionMode::named(&zenoh.mode),
        encoding: match zenoh.encoding.as_str() {
            "json" => Encoding::Json,
            "cdr" => Encoding::Cdr,
            _ => Encoding::Cbor,
        },
        web_rate_hz: zenoh.web_rate_hz,
        history_s: zenoh.history_s,
        allow_non_loopback: zenoh.allow_non_loopback,
        commands: zenoh.commands.clone(),
        rmw,
    })
}
