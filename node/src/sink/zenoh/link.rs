//! The Zenoh session, shared by the mirrors of all dampers of the process.

use super::config::{Rmw, SessionMode, ZenohConfig};
use super::error::ZenohError;
use super::plan::{Plan, plain};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};
use zenoh::{Session, Wait};

/// Zenoh opens a peer within milliseconds; this bounds what is waited for when it does not.
const OPEN_WAIT: Duration = Duration::from_secs(5);
/// What closing may take before it is left to itself.
const CLOSE_WAIT: Duration = Duration::from_millis(400);
/// Pause of a client between two attempts, each of which lasts seconds.
const RETRY_PAUSE: Duration = Duration::from_millis(100);
/// How often connections are counted.
const WATCH_PERIOD: Duration = Duration::from_millis(900);
/// How often it is said that nobody is there.
const REMINDER: Duration = Duration::from_secs(60);

/// An open Zenoh session. One for a process; each damper's [`super::Mirror`] uses it.
#[derive(Debug)]
pub struct Link {
    inner: Arc<Inner>,
}

/// What mirrors hold of a link.
#[derive(Debug)]
pub(super) struct Inner {
    pub(super) config: ZenohConfig,
    plan: Plan,
    opening: Mutex<Opening>,
    closing: AtomicBool,
    watch: Mutex<Watch>,
    entities: AtomicU64,
}

/// How far opening has come.
#[derive(Debug, Clone)]
pub(super) enum Opening {
    /// A client waits for its router.
    Waiting,
    /// The session, which may have been closed since.
    Done(Session),
    /// The session is gone, on request or because opening failed for good.
    Gone,
}

#[derive(Debug, Default)]
struct Watch {
    checked: Option<Instant>,
    said: Option<Instant>,
    connected: usize,
}

impl Link {
    /// Opens a session. A peer is ready when this returns, whether the addresses in `connect` answer or not;
    /// so is a router; a client goes on connecting in the background. Returns within 5 s, usually within 50 ms.
    ///
    /// # Errors
    /// When a setting cannot be used, when a port is taken, or when Zenoh opens no session.
    pub fn open(config: &ZenohConfig) -> Result<Self, ZenohError> {
        let plan = config.plan()?;
        if config.rmw != Rmw::Off && plan.mode == SessionMode::Peer && !plan.connect.is_empty() {
            tracing::warn!(
                "zenoh.rmw as a peer: the router of rmw_zenoh passes nothing on between peers, so its nodes see this one only where \
                 they connect to it themselves; beside such a router, set zenoh.mode to client"
            );
        }
        let inner = Arc::new(Inner {
            config: config.clone(),
            plan,
            opening: Mutex::new(Opening::Waiting),
            closing: AtomicBool::new(false),
            watch: Mutex::default(),
            entities: AtomicU64::new(0),
        });
        let (sender, first_result) = mpsc::sync_channel(1);
        let opener = Arc::clone(&inner);
        // A thread of its own: Zenoh must not be opened inside another async runtime.
        thread::Builder::new()
            .name("zenoh-open".to_owned())
            .spawn(move || opener.open(&sender))
            .map_err(|source| ZenohError::Thread { name: "zenoh-open", source })?;
        let plan = &inner.plan;
        if plan.mode != SessionMode::Client {
            let reason = match first_result.recv_timeout(OPEN_WAIT) {
                Ok(Ok(())) => return Ok(Self { inner }),
                Ok(Err(reason)) => reason,
                Err(error) => error.to_string(),
            };
            inner.closing.store(true, Ordering::Release);
            return Err(match plan.taken_port() {
                Some(endpoint) => ZenohError::PortInUse { endpoint: endpoint.to_owned() },
                None => ZenohError::Open { endpoints: plan.endpoints(), reason },
            });
        }
        Ok(Self { inner })
    }

    /// The settings that the link was opened with.
    #[must_use]
    pub fn config(&self) -> &ZenohConfig {
        &self.inner.config
    }

    /// True while only those whom Zenoh's configuration file names may do what it says.
    #[must_use]
    pub fn has_access_control(&self) -> bool {
        self.inner.plan.access_control
    }

    /// The session; `None` while a client waits for its router, and after the end.
    #[must_use]
    pub fn session(&self) -> Option<Session> {
        match self.inner.opening() {
            Opening::Done(session) if !session.is_closed() => Some(session),
            Opening::Done(_) | Opening::Waiting | Opening::Gone => None,
        }
    }

    /// Routers and peers that are connected now.
    #[must_use]
    pub fn connected(&self) -> usize {
        match self.inner.opening() {
            Opening::Done(session) => count(&session),
            Opening::Waiting | Opening::Gone => 0,
        }
    }

    /// A number that no other entity of this session has in the graph of rmw_zenoh.
    #[must_use]
    pub fn next_entity(&self) -> u64 {
        self.inner.next_entity()
    }

    /// Closes the session, within half a second. Stop the mirrors first, or they report a closed session.
    pub fn close(self) {
        // `Drop` does it.
    }

    pub(super) fn inner(&self) -> Arc<Inner> {
        Arc::clone(&self.inner)
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.inner.closing.store(true, Ordering::Release);
        let opening = std::mem::replace(&mut *self.inner.lock(), Opening::Gone);
        if let Opening::Done(session) = opening {
            close(session);
        }
    }
}

impl Inner {
    pub(super) fn next_entity(&self) -> u64 {
        self.entities.fetch_add(1, Ordering::Relaxed)
    }

    pub(super) fn opening(&self) -> Opening {
        self.lock().clone()
    }

    fn lock(&self) -> MutexGuard<'_, Opening> {
        self.opening.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tries until there is a session or nobody wants it any more; all but a client try once.
    fn open(&self, first_result: &mpsc::SyncSender<Result<(), String>>) {
        let mut said = false;
        while !self.closing.load(Ordering::Acquire) {
            match zenoh::open(self.plan.zenoh.clone()).wait() {
                Ok(session) => {
                    let mut opening = self.lock();
                    if self.closing.load(Ordering::Acquire) {
                        drop(opening);
                        close(session);
                        return;
                    }
                    *opening = Opening::Done(session);
                    drop(opening);
                    // Nobody listens for a client's result.
                    let _ = first_result.try_send(Ok(()));
                    return;
                }
                Err(error) if self.plan.mode != SessionMode::Client => {
                    *self.lock() = Opening::Gone;
                    let _ = first_result.try_send(Err(plain(&error)));
                    return;
                }
                Err(error) => {
                    if !said {
                        said = true;
                        let endpoints = self.plan.endpoints();
                        let why = plain(&error);
                        tracing::warn!("no Zenoh router at {endpoints} yet, trying on: {why}");
                    }
                    thread::sleep(RETRY_PAUSE);
                }
            }
        }
    }

    /// Counts connections, and says when they come and go. Cheap: looks once a second at most.
    pub(super) fn watch(&self, session: &Session) -> usize {
        let mut watch = self.watch.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        if watch.checked.is_some_and(|at| now - at < WATCH_PERIOD) {
            return watch.connected;
        }
        let first = watch.checked.is_none();
        watch.checked = Some(now);
        let before = std::mem::replace(&mut watch.connected, count(session));
        if watch.connected != before {
            tracing::info!(connected = watch.connected, "Zenoh connections: {before} before");
        }
        // A peer that only listens may rightly be alone. The first look is too early to complain.
        let alone = watch.connected == 0 && !self.plan.connect.is_empty() && !first;
        if alone && watch.said.is_none_or(|at| now - at > REMINDER) {
            watch.said = Some(now);
            let endpoints = self.plan.connect.join(", ");
            tracing::warn!("no Zenoh router or peer at {endpoints}; trying on: is it running?");
        } else if !alone {
            watch.said = None;
        }
        watch.connected
    }
}

fn count(session: &Session) -> usize {
    let info = session.info();
    info.routers_zid().wait().count() + info.peers_zid().wait().count()
}

/// Closes a session without waiting for a consumer that does not read.
fn close(session: Session) {
    let (sender, closed) = mpsc::sync_channel(1);
    let closer = thread::Builder::new().name("zenoh-close".to_owned()).spawn(move || {
        if let Err(error) = session.close().wait() {
            tracing::debug!("closing the Zenoh session: {error}");
        }
        // Nobody may be waiting any more.
        let _ = sender.send(());
    });
    match closer {
        Ok(_) if closed.recv_timeout(CLOSE_WAIT).is_ok() => {}
        Ok(_) => tracing::warn!("the Zenoh session takes long to close; it is left to itself"),
        Err(error) => tracing::warn!("no thread to close the Zenoh session: {error}"),
    }
}
