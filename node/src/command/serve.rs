//! `mr-damper serve`: a live page of the dampers, from the binary itself.

use crate::command::Surroundings;
use crate::error::NodeError;
use crate::serve::{Guest, Live, Server, require_loopback, require_loopback_for_workshop};
use crate::watch::Origin;
use crate::watch::source::{Source, SourceArgs};
use crate::workshop::{Opening, Workshop};
use std::io::Write;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Name of the node, unless it is given another.
pub const NODE: &str = "mr_damper_serve";

/// How often messages are looked for. They count as come when they are found.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// Spacing of batches: 50 a second.
const BATCH_EVERY: Duration = Duration::from_millis(20);
/// How often the workshop learns of dampers and models that have come.
const LOOK_ROUND_EVERY: Duration = Duration::from_millis(500);
/// Said where closings cannot be started.
const NO_CLOSING: &str = "dampers are watched through the Zenoh mirror, which carries no actions: a closing is started by ROS, with \
                          mr-damper serve without --zenoh, or mr-damper close --live on the node's machine";

/// Show what dampers do, live, in a browser: force, band, residual, mode, current command.
///
/// The page comes from the binary and fetches nothing from elsewhere; it shows and changes nothing. Dampers are found as they come:
/// whoever publishes force_estimate in this namespace (--ros-args -r __ns:=/vehicle) or below it. Ctrl-C ends.
///
/// With --workshop DIR it does more: the page can have a damper's node name what its model lacks, and shows the report; and it takes
/// recorded runs, which it replays through a node of its own, apart from all others.
///
/// Examples: mr-damper serve, then open http://127.0.0.1:8330/; mr-damper serve --workshop shop
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Address and port of the page; port 0 takes a free one.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8330")]
    pub listen: SocketAddr,
    /// Let other machines watch: allows a --listen address beyond loopback. There is no password and no encryption.
    #[arg(long)]
    pub any_host: bool,
    /// Let another page, of exactly this origin, read /events and /snapshot (e.g. http://localhost:8000); several are several
    /// --allow-origin. Of the workshop it sees nothing.
    #[arg(long, value_name = "URL")]
    pub allow_origin: Vec<Guest>,
    /// Open a workshop in this directory (made where it is missing): start closings, take runs and replay them. On loopback alone.
    #[arg(long, value_name = "DIR")]
    pub workshop: Option<PathBuf>,
    /// The largest run that the workshop takes, MB (2^20 bytes).
    #[arg(long, value_name = "MB", requires = "workshop", default_value_t = 2048, value_parser = clap::value_parser!(u64).range(1..1 << 30))]
    pub upload_limit_mb: u64,
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
    if args.workshop.is_some() {
        require_loopback_for_workshop(args.listen)?;
    }
    let live = Arc::new(Live::of(args.source.origin()));
    let workshop = open_workshop(args, &live, around)?;
    let server =
        Server::start(args.listen, args.any_host, &args.allow_origin, Arc::clone(&live), workshop.clone())?;
    let mut source = Source::start(&args.source, around, NODE)?;
    if let Some(workshop) = &workshop {
        source.leave_out(&workshop.namespace());
    }
    if args.any_host && !args.listen.ip().is_loopback() {
        tracing::warn!(listen = %server.address(), "whoever reaches this machine can watch: no password, no encryption");
    }
    // Before anybody can ask: dampers that were named are on the wall.
    let begun = source.bring(&mut live.wall(), live.now_s());
    // A reader that is gone, as `head` is, is no reason to end.
    let mut stdout = std::io::stdout();
    let _ = writeln!(stdout, "http://{}/", server.address()).and_then(|()| stdout.flush());
    let ended = begun.and_then(|()| watch(&mut source, &server, &live, workshop.as_deref(), around));
    // First, so that nobody begins anything, and uploads are cut off.
    let stopped = server.stop();
    let closing = workshop.as_ref().map(|workshop| (workshop, workshop.interrupt()));
    source.stop();
    if let Some((workshop, deadline)) = closing {
        workshop.close(deadline);
    }
    ended.and(stopped)
}

/// The workshop that `args` ask for.
fn open_workshop(
    args: &Args,
    live: &Live,
    around: &Surroundings,
) -> Result<Option<Arc<Workshop>>, NodeError> {
    let Some(folder) = &args.workshop else { return Ok(None) };
    let opening = Opening {
        folder: folder.clone(),
        upload_limit_bytes: args.upload_limit_mb << 20,
        hall: live.hall(),
        domain_id: args.source.domain_id,
        ros_args: around.ros_args.clone(),
        no_closing: (args.source.origin() == Origin::Zenoh).then(|| NO_CLOSING.to_owned()),
    };
    Workshop::open(opening).map(Some)
}

/// Brings what is heard onto the wall and out to the readers, until a signal comes.
fn watch(
    source: &mut Source,
    server: &Server,
    live: &Live,
    workshop: Option<&Workshop>,
    around: &Surroundings,
) -> Result<(), NodeError> {
    let (mut next_batch, mut next_look) = (Instant::now(), Instant::now());
    while !around.interrupt.is_raised() {
        source.bring(&mut live.wall(), live.now_s())?;
        let now = Instant::now();
        if let Some(workshop) = workshop.filter(|_| now >= next_look) {
            workshop.know(source.askable());
            workshop.look_for_models();
            next_look = now + LOOK_ROUND_EVERY;
        }
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
