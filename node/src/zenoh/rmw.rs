//! How nodes on rmw_zenoh appear on Zenoh: keys, liveliness tokens, attachments.
//!
//! | item | form |
//! |---|---|
//! | key of a topic | `<domain>/<topic>/<DDS type>/<type hash>` |
//! | token of a node | `@ros2_lv/<domain>/<session>/<node id>/<node id>/NN/<enclave>/<namespace>/<node>` |
//! | token of its publisher (`MP`) or subscription (`MS`) | the same with its own id, then `/<topic>/<DDS type>/<type hash>/<QoS>` |
//! | gid | XXH3-128 of the token, the low 64 bits first |
//! | attachment of a sample | 33 bytes: number (i64, from 1), ns since 1970 (i64), `0x10`, gid; little endian |
//! | sample | CDR with its four header bytes |
//!
//! In a token, `/` is written as `%`. The formats are read from
//! `rmw_zenoh_cpp/src/detail/{liveliness_utils,attachment_helpers}.cpp`, and checked against pyzeros and pamoja-ros2.
//! Two different messages with the same name have different hashes and therefore different keys. A node that was built
//! with another version of an interface package receives nothing.
//!
//! This module has names and numbers only: `sink/zenoh/rmw_output.rs` publishes, `source/zenoh/rmw_input.rs` subscribes.

use mr_damper_msgs::Descriptor;

/// First chunk of liveliness tokens. Wildcards do not match a chunk with `@`.
const TOKENS: &str = "@ros2_lv";
/// Length of an attachment, in bytes.
const ATTACHMENT_LEN: usize = 33;
/// Length of a gid, which precedes it in the attachment.
const GID_LEN: u8 = 16;

/// Identifier of one publisher or subscription.
pub type Gid = [u8; GID_LEN as usize];

/// A node as others see it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Node {
    /// ROS domain.
    pub domain: u16,
    /// Enclave; `/` for none.
    pub enclave: String,
    /// Namespace, starting with a slash; `/` alone for none.
    pub namespace: String,
    /// Name without namespace.
    pub name: String,
    /// Its number among all entities of the Zenoh session.
    pub id: u64,
}

/// The kind of a topic's endpoint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Reliable, volatile, depth 10: like the node's outputs on DDS.
    Publisher,
    /// Best effort, volatile, depth 10: like the node's inputs on DDS, so that any publisher matches.
    Subscription,
}

impl Role {
    const fn mark(self) -> &'static str {
        match self {
            Self::Publisher => "MP",
            Self::Subscription => "MS",
        }
    }

    /// Reliability, durability, history and depth, deadline, lifespan, liveliness, by their numbers in `rmw/types.h`.
    /// Values equal to rmw_zenoh's default (reliable, volatile, keep last, 42, no limits) are left out.
    const fn qos(self) -> &'static str {
        match self {
            Self::Publisher => "::,10:,:,:,,",
            Self::Subscription => "2::,10:,:,:,,",
        }
    }
}

impl Node {
    /// The node's token in the Zenoh session `session`.
    #[must_use]
    pub fn token(&self, session: &str) -> String {
        self.entity(session, self.id, "NN")
    }

    /// The token of the endpoint `id` of `topic` (full name).
    #[must_use]
    pub fn endpoint(&self, session: &str, id: u64, role: Role, topic: &str, of: &Descriptor) -> String {
        let Descriptor { dds_type_name, type_hash, .. } = of;
        let (entity, topic) = (self.entity(session, id, role.mark()), mangled(topic));
        format!("{entity}/{topic}/{dds_type_name}/{type_hash}/{}", role.qos())
    }

    fn entity(&self, session: &str, id: u64, mark: &str) -> String {
        let Self { domain, enclave, namespace, name, id: node } = self;
        let (enclave, namespace) = (mangled(enclave), mangled(namespace));
        format!("{TOKENS}/{domain}/{session}/{node}/{id}/{mark}/{enclave}/{namespace}/{name}")
    }

    /// The key of samples of `topic` (full name).
    #[must_use]
    pub fn key(&self, topic: &str, of: &Descriptor) -> String {
        format!("{}/{}/{}/{}", self.domain, topic.trim_matches('/'), of.dds_type_name, of.type_hash)
    }

    /// The tokens of all publishers of `topic` (full name), of any type.
    #[must_use]
    pub fn publishers(&self, topic: &str) -> String {
        format!("{TOKENS}/{}/*/*/*/MP/*/*/*/{}/*/*/*", self.domain, mangled(topic))
    }
}

/// A publisher, as its token describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Publisher<'a> {
    /// Full name of its node.
    pub node: String,
    /// DDS name of its messages' type.
    pub dds_type_name: &'a str,
    /// Hash of that type.
    pub type_hash: &'a str,
}

impl<'a> Publisher<'a> {
    /// Reads a token found with [`Node::publishers`]; `None` if it is malformed.
    #[must_use]
    pub fn read(token: &'a str) -> Option<Self> {
        let mut parts = token.split('/').skip(7);
        let (namespace, name) = (parts.next()?.replace('%', "/"), parts.next()?);
        let (_topic, dds_type_name, type_hash) = (parts.next()?, parts.next()?, parts.next()?);
        Some(Self { node: format!("{}/{name}", namespace.trim_end_matches('/')), dds_type_name, type_hash })
    }
}

fn mangled(name: &str) -> String {
    name.replace('/', "%")
}

/// The gid of the entity with this token.
#[must_use]
pub fn gid(token: &str) -> Gid {
    xxhash_rust::xxh3::xxh3_128(token.as_bytes()).to_le_bytes()
}

/// The attachment of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attachment {
    /// The sample's number, from 1 and without gaps for each publisher.
    pub seq: i64,
    /// When it was published, in ns since 1970.
    pub stamp_ns: i64,
    /// Its publisher.
    pub gid: Gid,
}

/// The reason why an attachment is not one of rmw_zenoh.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AttachmentError {
    /// Another number of bytes.
    #[error(
        "the attachment has {0} bytes, but rmw_zenoh's has 33 (number, time, gid); check that a ROS node sends it"
    )]
    Length(usize),
    /// A gid of another length.
    #[error("the attachment has a gid of {0} bytes, but rmw_zenoh's has 16")]
    Gid(u8),
}

impl Attachment {
    /// The attachment as bytes.
    #[must_use]
    pub fn to_bytes(self) -> [u8; ATTACHMENT_LEN] {
        let mut bytes = [0; ATTACHMENT_LEN];
        bytes[..8].copy_from_slice(&self.seq.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.stamp_ns.to_le_bytes());
        bytes[16] = GID_LEN;
        bytes[17..].copy_from_slice(&self.gid);
        bytes
    }

    /// Reads an attachment.
    ///
    /// # Errors
    /// When the bytes are not an attachment of rmw_zenoh.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, AttachmentError> {
        let wrong = || AttachmentError::Length(bytes.len());
        let (seq, rest) = bytes.split_first_chunk::<8>().ok_or_else(wrong)?;
        let (stamp_ns, rest) = rest.split_first_chunk::<8>().ok_or_else(wrong)?;
        let (length, gid) = rest.split_first().ok_or_else(wrong)?;
        let gid: Gid = gid.try_into().map_err(|_| wrong())?;
        if *length != GID_LEN {
            return Err(AttachmentError::Gid(*length));
        }
        Ok(Self { seq: i64::from_le_bytes(*seq), stamp_ns: i64::from_le_bytes(*stamp_ns), gid })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_msgs::ForceEstimate;

    const SESSION: &str = "aac3178e146ba6f1fc6e6a4085e77f21";
    const OF: Descriptor = Descriptor::of::<ForceEstimate>();

    fn node(namespace: &str) -> Node {
        let (enclave, name) = ("/".to_owned(), "mr_damper".to_owned());
        Node { domain: 70, enclave, namespace: namespace.to_owned(), name, id: 3 }
    }

    fn tokens(namespace: &str) -> [String; 2] {
        let (node, topic) = (node(namespace), format!("{}/force_estimate", namespace.trim_end_matches('/')));
        [(4, Role::Publisher), (5, Role::Subscription)]
            .map(|(id, role)| node.endpoint(SESSION, id, role, &topic, &OF))
    }

    // The expected texts come from pyzeros 0.1.0: `token_keyexpr` of node, pub (`QosProfile.default()`) and sub (best
    // effort, depth 10), `publisher_keyexpr`, `rmw_zenoh_gid`, `Attachment`. The key also agrees with `entity_key` of
    // pamoja-ros2 0.2.0.

    #[test]
    fn names_agree_with_independent_implementations() {
        let hash = "RIHS01_9dc78705ac5ed035bf624baa16dcbe27da337cfbb7421937be2c52883cc4de96";
        let node = node("/front_left");
        assert_eq!(
            node.token(SESSION),
            "@ros2_lv/70/aac3178e146ba6f1fc6e6a4085e77f21/3/3/NN/%/%front_left/mr_damper"
        );
        assert_eq!(
            node.key("/front_left/force_estimate", &OF),
            format!("70/front_left/force_estimate/mr_damper_msgs::msg::dds_::ForceEstimate_/{hash}")
        );
        for (token, begin, end) in [
            (&tokens("/front_left")[0], "4/MP", "::,10:,:,:,,"),
            (&tokens("/front_left")[1], "5/MS", "2::,10:,:,:,,"),
        ] {
            assert_eq!(
                *token,
                format!(
                    "@ros2_lv/70/aac3178e146ba6f1fc6e6a4085e77f21/3/{begin}/%/%front_left/mr_damper/\
                     %front_left%force_estimate/mr_damper_msgs::msg::dds_::ForceEstimate_/{hash}/{end}"
                )
            );
        }
    }

    /// A gid is computed from the whole token. XXH3 uses another algorithm above 240 bytes; these tokens have 208 to
    /// 256.
    #[test]
    fn gids_agree_with_an_independent_implementation() {
        for (namespace, gids) in [
            ("/", ["271cdaddf88f9898de2e6d49baae6ff7", "cb665e75705f3c0b49aff322b3d0c805"]),
            ("/front_left", ["3fdf55ae6b4776a52a4d57c7f8c866aa", "0ef8110ba03bca40f3acfb0cba0124dd"]),
            (
                "/vehicle/front_axle/left",
                ["6329bce117fb93e852df151cf5d48270", "24ff546b818213b1935f03d43832a4e0"],
            ),
        ] {
            let hex = |token: String| gid(&token).map(|byte| format!("{byte:02x}")).concat();
            assert_eq!(tokens(namespace).map(hex), gids, "{namespace}");
        }
    }

    #[test]
    fn an_attachment_is_written_as_pyzeros_does_and_other_lengths_are_refused() {
        let gid = std::array::from_fn(|index| index as u8);
        let attachment = Attachment { seq: 258, stamp_ns: 1_700_000_000_123_456_789, gid };
        let bytes = attachment.to_bytes();
        let hex = bytes.map(|byte| format!("{byte:02x}")).concat();
        assert_eq!(hex, "020100000000000015cd853dfe9c971710000102030405060708090a0b0c0d0e0f");
        assert_eq!(Attachment::from_bytes(&bytes), Ok(attachment));
        for length in (0..33).chain([34, 500]) {
            let mut other = bytes.to_vec();
            other.resize(length, 0);
            assert_eq!(Attachment::from_bytes(&other), Err(AttachmentError::Length(length)));
        }
        let mut other = bytes;
        other[16] = 17;
        assert_eq!(Attachment::from_bytes(&other), Err(AttachmentError::Gid(17)));
    }

    #[test]
    fn a_publishers_token_contains_its_node_and_type() {
        let [token, _] = tokens("/front_left");
        let publisher = Publisher::read(&token).expect("a token");
        assert_eq!(
            (publisher.node.as_str(), publisher.dds_type_name, publisher.type_hash),
            ("/front_left/mr_damper", OF.dds_type_name, OF.type_hash)
        );
        assert_eq!(Publisher::read(&tokens("/")[0]).expect("a token").node, "/mr_damper");
        assert_eq!(Publisher::read("@ros2_lv/70/1/2/3/MP/%/%/mr_damper"), None);

        let all = zenoh::key_expr::KeyExpr::new(node("/").publishers("/front_left/force_estimate"));
        let all = all.expect("a key expression");
        let found = |token: &str| all.intersects(&zenoh::key_expr::KeyExpr::new(token).expect("a key"));
        assert!(found(&token) && !found(&tokens("/")[0]) && !found(&tokens("/front_left")[1]));
    }
}
