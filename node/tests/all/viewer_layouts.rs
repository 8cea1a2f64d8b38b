//! The layouts for PlotJuggler and Foxglove: every plotted line is a field of a message on a topic of the node.

use mr_damper_msgs::MESSAGES;
use mr_damper_node::streams::sink::zenoh::Topic;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

fn layout(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../launch-configs/viewers").join(name);
    std::fs::read_to_string(path).expect("it is in the repository")
}

/// True if the message on `/topic` has a numeric or Boolean field called `field`.
fn is_there(topic: &str, field: &str) -> bool {
    let wanted = topic.strip_prefix('/').expect("topics have their full names");
    let of_node = Topic::ALL.into_iter().find(|topic| topic.name() == wanted).and_then(Topic::ros_type);
    let message = MESSAGES.iter().find(|message| Some(message.type_name) == of_node);
    // The message's own definition is the part before the nested types.
    let own = message.map_or("", |message| message.definition).split("\n===").next().unwrap_or_default();
    own.lines().any(|line| {
        let mut words = line.split_whitespace();
        let kind = words.next().unwrap_or_default();
        ["float64", "bool", "uint8", "uint32"].contains(&kind) && words.next() == Some(field)
    })
}

#[test]
fn plotjuggler_plots_only_existing_fields() {
    let text = layout("plotjuggler.xml");
    let mut drawn = BTreeSet::new();
    for attribute in ["<curve name=\"", " curve_x=\"", " curve_y=\""] {
        let values = text.split(attribute).skip(1).filter_map(|rest| rest.split('"').next());
        // An XY curve, made of two others, has a name without a slash.
        drawn.extend(values.filter(|value| value.starts_with('/')));
    }
    assert!(drawn.len() > 12, "{drawn:?}");
    for curve in drawn {
        let (topic, field) = curve.rsplit_once('/').expect("topic and field");
        assert!(is_there(topic, field), "{curve}");
    }
}

#[test]
fn foxglove_plots_only_existing_fields_in_existing_panels() {
    let layout: Value = serde_json::from_str(&layout("foxglove.json")).expect("JSON");
    let panels = layout["configById"].as_object().expect("panels by their names");
    let mut drawn = BTreeSet::new();
    for panel in panels.values() {
        let paths = panel["paths"].as_array().map_or(&[][..], Vec::as_slice);
        let values = paths.iter().chain([&panel["xAxisPath"]]).filter_map(|path| path["value"].as_str());
        drawn.extend(values.map(str::to_owned));
    }
    assert!(drawn.len() > 12, "{drawn:?}");
    for path in drawn {
        let (topic, field) = path.split_once('.').expect("topic and field");
        assert!(is_there(topic, field), "{path}");
    }
    let mut placed = BTreeSet::new();
    let mut rest = vec![&layout["layout"]];
    while let Some(place) = rest.pop() {
        match place.as_str() {
            Some(panel) => assert!(placed.insert(panel.to_owned()), "{panel} is placed twice"),
            None => rest.extend([&place["first"], &place["second"]]),
        }
    }
    assert_eq!(placed, panels.keys().cloned().collect(), "every panel is placed");
}
