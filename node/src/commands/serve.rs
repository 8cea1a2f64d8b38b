//! `mr-damper serve`: serves a live web page of the dampers. The page is part of the binary.

use crate::commands::context::CliContext;
use crate::settings::config::RosArgs;
use crate::settings::error::NodeError;
use crate::views::foxglove::args::{FoxgloveArgs, print_address};
use crate::views::foxglove::live::LiveFeed;
use crate::views::foxglove::parameters::ParameterReader;
use crate::views::watch::source::{DataSource, SourceArgs};
use crate::views::workshop::{Workshop, WorkshopSettings};
use mr_damper_views::ServeError;
use mr_damper_views::foxglove::FoxgloveServer;
use mr_damper_views::serve::{
    AllowedOrigin, LiveData, Server, require_loopback, require_loopback_for_workshop,
};
use mr_damper_views::watch::DataOrigin;
use mr_damper_views::workshop::WorkshopRequests;
use std::io::Write;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Default name of this command's node.
pub const NODE: &str = "mr_damper_serve";

/// Interval at which messages are polled. Their time of arrival is the time of the poll.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// Interval between batches: 50 per second.
const BATCH_EVERY: Duration = Duration::from_millis(20);
/// Interval at which the workshop looks for new dampers and models.
const LOOK_ROUND_EVERY: Duration = Duration::from_millis(500);
/// Message where no diagnosis can be started.
const NO_DIAGNOSIS: &str = "dampers are watched through the Zenoh mirror, which carries no actions. Start a diagnosis over ROS: with \
                          mr-damper serve without --zenoh, or with mr-damper close --live on the node's machine";

/// Show dampers live in a browser: force, uncertainty band, residual, mode, current command.
///
/// The page is part of the binary and loads nothing from elsewhere. It only shows the dampers and changes nothing. It shows
/// every node that publishes force_estimate in this namespace (--ros-args -r __ns:=/vehicle) or below it, also nodes that
/// start later. Ctrl-C ends the command.
///
/// With --workshop DIR the page can also start work: it lets a damper's node diagnose its model and shows the report, and it
/// takes recorded runs and replays them through a separate node.
///
/// With --foxglove the programs Foxglove, Lichtblick and PlotJuggler can connect, too, and need neither ROS nor message definitions:
/// they get all messages with all digits.
///
/// Examples: mr-damper serve, then open http://127.0.0.1:8330/; mr-damper serve --workshop shop; mr-damper serve --foxglove, then
/// connect a viewer to ws://localhost:8765
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Address and port of the page; port 0 selects a free port.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8330")]
    pub listen: SocketAddr,
    /// Allow addresses beyond loopback for --listen and --foxglove, so that other machines can watch. Neither has a password or
    /// encryption.
    #[arg(long)]
    pub any_host: bool,
    /// Allow web pages of exactly this origin (e.g. `https://app.foxglove.dev`) to read /events and /snapshot, but nothing of the
    /// workshop, and to connect to --foxglove. May be given several times.
    #[arg(long, value_name = "URL")]
    pub allow_origin: Vec<AllowedOrigin>,
    /// The endpoint for other viewers.
    #[command(flatten)]
    pub foxglove: FoxgloveArgs,
    /// Enable the workshop: start diagnoses, upload runs and replay them. Its files are in this directory, which is created
    /// if it does not exist. Works only on loopback.
    #[arg(long, value_name = "DIR")]
    pub workshop: Option<PathBuf>,
    /// Largest run that can be uploaded to the workshop, MB (2^20 bytes).
    #[arg(long, value_name = "MB", requires = "workshop", default_value_t = 2048, value_parser = clap::value_parser!(u64).range(1..1 << 30))]
    pub upload_limit_mb: u64,
    /// The dampers to watch.
    #[command(flatten)]
    pub source: SourceArgs,
}

/// Serves the page until a signal comes.
///
/// # Errors
/// When the port is taken, ROS does not start, or a thread dies.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    require_loopback(args.listen, args.any_host)?;
    args.foxglove.check(args.any_host)?;
    if args.workshop.is_some() {
        require_loopback_for_workshop(args.listen)?;
    }
    let live = Arc::new(LiveData::of(args.source.origin()));
    let workshop = open_workshop(args, &live, context)?;
    let requests = workshop.clone().map(|workshop| -> Arc<dyn WorkshopRequests> { workshop });
    let server = Server::start(args.listen, args.any_host, &args.allow_origin, Arc::clone(&live), requests)?;
    let mut viewers = Viewers::start(args)?;
    let mut source = DataSource::start(&args.source, &context.ros_args, NODE)?;
    if let Some(workshop) = &workshop {
        source.ignore(&workshop.namespace());
    }
    if args.any_host && !args.listen.ip().is_loopback() {
        tracing::warn!(listen = %server.address(), "anyone who can reach this machine can watch, without password or encryption");
    }
    // Before the address is printed, so that a first request already finds the dampers of --dampers.
    let begun = viewers.poll(&mut source, &live);
    // A closed stdout (`| head`) does not end the command.
    let mut stdout = std::io::stdout();
    let _ = writeln!(stdout, "http://{}/", server.address()).and_then(|()| stdout.flush());
    viewers.server.iter().for_each(print_address);
    let ended =
        begun.and_then(|()| watch(&mut source, &mut viewers, &server, &live, workshop.as_deref(), context));
    // The server stops first, so that no new work begins and uploads are cut off.
    let stopped = server.stop().and(viewers.stop());
    let ending = workshop.as_ref().map(|workshop| (workshop, workshop.interrupt()));
    source.stop();
    if let Some((workshop, deadline)) = ending {
        workshop.close(deadline);
    }
    ended.and(stopped.map_err(NodeError::from))
}

/// Opens the workshop, if `args` ask for one.
fn open_workshop(
    args: &Args,
    live: &LiveData,
    context: &CliContext,
) -> Result<Option<Arc<Workshop>>, NodeError> {
    let Some(folder) = &args.workshop else { return Ok(None) };
    let settings = WorkshopSettings {
        folder: folder.clone(),
        upload_limit_bytes: args.upload_limit_mb << 20,
        registry: live.shared_registry(),
        domain_id: args.source.domain_id,
        ros_args: context.ros_args.clone(),
        no_diagnosis: (args.source.origin() == DataOrigin::Zenoh).then(|| NO_DIAGNOSIS.to_owned()),
    };
    Workshop::open(settings).map(Some)
}

/// The endpoint for other viewers, if there is one, and what feeds it.
struct Viewers {
    feed: LiveFeed,
    server: Option<FoxgloveServer>,
    /// Number of topics that were announced.
    announced: usize,
    /// Readers of the parameters of each damper's node, by the damper's name.
    parameters: Vec<(String, ParameterReader)>,
    /// True while viewers are connected of which one has asked for parameters.
    wants_parameters: bool,
}

impl Viewers {
    fn start(args: &Args) -> Result<Self, NodeError> {
        // The Zenoh mirror carries no parameters.
        let feed = LiveFeed::new(args.source.origin() == DataOrigin::Ros);
        let server = args.foxglove.start(args.any_host, &args.allow_origin, feed.channels())?;
        Ok(Self { feed, server, announced: 0, parameters: Vec::new(), wants_parameters: false })
    }

    /// Polls the source: for the page, and for the viewers.
    fn poll(&mut self, source: &mut DataSource, live: &LiveData) -> Result<(), NodeError> {
        if self.server.is_none() {
            return source.poll(&mut live.registry(), live.now_s(), &mut |_, _| {});
        }
        let feed = &mut self.feed;
        source.poll(&mut live.registry(), live.now_s(), &mut |topic, message| feed.take(topic, message))?;
        if source.topic_count() != self.announced {
            let topics = source.topics();
            topics.iter().for_each(|(topic, in_node)| feed.announce(topic, in_node));
            self.announced = topics.len();
            self.find_nodes(source)?;
        }
        self.read_parameters(source);
        Ok(())
    }

    /// Prepares to read the parameters of new dampers' nodes.
    fn find_nodes(&mut self, source: &mut DataSource) -> Result<(), NodeError> {
        let dampers = source.diagnosable();
        let Some(ros) = source.ros_mut() else { return Ok(()) };
        for (name, namespace) in dampers {
            if self.parameters.iter().all(|(known, _)| *known != name) {
                let node = format!("{}/{}", namespace.trim_end_matches('/'), RosArgs::default().node_name());
                self.parameters.push((name, ParameterReader::new(ros, node)?));
            }
        }
        Ok(())
    }

    /// Reads the parameters of the nodes once a viewer has asked for them, and again while viewers are connected.
    fn read_parameters(&mut self, source: &mut DataSource) {
        let channels = self.feed.channels();
        let is_asked = channels.take_parameter_request() || self.wants_parameters;
        self.wants_parameters = is_asked && channels.viewers() > 0;
        let Some(ros) = source.ros_mut() else { return };
        for (_, reader) in &mut self.parameters {
            if self.wants_parameters {
                reader.ask();
            }
            reader.poll(ros, channels);
        }
    }

    /// Disconnects all viewers. The readers of parameters end before their node.
    fn stop(self) -> Result<(), ServeError> {
        drop(self.parameters);
        self.server.map_or(Ok(()), FoxgloveServer::stop)
    }

    /// False once the endpoint has ended by itself.
    fn is_alive(&self) -> bool {
        self.server.as_ref().is_none_or(FoxgloveServer::is_alive)
    }
}

/// Polls the source and sends batches to the open pages, until a signal comes.
fn watch(
    source: &mut DataSource,
    viewers: &mut Viewers,
    server: &Server,
    live: &LiveData,
    workshop: Option<&Workshop>,
    context: &CliContext,
) -> Result<(), NodeError> {
    let (mut next_batch, mut next_look) = (Instant::now(), Instant::now());
    while !context.interrupt.is_raised() {
        viewers.poll(source, live)?;
        let now = Instant::now();
        if let Some(workshop) = workshop.filter(|_| now >= next_look) {
            workshop.set_diagnosable(source.diagnosable());
            workshop.look_for_models();
            next_look = now + LOOK_ROUND_EVERY;
        }
        if now >= next_batch {
            live.send_batch();
            // After a stall, missed batches are not sent later.
            next_batch = (next_batch + BATCH_EVERY).max(now + BATCH_EVERY / 2);
        }
        if !server.is_alive() || !viewers.is_alive() {
            // Stopping them returns the reason.
            return Ok(());
        }
        std::thread::sleep(LOOK_EVERY.min(next_batch.saturating_duration_since(Instant::now())));
    }
    Ok(())
}
