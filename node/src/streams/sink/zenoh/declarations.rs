//! Zenoh declarations of one damper: publishers, queryables and the liveliness token.

use super::answer::{self, QueryKind, WAITING};
use super::encode::{Encoded, encoding_of};
use super::rmw_output::RmwDeclarations;
use super::shared::{ROUTES, Shared, Tree, route};
use super::topic::Topic;
use crate::zenoh::session::Encoding;
use crate::zenoh::session::Inner;
use std::sync::{Arc, mpsc};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::Queryable;
use zenoh::{Session, Wait};

/// Longest wait for the answering thread to end. A consumer that does not read may delay it.
const ANSWER_WAIT: Duration = Duration::from_millis(150);

/// The declarations of one damper. They end with [`Declarations::close`] or with the session.
#[derive(Debug)]
pub(super) struct Declarations {
    session: Session,
    publishers: Vec<Publisher<'static>>,
    queryables: Vec<Queryable<()>>,
    token: LivelinessToken,
    answering: JoinHandle<()>,
    rmw: Option<RmwDeclarations>,
}

impl Declarations {
    /// Declares everything. The token comes last, so that clients that see it find the rest.
    pub(super) fn declare(session: Session, link: &Inner, shared: &Arc<Shared>) -> zenoh::Result<Self> {
        let mut publishers = Vec::with_capacity(ROUTES);
        for (tree, encoding) in [(Tree::State, shared.config.encoding), (Tree::Web, Encoding::Json)] {
            for topic in Topic::ALL {
                let publisher = session
                    .declare_publisher(shared.route_key(tree, topic))
                    .encoding(encoding_of(encoding, topic).zenoh())
                    // Never Block: a consumer that does not read would delay all others.
                    .congestion_control(CongestionControl::Drop)
                    // Not the default priority: answers use it, and they may block its queue.
                    .priority(Priority::DataHigh)
                    // Express lost samples in measurements.
                    .express(false)
                    .wait()?;
                publishers.push(publisher);
            }
        }
        let (queue, queries) = mpsc::sync_channel(WAITING);
        let mut queryables = Vec::with_capacity(QueryKind::ALL.len());
        for kind in QueryKind::ALL {
            let (queue, callback_of) = (queue.clone(), Arc::clone(shared));
            let queryable = session
                .declare_queryable(shared.key(kind.tail()))
                .callback(move |query| answer::enqueue(kind, query, &queue, &callback_of))
                .wait()?;
            queryables.push(queryable);
        }
        let answers_of = Arc::clone(shared);
        let answering = thread::Builder::new()
            .name("zenoh-answers".to_owned())
            .spawn(move || answer::run(&queries, &answers_of))?;
        let presence = shared.rmw.as_ref();
        let rmw = presence.map(|presence| RmwDeclarations::declare(&session, link, presence)).transpose()?;
        let token = session.liveliness().declare_token(shared.key("alive")).wait()?;
        Ok(Self { session, publishers, queryables, token, answering, rmw })
    }

    /// The declarations for nodes on rmw_zenoh, if any.
    pub(super) fn rmw(&mut self) -> Option<&mut RmwDeclarations> {
        self.rmw.as_mut()
    }

    pub(super) fn session(&self) -> &Session {
        &self.session
    }

    /// Publishes a sample without waiting for consumers.
    pub(super) fn put(&self, tree: Tree, topic: Topic, encoded: Encoded) -> zenoh::Result<()> {
        let publisher = &self.publishers[route(tree, topic)];
        let put = publisher.put(encoded.bytes);
        match encoded.attachment {
            Some(attachment) => put.attachment(attachment).wait(),
            None => put.wait(),
        }
    }

    /// Undeclares everything. The token comes first, so that no client relies on the rest any more.
    pub(super) fn close(self) {
        let mut results = vec![self.token.undeclare().wait()];
        if let Some(rmw) = self.rmw {
            rmw.close();
        }
        results.extend(self.queryables.into_iter().map(|queryable| queryable.undeclare().wait()));
        results.extend(self.publishers.into_iter().map(|publisher| publisher.undeclare().wait()));
        for error in results.into_iter().filter_map(Result::err) {
            tracing::debug!("undeclaring from Zenoh: {error}");
        }
        let patience = Instant::now() + ANSWER_WAIT;
        while !self.answering.is_finished() && Instant::now() < patience {
            thread::sleep(Duration::from_millis(2));
        }
        // If the thread is still blocked, it ends with its query.
        if self.answering.is_finished() && self.answering.join().is_err() {
            tracing::error!("the thread that answers Zenoh queries panicked");
        }
    }
}
