//! The Zenoh session, shared by the mirrors of all dampers of the process.

use super::config::{Rmw, SessionMode, ZenohConfig};
use super::error::ZenohError;
use super::session_config::{SessionConfig, plain};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};
use zenoh::{Session, Wait};

/// Longest wait for a peer's session, which Zenoh normally opens within milliseconds.
const OPEN_WAIT: Duration = Duration::from_secs(5);
/// Longest wait for a session to close; afterwards it closes in the background.
const CLOSE_WAIT: Duration = Duration::from_millis(400);
/// Pause of a client between two attempts to connect. An attempt takes seconds.
const RETRY_PAUSE: Duration = Duration::from_millis(100);
/// Interval between counts of the connections.
const WATCH_PERIOD: Duration = Duration::from_millis(900);
/// Interval between warnings about a missing connection.
const REMINDER: Duration = Duration::from_secs(60);

/// The Zenoh session of the process. The mirror of each damper uses it.
#[derive(Debug)]
pub struct Link {
    inner: Arc<Inner>,
}

/// The part of a link that it shares with the mirrors.
#[derive(Debug)]
pub(crate) struct Inner {
    pub(crate) config: ZenohConfig,
    settings: SessionConfig,
    session: Mutex<SessionState>,
    closing: AtomicBool,
    watch: Mutex<ConnectionWatch>,
    entities: AtomicU64,
}

/// State of the session.
#[derive(Debug, Clone)]
pub(crate) enum SessionState {
    /// A client waits for its router.
    Waiting,
    /// The session was opened; it may have been closed since.
    Done(Session),
    /// The session was closed or could not be opened.
    Gone,
}

#[derive(Debug, Default)]
struct ConnectionWatch {
    checked: Option<Instant>,
    warned: Option<Instant>,
    connected: usize,
}

impl Link {
    /// Opens a session, within 5 s and usually within 50 ms. A peer or router is ready when this returns, even if the
    /// addresses in `connect` do not answer; a client connects in the background.
    ///
    /// # Errors
    /// When a setting is invalid, when a port is in use, or when Zenoh cannot open the session.
    pub fn open(config: &ZenohConfig) -> Result<Self, ZenohError> {
        let settings = config.session_config()?;
        if config.rmw != Rmw::Off && settings.mode == SessionMode::Peer && !settings.connect.is_empty() {
            tracing::warn!(
                "zenoh.rmw is used in peer mode: the router of rmw_zenoh does not forward traffic between peers, so its nodes see this \
                 node only if they connect to it directly; with such a router, set zenoh.mode to client"
            );
        }
        let inner = Arc::new(Inner {
            config: config.clone(),
            settings,
            session: Mutex::new(SessionState::Waiting),
            closing: AtomicBool::new(false),
            watch: Mutex::default(),
            entities: AtomicU64::new(0),
        });
        let (sender, first_result) = mpsc::sync_channel(1);
        let opener = Arc::clone(&inner);
        // A separate thread, because Zenoh must not be opened inside another async runtime.
        thread::Builder::new()
            .name("zenoh-open".to_owned())
            .spawn(move || opener.open(&sender))
            .map_err(|source| ZenohError::Thread { name: "zenoh-open", source })?;
        let settings = &inner.settings;
        if settings.mode != SessionMode::Client {
            let reason = match first_result.recv_timeout(OPEN_WAIT) {
                Ok(Ok(())) => return Ok(Self { inner }),
                Ok(Err(error)) => plain(&error),
                Err(error) => error.to_string(),
            };
            inner.closing.store(true, Ordering::Release);
            return Err(match settings.taken_port() {
                Some(endpoint) => ZenohError::PortInUse { endpoint: endpoint.to_owned() },
                None => ZenohError::Open { endpoints: settings.endpoints(), reason },
            });
        }
        Ok(Self { inner })
    }

    /// The settings that the link was opened with.
    #[must_use]
    pub fn config(&self) -> &ZenohConfig {
        &self.inner.config
    }

    /// True when Zenoh's configuration file enables access control that denies everything it does not allow.
    #[must_use]
    pub fn has_access_control(&self) -> bool {
        self.inner.settings.access_control
    }

    /// The session; `None` while a client waits for its router, and after the session has ended.
    #[must_use]
    pub fn session(&self) -> Option<Session> {
        match self.inner.session_state() {
            SessionState::Done(session) if !session.is_closed() => Some(session),
            SessionState::Done(_) | SessionState::Waiting | SessionState::Gone => None,
        }
    }

    /// Number of connected routers and peers.
    #[must_use]
    pub fn connected(&self) -> usize {
        match self.inner.session_state() {
            SessionState::Done(session) => count(&session),
            SessionState::Waiting | SessionState::Gone => 0,
        }
    }

    /// A new entity number for the graph of rmw_zenoh, unique in this session.
    #[must_use]
    pub fn next_entity(&self) -> u64 {
        self.inner.next_entity()
    }

    /// Closes the session, within half a second. Stop the mirrors first, or they report a closed session.
    pub fn close(self) {
        // `Drop` closes it.
    }

    pub(crate) fn inner(&self) -> Arc<Inner> {
        Arc::clone(&self.inner)
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.inner.closing.store(true, Ordering::Release);
        let state = std::mem::replace(&mut *self.inner.lock(), SessionState::Gone);
        if let SessionState::Done(session) = state {
            close(session);
        }
    }
}

impl Inner {
    pub(crate) fn next_entity(&self) -> u64 {
        self.entities.fetch_add(1, Ordering::Relaxed)
    }

    pub(crate) fn session_state(&self) -> SessionState {
        self.lock().clone()
    }

    fn lock(&self) -> MutexGuard<'_, SessionState> {
        self.session.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Opens the session. A client retries until it is open or the link is closed; a peer or router tries once.
    fn open(&self, first_result: &mpsc::SyncSender<Result<(), zenoh::Error>>) {
        let mut warned = false;
        while !self.closing.load(Ordering::Acquire) {
            match zenoh::open(self.settings.zenoh.clone()).wait() {
                Ok(session) => {
                    let mut state = self.lock();
                    if self.closing.load(Ordering::Acquire) {
                        drop(state);
                        close(session);
                        return;
                    }
                    *state = SessionState::Done(session);
                    drop(state);
                    // For a client the result is not received.
                    let _ = first_result.try_send(Ok(()));
                    return;
                }
                Err(error) if self.settings.mode != SessionMode::Client => {
                    *self.lock() = SessionState::Gone;
                    let _ = first_result.try_send(Err(error));
                    return;
                }
                Err(error) => {
                    if !warned {
                        warned = true;
                        let endpoints = self.settings.endpoints();
                        let why = plain(&error);
                        tracing::warn!("cannot connect to a Zenoh router at {endpoints}, retrying: {why}");
                    }
                    thread::sleep(RETRY_PAUSE);
                }
            }
        }
    }

    /// Counts the connections and logs changes. Cheap: it looks about once a second at most.
    pub(crate) fn watch(&self, session: &Session) -> usize {
        let mut watch = self.watch.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        if watch.checked.is_some_and(|at| now - at < WATCH_PERIOD) {
            return watch.connected;
        }
        let first = watch.checked.is_none();
        watch.checked = Some(now);
        let before = std::mem::replace(&mut watch.connected, count(session));
        if watch.connected != before {
            tracing::info!(connected = watch.connected, "Zenoh connections changed: {before} before");
        }
        // A peer that only listens may be alone without a fault. On the first look it is too early for a warning.
        let alone = watch.connected == 0 && !self.settings.connect.is_empty() && !first;
        if alone && watch.warned.is_none_or(|at| now - at > REMINDER) {
            watch.warned = Some(now);
            let endpoints = self.settings.connect.join(", ");
            tracing::warn!(
                "not connected to a Zenoh router or peer at {endpoints}, retrying: is it running?"
            );
        } else if !alone {
            watch.warned = None;
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
        // The receiver may have given up waiting.
        let _ = sender.send(());
    });
    match closer {
        Ok(_) if closed.recv_timeout(CLOSE_WAIT).is_ok() => {}
        Ok(_) => tracing::warn!("the Zenoh session takes long to close; closing continues in the background"),
        Err(error) => tracing::warn!("cannot start a thread to close the Zenoh session: {error}"),
    }
}
