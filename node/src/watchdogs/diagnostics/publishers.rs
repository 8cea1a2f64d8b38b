//! Inputs that have more than one publisher: the publishers, and advice.

use crate::ros2::graph::Writer;
use crate::ros2::participant::Domain;
use crate::streams::source::ros_source::SourceCounters;
use crate::streams::source::{InputTopic, Writers};
use std::collections::BTreeMap;
use std::time::Instant;

/// The publishers of an input that has more than one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Publishers {
    /// Full name of the topic.
    pub topic: String,
    /// Full names of their nodes, sorted. If the name of a node is not known, the publisher's GID.
    pub nodes: Vec<String>,
    /// True if their samples arrive mixed.
    pub mixed: bool,
    /// True if estimates are made from this input.
    pub is_estimated_from: bool,
}

impl Publishers {
    /// Finds the `inputs` with more than one publisher, from discovery and from the senders of the samples.
    #[must_use]
    pub fn of(inputs: &[InputTopic], domain: &Domain, source: &SourceCounters) -> Vec<Self> {
        let now = Instant::now();
        let crowded = |(input, writers): (&InputTopic, &Writers)| {
            let named = |writer: Writer| {
                let node = domain.node_of(&writer).or_else(|| source.name_of(&writer));
                (writer, node.unwrap_or_else(|| identity(&writer)))
            };
            let mut all: BTreeMap<Writer, String> = writers.mixed(now).map(named).collect();
            let mixed = !all.is_empty();
            if input.has_one_publisher {
                let listed = domain.publishers(&input.topic, input.dds_type_name);
                all.extend(writers.present(listed.into_iter().map(named).collect(), now));
            }
            let mut nodes: Vec<String> = all.into_values().collect();
            nodes.sort();
            let &InputTopic { is_estimated_from, .. } = input;
            (nodes.len() > 1).then(|| Self { topic: input.topic.clone(), nodes, mixed, is_estimated_from })
        };
        inputs.iter().zip(&source.writers()).filter_map(crowded).collect()
    }
}

/// Text for a publisher whose node is not known, with its GID as in `ros2 topic info --verbose`.
fn identity(writer: &Writer) -> String {
    let bytes: Vec<String> = writer.iter().map(|byte| format!("{byte:02x}")).collect();
    format!("a publisher without a node, GID {}", bytes.join("."))
}

/// The sentence about these publishers for log and status: who they are, the consequence, and advice.
#[must_use]
pub fn publishers_advice(of: &Publishers) -> String {
    let Publishers { topic, nodes, mixed, is_estimated_from } = of;
    let harm = match (mixed, is_estimated_from) {
        (true, true) => "and their samples arrive mixed, so estimates are DEGRADED",
        (true, false) => "and their samples arrive mixed",
        (false, _) => "but should have one",
    };
    format!(
        "{topic} has {} publishers ({}), {harm}: stop all but one, or remap one to another topic. A killed publisher stays \
         listed for up to a minute",
        nodes.len(),
        nodes.join(", "),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_publisher_without_a_node_is_named_by_its_gid() {
        let text = identity(&std::array::from_fn(|index| index as u8));
        assert_eq!(text, "a publisher without a node, GID 00.01.02.03.04.05.06.07.08.09.0a.0b.0c.0d.0e.0f");
    }
}
