//! `mr-damper serve`: a live page of the dampers, from the binary itself.

use crate::command::Surroundings;
use crate::config::Config;
use crate::error::NodeError;
use crate::serve::{Live, Server, require_loopback};
use crate::watch::ros::RosSource;
use crate::watch::zenoh::ZenohSource;
use crate::watch::{Origin, Wall};
use std::io::Write;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Name of the node, unless it is given another.
pub const NODE: &str = "mr_damper_serve";

/// How often messages are looked for. They count as come when they are found.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// Spacing of batches: 50 a second.
const BATCH_EVERY: Duration = Duration::from_millis(20);

/// Show what dampers do, live, in a browser: force, band, residual, mode, current command.
///
/// The page comes from the binary and fetches nothing from elsewhere; it shows and changes nothing. Dampers are found as they come:
/// whoever publishes force_estimate in this namespace (--ros-args -r __ns:=/vehicle) or below it. Ctrl-C ends.
///
/// Example: mr-damper serve, then open http://127.0.0.1:8330/
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Address and port of the page; port 0 takes a free one.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8330")]
    pub listen: SocketAddr,
    /// Let other machines watch: allows a --listen address beyond loopback. There is no password and no encryption.
    #[arg(long)]
    pub any_host: bool,
    /// Watch these dampers alone, by their namespaces, e.g. front_left,front_right.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub dampers: Vec<String>,
    /// Watch the Zenoh mirror at this address, e.g. tcp/127.0.0.1:7447, and not ROS. The mirror thins what it sends to
    /// zenoh.web_rate_hz.
    #[arg(long, value_name = "ENDPOINT", conflicts_with = "domain_id")]
    pub zenoh: Option<String>,
    /// ROS domain; by default ROS_DOMAIN_ID, else 0.
    #[arg(long, value_name = "ID", default_value_t = -1)]
    pub domain_id: i64,
}

/// Serves the page until a signal comes.
///
/// # Errors
/// When the port is taken, ROS does not start, or a thread dies.
pub fn run(args: &Args, around: &Surroundings) -> Result<(), NodeError> {
    require_loopback(args.listen, args.any_host)?;
    let origin = if args.zenoh.is_some() { Origin::Zenoh } else { Origin::Ros };
    let live = Arc::new(Live::of(origin));
    let server = Server::start(args.listen, args.any_host, Arc::clone(&live))?;
    let mut source = Source::start(args, around)?;
    if args.any_host && !args.listen.ip().is_loopback() {
        tracing::warn!(listen = %server.address(), "whoever reaches this machine can watch: no password, no encryption");
    }
    // A reader that is gone, as `head` is, is no reason to end.
    let mut stdout = std::io::stdout();
    let _ = writeln!(stdout, "http://{}/", server.address()).and_then(|()| stdout.flush());
    let ended = watch(&mut source, &server, &live, around);
    source.stop();
    let stopped = server.stop();
    ended.and(stopped)
}

/// Where the dampers are heard.
enum Source {
    Ros(RosSource),
    Zenoh(ZenohSource),
}

impl Source {
    fn start(args: &Args, around: &Surroundings) -> Result<Self, NodeError> {
        if let Some(endpoint) = &args.zenoh {
            return ZenohSource::start(endpoint, &args.dampers).map(Self::Zenoh);
        }
        let config = Config { domain_id: args.domain_id, ..Config::default() };
        let name = around.ros_args.node.as_deref().unwrap_or(NODE);
        RosSource::start(&config, &around.ros_args, name, &args.dampers).map(Self::Ros)
    }

    /// Brings what has come onto the wall.
    fn bring(&mut self, wall: &mut Wall, now_s: f64) -> Result<(), NodeError> {
        match self {
            Self::Ros(source) => {
                source.look(wall, now_s)?;
                source.drain(wall, now_s);
            }
            Self::Zenoh(source) => {
                source.look(wall, now_s);
                source.drain(wall, now_s);
            }
        }
        Ok(())
    }

    fn is_alive(&self) -> bool {
        match self {
            Self::Ros(source) => source.is_alive(),
            // It connects again by itself.
            Self::Zenoh(_) => true,
        }
    }

    fn stop(self) {
        match self {
            Self::Ros(source) => source.stop(),
            Self::Zenoh(source) => source.stop(),
        }
    }
}

/// Brings what is heard onto the wall and out to the readers, until a signal comes.
fn watch(source: &mut Source, server: &Server, live: &Live, around: &Surroundings) -> Result<(), NodeError> {
    let mut next_batch = Instant::now();
    while !around.interrupt.is_raised() {
        source.bring(&mut live.wall(), live.now_s())?;
        let now = Instant::now();
        if now >= next_batch {
            live.send_batch();
            // After a stall batches go on from now: nobody wants those that were missed.
            next_batch = (next_batch + BATCH_EVERY).max(now + BATCH_EVERY / 2);
        }
        if !server.is_alive() {
            // Its end says why.
            return Ok(());
        }
        if !source.is_alive() {
            return Err(NodeError::Failed(
                "the ROS node's background thread has ended; the log above says why. Start again".to_owned(),
            ));
        }
        std::thread::sleep(LOOK_EVERY.min(next_batch.saturating_duration_since(Instant::now())));
    }
    Ok(())
}
