//! Finds dampers: every namespace in which `force_estimate` is published is a damper.

use mr_damper_msgs::{ForceEstimate, Message};

/// The topic that identifies a damper.
pub const MARKER_TOPIC: &str = "force_estimate";

/// Namespaces of the dampers in the namespace `root` or below it, sorted. `published` contains the full names of the published topics
/// with their DDS types. The namespace `/` is returned as an empty string.
#[must_use]
pub fn namespaces(published: impl IntoIterator<Item = (String, String)>, root: &str) -> Vec<String> {
    let root = root.trim_end_matches('/');
    let mut found: Vec<String> = published
        .into_iter()
        .filter(|(_, of_type)| of_type == ForceEstimate::DDS_TYPE)
        .filter_map(|(topic, _)| Some(topic.strip_suffix(MARKER_TOPIC)?.strip_suffix('/')?.to_owned()))
        .filter(|namespace| {
            namespace.strip_prefix(root).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
        })
        .collect();
    found.sort();
    found.dedup();
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dampers_are_found_in_a_namespace_and_below_it() {
        let of = |topic: &str, of_type: &str| (topic.to_owned(), of_type.to_owned());
        let published = || {
            [
                "/force_estimate",
                "/car/rear/force_estimate",
                "/car/front/force_estimate",
                "/cart/force_estimate",
            ]
            .map(|topic| of(topic, ForceEstimate::DDS_TYPE))
            .into_iter()
            .chain([of("/other/force_estimate", "std_msgs::msg::dds_::Float64_")])
            .chain([of("/car/front/force_estimate", ForceEstimate::DDS_TYPE)])
        };
        assert_eq!(namespaces(published(), "/car"), ["/car/front", "/car/rear"]);
        assert_eq!(namespaces(published(), "/"), ["", "/car/front", "/car/rear", "/cart"]);
        assert_eq!(namespaces(published(), "/bike"), [""; 0]);
    }
}
