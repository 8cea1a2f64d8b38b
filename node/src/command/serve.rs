//! `mr-damper serve`: a live page of the dampers, from the binary itself.

use crate::command::Surroundings;
use crate::error::NodeError;
use crate::serve::{Live, Server, require_loopback};
use crate::watch::source::{Source, SourceArgs};
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
    /// What is watched.
    #[command(flatten)]
    pub source: SourceArgs,
}

/// Serves the page until a signal comes.
///
/// # Errors
/// When the port is taken, ROS does not start, or a thread dies.
pub fn run(args: &Args, around: &Surroundings) -> Result<(), NodeError> {
    require_loopback(args.listen, args.any_host)?;
    let live = Arc::new(Live::of(args.source.origin()));
    let server = Server::start(args.listen, args.any_host, Arc::clone(&live))?;
    let mut source = Source::start(&args.source, around, NODE)?;
    if args.any_host && !args.listen.ip().is_loopback() {
        tracing::warn!(listen = %server.address(), "whoever reaches this machine can watch: no password, no encryption");
    }
    // Before anybody can ask: dampers that were named are on the wall.
    let begun = source.bring(&mut live.wall(), live.now_s());
    // A reader that is gone, as `head` is, is no reason to end.
    let mut stdout = std::io::stdout();
    let _ = writeln!(stdout, "http://{}/", server.address()).and_then(|()| stdout.flush());
    let ended = begun.and_then(|()| watch(&mut source, &server, &live, around));
    source.stop();
    let stopped = server.stop();
    ended.and(stopped)
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
        std::thread::sleep(LOOK_EVERY.min(next_batch.saturating_duration_since(Instant::now())));
    }
    Ok(())
}
