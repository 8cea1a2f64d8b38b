//! Suggestions for `--map` if a bag or CSV file has other names: the topic or column that a channel could come from.

use super::column::Quantity;
use super::map::flag;
use super::names::topic_of;
use super::unit::{TimeUnit, Unit};
use crate::extract::{CarriesValue, DEFAULT_AXIS, Dimension, Extractor, MessagePart};
use mr_damper_base::shown::count;
use mr_damper_msgs::standard::JointState;
use std::fmt::Write as _;

/// Maximum number of topics that a message lists.
const LISTED: usize = 30;

/// A topic that was found in a bag.
pub(super) struct FoundTopic<'a> {
    pub(super) name: &'a str,
    pub(super) type_name: &'a str,
    pub(super) encoding: &'a str,
    pub(super) messages: u64,
    /// The first message of joint states.
    pub(super) joints: Option<&'a JointState>,
}

/// A signal or channel that was found in a log of a bus.
#[derive(Debug, Clone)]
pub(super) struct FoundSignal {
    /// Its name in a map.
    pub(super) source: String,
    /// Its unit, as the DBC file or the log names it; empty if it names none.
    pub(super) unit: String,
    /// Number of frames of its message, or of its values.
    pub(super) frames: u64,
    /// The number of its group in an MDF4 file.
    pub(super) group: usize,
}

/// Parts of names that indicate the topic or column of a channel, the likeliest first.
const fn words(quantity: Quantity) -> &'static [&'static str] {
    match quantity {
        Quantity::Displacement => &["displ", "susp", "stroke", "lvdt", "pos", "travel", "damper", "rod"],
        Quantity::Velocity | Quantity::BodyVelocity => &["vel", "speed"],
        Quantity::Force | Quantity::ForceRequest => &["force", "load", "wrench", "effort"],
        Quantity::Current => &["current", "coil", "amp"],
        Quantity::Command => &["volt", "command", "cmd"],
        Quantity::CaseTemperature | Quantity::AmbientTemperature => &["temp"],
        Quantity::Setpoint => &["setpoint", "target"],
    }
}

/// How likely a name belongs to the channel; 0 if no word matches.
fn likeness(quantity: Quantity, name: &str) -> usize {
    let name = name.to_ascii_lowercase();
    let words = words(quantity);
    words.iter().position(|word| name.contains(word)).map_or(0, |place| words.len() - place)
}

impl FoundTopic<'_> {
    /// How likely this topic holds the channel, and the source for a map; `None` if its type cannot hold the channel.
    fn source(&self, quantity: Quantity) -> Option<(usize, String)> {
        let dimension = quantity.dimension();
        if self.messages == 0 || self.encoding != "cdr" || !dimension.takes(self.type_name) {
            return None;
        }
        let Some(joints) = self.joints else {
            let extractor = Extractor::new(dimension, self.name, self.type_name, None).ok()?;
            // A plain number may be any quantity, so its name has to decide.
            let kind = if extractor.is_unstamped() { 1 } else { 20 };
            let axis = if matches!(extractor.part, MessagePart::Axis(_)) {
                format!(":{DEFAULT_AXIS}")
            } else {
                String::new()
            };
            return Some((kind + likeness(quantity, self.name), format!("{}{axis}", self.name)));
        };
        let joint = |joint: &String| {
            let extractor = Extractor::new(dimension, self.name, self.type_name, Some(joint)).ok()?;
            joints.taken(&extractor.part).ok()?.value?;
            // An effort is most likely a force. The name of a joint belongs to a damper if it has a word for displacement.
            let likely = match quantity.dimension() {
                Dimension::Current | Dimension::Voltage => likeness(quantity, joint),
                Dimension::Length if likeness(quantity, joint) > 0 => 21 + likeness(quantity, joint),
                _ => 10 + likeness(quantity, joint) + likeness(Quantity::Displacement, joint),
            };
            Some((likely, format!("{}:{joint}", self.name)))
        };
        // Among equally likely joints the first is used.
        joints.name.iter().filter_map(joint).rev().max_by_key(|(likely, _)| *likely)
    }

    fn line(&self, quantity: Quantity) -> String {
        let mark = if self.source(quantity).is_some() { '*' } else { ' ' };
        let mut line =
            format!("  {mark} {}  {}, {}", self.name, self.type_name, count(self.messages, "message"));
        if let Some(joints) = self.joints {
            let _ = write!(line, ", joints: {}", joints.name.join(", "));
        }
        printable(&line)
    }
}

/// The flag that maps the channel to the likeliest topic; `None` if no topic's type can hold the channel.
pub(super) fn line_for(quantity: Quantity, topics: &[FoundTopic<'_>]) -> Option<String> {
    likeliest(quantity, topics, 0)
}

/// The same, but only if type or name indicate this channel.
pub(super) fn likely_line_for(quantity: Quantity, topics: &[FoundTopic<'_>]) -> Option<String> {
    likeliest(quantity, topics, 2)
}

fn likeliest(quantity: Quantity, topics: &[FoundTopic<'_>], least: usize) -> Option<String> {
    let sources = topics.iter().filter_map(|topic| topic.source(quantity));
    let best = sources.filter(|(likely, _)| *likely >= least).rev().max_by_key(|(likely, _)| *likely);
    best.map(|(_, source)| printable(&flag(topic_of(quantity), &source)))
}

/// The topics, one per line. Topics that can hold the channel come first and are marked.
pub(super) fn listing(quantity: Quantity, topics: &[FoundTopic<'_>]) -> String {
    let mut sorted: Vec<&FoundTopic<'_>> = topics.iter().collect();
    sorted.sort_by_key(|topic| topic.source(quantity).is_none());
    let mut text = format!("topics (* can hold {}):", topic_of(quantity));
    for topic in sorted.iter().take(LISTED) {
        let _ = write!(text, "\n{}", topic.line(quantity));
    }
    if sorted.len() > LISTED {
        let _ = write!(text, "\n    and {} more", sorted.len() - LISTED);
    }
    text
}

impl FoundSignal {
    /// How likely this signal holds the channel: its unit must fit, or be missing, and the name decides.
    fn likely(&self, quantity: Quantity) -> Option<usize> {
        let fits = Unit::named(quantity.dimension(), &self.unit).is_some();
        let likeness = likeness(quantity, &self.source);
        match (fits, self.unit.is_empty()) {
            (true, _) => Some(1 + 2 * likeness),
            (false, true) if likeness > 0 => Some(likeness),
            _ => None,
        }
    }

    fn line(&self, quantity: Quantity) -> String {
        let mark = if self.likely(quantity).is_some() { '*' } else { ' ' };
        let unit = if self.unit.is_empty() { "no unit" } else { &self.unit };
        printable(&format!("  {mark} {}  {unit}, {}", self.source, count(self.frames, "sample")))
    }
}

/// The flag that maps the channel to the likeliest signal; `None` if no signal has a fitting unit or name. A signal without unit gets
/// a placeholder for it.
pub(super) fn signal_line_for(quantity: Quantity, found: &[FoundSignal]) -> Option<String> {
    likeliest_signal(quantity, found, 1)
}

/// The same, but only if the name indicates this channel.
pub(super) fn likely_signal_line_for(quantity: Quantity, found: &[FoundSignal]) -> Option<String> {
    likeliest_signal(quantity, found, 2)
}

fn likeliest_signal(quantity: Quantity, found: &[FoundSignal], least: usize) -> Option<String> {
    let likely = found.iter().filter_map(|signal| Some((signal.likely(quantity)?, signal)));
    let (_, best) = likely.filter(|(likely, _)| *likely >= least).rev().max_by_key(|(likely, _)| *likely)?;
    let unit = if best.unit.is_empty() { ",unit=UNIT" } else { "" };
    Some(printable(&flag(topic_of(quantity), &format!("{}{unit}", best.source))))
}

/// The signals, one per line. Signals that can hold the channel come first and are marked.
pub(super) fn signal_listing(quantity: Quantity, found: &[FoundSignal]) -> String {
    let mut sorted: Vec<&FoundSignal> = found.iter().collect();
    sorted.sort_by_key(|signal| signal.likely(quantity).is_none());
    let mut text = format!("signals of the log (* can hold {}):", topic_of(quantity));
    for signal in sorted.iter().take(LISTED) {
        let _ = write!(text, "\n{}", signal.line(quantity));
    }
    if sorted.len() > LISTED {
        let _ = write!(text, "\n    and {} more", sorted.len() - LISTED);
    }
    text
}

/// The flag that maps a quantity, or without one the time, to the likeliest of these columns; `None` if no name or unit fits.
pub(super) fn column_for<'a>(
    quantity: Option<Quantity>,
    columns: impl Iterator<Item = &'a str>,
) -> Option<String> {
    let likely = |column: &'a str| {
        let likely = quantity.map_or_else(|| likely_time(column), |quantity| likely_column(quantity, column));
        Some((likely?, column))
    };
    let columns: Vec<(usize, &str)> = columns.filter_map(likely).collect();
    let (_, best) = columns.into_iter().rev().max_by_key(|(likely, _)| *likely)?;
    Some(printable(&flag(quantity.map_or("time", topic_of), best)))
}

/// How likely a column holds the quantity: its unit must fit, or be missing, and the name decides.
fn likely_column(quantity: Quantity, column: &str) -> Option<usize> {
    let likeness = likeness(quantity, column);
    let has_unit = Unit::is_in_column(column) || TimeUnit::in_column(column).is_some();
    match Unit::in_column(quantity.dimension(), column) {
        Some(_) => Some(1 + 2 * likeness),
        None if likeness > 0 && !has_unit => Some(likeness),
        None => None,
    }
}

/// How likely a column holds the time.
fn likely_time(column: &str) -> Option<usize> {
    let name = column.to_ascii_lowercase();
    let is_named = name == "t" || ["time", "stamp"].iter().any(|word| name.contains(word));
    let likely = 2 * usize::from(is_named) + usize::from(TimeUnit::in_column(column).is_some());
    // `v_m_s` ends in `_s`.
    (likely > 0 && !Unit::is_in_column(column)).then_some(likely)
}

/// The name among `known` that is most similar to `name`; `None` if none is similar enough.
pub(super) fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let compared: String = name.chars().take(200).collect();
    known
        .take(1000)
        .filter(|known| known.len() <= 400)
        .map(|known| (strsim::jaro_winkler(known, &compared), known))
        .filter(|(likeness, _)| *likeness > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, known)| known)
}

/// Text of a file with its control characters escaped, so that they cannot control a terminal.
fn printable(text: &str) -> String {
    text.chars().flat_map(|c| if c.is_control() { c.escape_default().collect() } else { vec![c] }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen<'a>(name: &'a str, type_name: &'a str, joints: Option<&'a JointState>) -> FoundTopic<'a> {
        FoundTopic { name, type_name, encoding: "cdr", messages: 5, joints }
    }

    #[test]
    fn the_likeliest_topic_is_suggested() {
        let joints = JointState {
            name: ["wheel", "fl_damper", "fr_damper"].map(str::to_owned).into(),
            position: vec![0.0; 3],
            ..JointState::default()
        };
        let float = "std_msgs/msg/Float64";
        let topics = [
            seen("/oil", float, None),
            seen("/susp/pos", float, None),
            seen("/joint_states", "sensor_msgs/msg/JointState", Some(&joints)),
            seen("/wrench", "geometry_msgs/msg/WrenchStamped", None),
            seen("/i\u{1b}mu", "sensor_msgs/msg/Imu", None),
        ];
        let line = |quantity, of: &[FoundTopic<'_>]| line_for(quantity, of).unwrap_or_default();
        assert_eq!(line(Quantity::Displacement, &topics), "--map displacement=/joint_states:fl_damper");
        assert_eq!(line(Quantity::Displacement, &topics[..2]), "--map displacement=/susp/pos");
        // The joints have no efforts.
        assert_eq!(line(Quantity::Force, &topics), "--map measured_force=/wrench:z");
        assert_eq!(likely_line_for(Quantity::Current, &topics), None);
        assert_eq!(line_for(Quantity::Displacement, &topics[4..]), None);
        assert_eq!(
            listing(Quantity::Displacement, &topics),
            "topics (* can hold displacement):\n  * /oil  std_msgs/msg/Float64, 5 messages\n  * /susp/pos  \
             std_msgs/msg/Float64, 5 messages\n  * /joint_states  sensor_msgs/msg/JointState, 5 messages, joints: wheel, \
             fl_damper, fr_damper\n    /wrench  geometry_msgs/msg/WrenchStamped, 5 messages\n    /i\\u{1b}mu  \
             sensor_msgs/msg/Imu, 5 messages"
        );
    }

    #[test]
    fn the_likeliest_signal_is_suggested() {
        let signal = |source: &str, unit: &str| FoundSignal {
            source: source.into(),
            unit: unit.into(),
            frames: 500,
            group: 0,
        };
        let found = [
            signal("ENGINE.Speed", "rpm"),
            signal("DASH.Trip", "m"),
            signal("SUSP_FL.Position", "mm"),
            signal("SUSP_FL.Load", "kN"),
            signal("SUSP_FL.Coil", ""),
        ];
        let line = |quantity| signal_line_for(quantity, &found);
        assert_eq!(line(Quantity::Displacement).as_deref(), Some("--map displacement=SUSP_FL.Position"));
        assert_eq!(line(Quantity::Force).as_deref(), Some("--map measured_force=SUSP_FL.Load"));
        assert_eq!(line(Quantity::Current).as_deref(), Some("--map coil_current=SUSP_FL.Coil,unit=UNIT"));
        assert_eq!(line(Quantity::CaseTemperature), None);
        assert_eq!(likely_signal_line_for(Quantity::Displacement, &found[1..2]), None);
        assert_eq!(
            signal_listing(Quantity::Displacement, &found[..3]),
            "signals of the log (* can hold displacement):\n  * DASH.Trip  m, 500 samples\n  * SUSP_FL.Position  mm, 500 \
             samples\n    ENGINE.Speed  rpm, 500 samples"
        );
    }

    #[test]
    fn the_likeliest_column_is_suggested() {
        let columns = ["Time [s]", "load", "Stroke [mm]"];
        let suggested = |quantity| column_for(quantity, columns.into_iter()).unwrap_or_default();
        assert_eq!(suggested(Some(Quantity::Displacement)), "--map 'displacement=Stroke [mm]'");
        assert_eq!(suggested(None), "--map 'time=Time [s]'");
        // Neither a name nor a unit fits, or the unit is that of another quantity.
        for unfit in ["load", "B", "damper_kn", "pos_m_s", "damper temp [C]"] {
            assert_eq!(column_for(Some(Quantity::Displacement), [unfit].into_iter()), None, "{unfit}");
        }
        for (unfit, fit) in [("v_m_s", "t"), ("x", "t_ms"), ("index", "Stamp")] {
            assert_eq!(column_for(None, [unfit].into_iter()), None, "{unfit}");
            assert_eq!(column_for(None, [unfit, fit].into_iter()), Some(format!("--map time={fit}")));
        }
        assert_eq!(nearest("/susp/pso", ["/oil", "/susp/pos"].into_iter()), Some("/susp/pos"));
        assert_eq!(nearest("x", ["/oil"].into_iter()), None);
    }
}
