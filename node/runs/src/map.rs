//! Sources of the channels of a run if topics or columns have other names: `--map`.
//!
//! ```text
//! CHANNEL=TOPIC[:JOINT or AXIS][,sign=-1][,offset=0.01][,unit=mm]     in bags
//! CHANNEL=COLUMN[,sign=-1][,offset=0.01][,unit=mm]                    in CSV files
//! ```
//!
//! A channel has the name of the node's input topic (`displacement`, `measured_force`, ...) or of the column (`force_n`). Its
//! value is `sign * (raw - offset)`, with raw value and offset in SI, as with the node's parameters `<input>.sign` and
//! `<input>.offset`. All channels without a mapping are read by their names.

mod column_mapping;

pub use column_mapping::ColumnMapping;

use super::column::Quantity;
use super::names::{TOPICS, topic_of};
use super::unit::{self, TIME, TimeUnit, Unit, all_names};
use crate::extract::calibrated;
use mr_damper_base::shown::ALIKE;
use std::fmt;
use std::str::FromStr;

/// Name of the time channel of CSV files.
const TIME_CHANNEL: &str = "time";

/// One channel and its source. `Display` writes the form that `FromStr` parses.
#[derive(Debug, Clone, PartialEq)]
pub struct Mapping {
    pub(super) channel: Channel,
    /// A topic of a bag, with joint or axis after a colon, or a column of a CSV file.
    pub(super) source: String,
    /// True for sign -1.
    pub(super) negative: bool,
    /// Offset in SI, subtracted from the raw value before the sign is applied.
    pub(super) offset: f64,
}

/// A channel, and the unit that was given for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Channel {
    Time(Option<TimeUnit>),
    Known(Quantity, Option<Unit>),
}

/// The conversion of a channel's raw values.
#[derive(Debug, Clone, Copy)]
pub(super) struct Convert {
    pub(super) to_si: fn(f64) -> f64,
    pub(super) sign: f64,
    pub(super) offset: f64,
}

impl Convert {
    /// The conversion by the unit only.
    pub(super) const fn plain(to_si: fn(f64) -> f64) -> Self {
        Self { to_si, sign: 1.0, offset: 0.0 }
    }

    /// Converts a raw value.
    pub(super) fn apply(&self, raw: f64) -> f64 {
        calibrated((self.to_si)(raw), self.sign, self.offset)
    }
}

/// Why a text is not a valid mapping.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MapError {
    /// The `=` is missing, or nothing follows it.
    #[error(
        "`{text}` is not a mapping; write CHANNEL=TOPIC or CHANNEL=COLUMN, as in displacement=/fl/susp/pos,unit=mm"
    )]
    Form {
        /// The text as given.
        text: String,
    },
    /// A column was not given as name and header.
    #[error("`{text}` is not a column; write NAME=HEADER, as in displacement_in=x_in")]
    ColumnForm {
        /// The text as given.
        text: String,
    },
    /// The name of a column is not in the run format.
    #[error("`{name}` is not a name of the run format; names are {}", all_names())]
    ColumnName {
        /// The text as given.
        name: String,
    },
    /// Unknown channel.
    #[error(
        "`{name}` is not a channel{} Channels are {}",
        nearest.map_or_else(|| ".".to_owned(), |nearest| format!("; did you mean {nearest}?")),
        channel_names()
    )]
    Channel {
        /// The text as given.
        name: String,
        /// The channel with the most similar name.
        nearest: Option<&'static str>,
    },
    /// Unknown option.
    #[error("`{text}` is not an option of a mapping; options are sign=-1, offset=NUMBER and unit=UNIT")]
    Option {
        /// The text as given.
        text: String,
    },
    /// An option was given twice.
    #[error("{option} is given twice for one channel; leave one of them out")]
    TwoOptions {
        /// The option.
        option: &'static str,
    },
    /// The sign is neither 1 nor -1.
    #[error("sign is `{value}`, but must be 1 or -1")]
    Sign {
        /// The text as given.
        value: String,
    },
    /// The offset is not a number.
    #[error(
        "offset is `{value}`, but must be a finite number in {unit}, which is subtracted from the reading before the sign is applied"
    )]
    Offset {
        /// The text as given.
        value: String,
        /// The channel's SI unit.
        unit: &'static str,
    },
    /// The unit is unknown, or belongs to another quantity.
    #[error("unit `{name}` does not fit {channel}, which is a {quantity}; units that fit are {fitting}")]
    Unit {
        /// The text as given.
        name: String,
        /// The channel.
        channel: &'static str,
        /// Its quantity.
        quantity: String,
        /// The units that fit.
        fitting: String,
    },
    /// Time was given a sign or an offset.
    #[error("time has a unit, but neither sign nor offset: leave out `{text}`")]
    TimeOption {
        /// The text as given.
        text: String,
    },
    /// A channel was mapped twice.
    #[error("{channel} is mapped twice, to `{first}` and to `{second}`; leave one of them out")]
    Twice {
        /// The channel.
        channel: &'static str,
        /// The first source.
        first: String,
        /// The second source.
        second: String,
    },
}

/// The names of the channels, for messages.
fn channel_names() -> String {
    let names: Vec<_> = Quantity::ALL.into_iter().map(topic_of).collect();
    format!("{}, and {TIME_CHANNEL} in CSV files", names.join(", "))
}

impl Channel {
    /// The channel with this name, which is the name of a topic or of an SI column.
    fn named(name: &str) -> Result<Self, MapError> {
        if name == TIME_CHANNEL || name == "time_s" {
            return Ok(Self::Time(None));
        }
        let by_name = |quantity: &Quantity| topic_of(*quantity) == name || quantity.si_name() == name;
        match Quantity::ALL.into_iter().find(by_name) {
            Some(quantity) => Ok(Self::Known(quantity, None)),
            None => Err(MapError::Channel { name: name.to_owned(), nearest: nearest_channel(name) }),
        }
    }

    /// Its name in maps.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Time(_) => TIME_CHANNEL,
            Self::Known(quantity, _) => topic_of(quantity),
        }
    }

    fn unit_name(self) -> Option<&'static str> {
        match self {
            Self::Time(unit) => unit.map(|unit| unit.name),
            Self::Known(_, unit) => unit.map(|unit| unit.name),
        }
    }

    /// The unit in which offsets are given.
    fn si_unit(self) -> &'static str {
        match self {
            Self::Time(_) => TIME[0].name,
            Self::Known(quantity, _) => unit::of(quantity.dimension())[0].name,
        }
    }

    /// The same channel with a unit.
    fn in_unit(self, name: &str) -> Result<Self, MapError> {
        let (found, quantity, fitting) = match self {
            Self::Time(_) => {
                let fitting: Vec<_> = TIME.iter().map(|unit| unit.name).collect();
                (TimeUnit::named(name).map(|unit| Self::Time(Some(unit))), "time".to_owned(), fitting)
            }
            Self::Known(quantity, _) => {
                let dimension = quantity.dimension();
                let fitting = unit::of(dimension).iter().map(|unit| unit.name).collect();
                let found = Unit::named(dimension, name).map(|unit| Self::Known(quantity, Some(unit)));
                (found, dimension.to_string(), fitting)
            }
        };
        found.ok_or_else(|| MapError::Unit {
            name: name.to_owned(),
            channel: self.name(),
            quantity,
            fitting: fitting.join(", "),
        })
    }
}

/// The channel that has the name most similar to `name`.
fn nearest_channel(name: &str) -> Option<&'static str> {
    let name = name.to_ascii_lowercase();
    let likeness = |quantity: &Quantity| {
        let of = |known: &str| strsim::jaro_winkler(known, &name);
        // `force` is more similar to `force_request` than to `measured_force`, and most similar to `force_n`.
        of(topic_of(*quantity)).max(of(quantity.si_name()))
    };
    let nearest = Quantity::ALL.into_iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
    nearest.filter(|nearest| likeness(nearest) >= ALIKE).map(topic_of)
}

/// Why a file of mappings cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MapFileError {
    /// It is not TOML.
    #[error(transparent)]
    Toml(#[from] toml::de::Error),
    /// It has no mappings.
    #[error("there is no table [map] in it, as in: [map] displacement = \"/fl/susp/pos,unit=mm\"")]
    NoTable,
    /// The value of a channel is not a text.
    #[error(
        "map.{channel} is {value}, but must be a text, as in {channel} = \"/fl/susp/pos,sign=-1,unit=mm\""
    )]
    NotText {
        /// The channel.
        channel: String,
        /// The value, as TOML.
        value: String,
    },
    /// The text of a channel is not a valid mapping.
    #[error("map.{channel}: {error}")]
    Mapping {
        /// The channel.
        channel: String,
        /// The fault of the text.
        error: MapError,
    },
    /// The mappings do not fit together.
    #[error(transparent)]
    Map(#[from] MapError),
}

impl FromStr for Mapping {
    type Err = MapError;

    fn from_str(text: &str) -> Result<Self, MapError> {
        let form = || MapError::Form { text: text.to_owned() };
        let (channel, rest) = text.split_once('=').ok_or_else(form)?;
        let mut mapping = Self {
            channel: Channel::named(channel.trim())?,
            source: String::new(),
            negative: false,
            offset: 0.0,
        };
        let mut parts = rest.split(',').peekable();
        let mut source = parts.next().unwrap_or_default().to_owned();
        // The name of a column may contain commas, the name of a topic may not.
        while let Some(more) = parts.next_if(|part| !source.starts_with('/') && !part.contains('=')) {
            source = format!("{source},{more}");
        }
        mapping.source = source.trim().to_owned();
        if mapping.source.is_empty() {
            return Err(form());
        }
        let mut given: Vec<&'static str> = Vec::new();
        for part in parts {
            let option = mapping.take(part.trim())?;
            if given.contains(&option) {
                return Err(MapError::TwoOptions { option });
            }
            given.push(option);
        }
        Ok(mapping)
    }
}

impl Mapping {
    /// Applies an option and returns its name.
    fn take(&mut self, text: &str) -> Result<&'static str, MapError> {
        let no_option = || MapError::Option { text: text.to_owned() };
        let (name, value) = text.split_once('=').ok_or_else(no_option)?;
        let (name, value) = (name.trim(), value.trim());
        if matches!((self.channel, name), (Channel::Time(_), "sign" | "offset")) {
            return Err(MapError::TimeOption { text: text.to_owned() });
        }
        match name {
            "sign" => {
                self.negative = match value {
                    "1" | "+1" => false,
                    "-1" => true,
                    _ => return Err(MapError::Sign { value: value.to_owned() }),
                };
                Ok("sign")
            }
            "offset" => {
                let offset = value.parse().ok().filter(|offset: &f64| offset.is_finite());
                self.offset = offset.ok_or_else(|| MapError::Offset {
                    value: value.to_owned(),
                    unit: self.channel.si_unit(),
                })?;
                Ok("offset")
            }
            "unit" => {
                self.channel = self.channel.in_unit(value)?;
                Ok("unit")
            }
            _ => Err(no_option()),
        }
    }

    /// True if the sign of the values is changed.
    pub(super) const fn is_negative(&self) -> bool {
        self.negative
    }

    /// The topic, and its joint or axis, if the source is a topic.
    pub(super) fn topic(&self) -> Option<(&str, Option<&str>)> {
        self.source.starts_with('/').then(|| match self.source.split_once(':') {
            Some((topic, part)) => (topic, Some(part)),
            None => (self.source.as_str(), None),
        })
    }

    /// The conversion of its raw values; `unit` is used if the mapping names no unit.
    pub(super) fn convert(&self, unit: fn(f64) -> f64) -> Convert {
        let to_si = match self.channel {
            Channel::Known(_, Some(unit)) => unit.to_si,
            _ => unit,
        };
        Convert { to_si, sign: if self.negative { -1.0 } else { 1.0 }, offset: self.offset }
    }
}

impl fmt::Display for Mapping {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.channel.name(), self.source)?;
        if self.negative {
            f.write_str(",sign=-1")?;
        }
        if self.offset != 0.0 {
            write!(f, ",offset={}", self.offset)?;
        }
        match self.channel.unit_name() {
            Some(unit) => write!(f, ",unit={unit}"),
            None => Ok(()),
        }
    }
}

/// The sources of the channels of a run; each channel has at most one.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Map(Vec<Mapping>);

impl Map {
    /// A map with these mappings.
    ///
    /// # Errors
    /// [`MapError::Twice`] if a channel has two sources.
    pub fn new(mappings: Vec<Mapping>) -> Result<Self, MapError> {
        for (index, mapping) in mappings.iter().enumerate() {
            let channel = mapping.channel.name();
            if let Some(first) = mappings[..index].iter().find(|other| other.channel.name() == channel) {
                let (first, second) = (first.source.clone(), mapping.source.clone());
                return Err(MapError::Twice { channel, first, second });
            }
        }
        Ok(Self(mappings))
    }

    /// Reads the table `[map]` of a TOML text, with lines such as `displacement = "/fl/susp/pos,sign=-1,unit=mm"`. Other
    /// tables are ignored.
    ///
    /// # Errors
    /// When the text is not valid TOML, does not have that table, or the table holds an invalid mapping.
    pub fn from_toml(text: &str) -> Result<Self, MapFileError> {
        let whole: toml::Table = toml::from_str(text)?;
        let Some(toml::Value::Table(table)) = whole.get("map") else { return Err(MapFileError::NoTable) };
        let mut mappings = Vec::with_capacity(table.len());
        for (channel, value) in table {
            let Some(source) = value.as_str() else {
                return Err(MapFileError::NotText { channel: channel.clone(), value: value.to_string() });
            };
            let mapping: Mapping = format!("{channel}={source}")
                .parse()
                .map_err(|error| MapFileError::Mapping { channel: channel.clone(), error })?;
            mappings.push(mapping);
        }
        Ok(Self::new(mappings)?)
    }

    /// This map with all mappings of `other`, which replace mappings of the same channels.
    #[must_use]
    pub fn overridden_by(mut self, other: Self) -> Self {
        self.0.retain(|mapping| other.0.iter().all(|over| over.channel.name() != mapping.channel.name()));
        self.0.extend(other.0);
        self
    }

    /// The mapping of a quantity.
    pub(super) fn of(&self, quantity: Quantity) -> Option<&Mapping> {
        self.0.iter().find(|mapping| matches!(mapping.channel, Channel::Known(known, _) if known == quantity))
    }

    /// The mapping of time.
    pub(super) fn of_time(&self) -> Option<&Mapping> {
        self.0.iter().find(|mapping| matches!(mapping.channel, Channel::Time(_)))
    }

    /// All mappings.
    pub(super) fn all(&self) -> &[Mapping] {
        &self.0
    }
}

/// The flag that maps a channel to a source, for advice: `--map displacement=/fl/susp/pos`.
pub(super) fn flag(channel: &str, source: &str) -> String {
    let mapping = format!("{channel}={source}");
    let plain = |c: char| c.is_ascii_alphanumeric() || "=/_-.:,".contains(c);
    if mapping.chars().all(plain) { format!("--map {mapping}") } else { format!("--map '{mapping}'") }
}

const _: () = assert!(TOPICS.len() + 1 == Quantity::ALL.len(), "each quantity but the set point has a topic");

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &str) -> Mapping {
        text.parse().unwrap_or_else(|error| panic!("{text}: {error}"))
    }

    fn refused(text: &str) -> String {
        text.parse::<Mapping>().expect_err(text).to_string()
    }

    #[test]
    fn mappings_are_parsed() {
        let mapping = parse("displacement=/joint_states:fl_damper,sign=-1,offset=0.01,unit=mm");
        assert_eq!(mapping.topic(), Some(("/joint_states", Some("fl_damper"))));
        assert_eq!((mapping.negative, mapping.offset), (true, 0.01));
        assert_eq!(mapping.channel.unit_name(), Some("mm"));
        // The value is sign * (raw in SI - offset): raw 30 mm, offset 10 mm.
        assert_eq!(mapping.convert(|raw| raw).apply(30.0), -(0.030 - 0.01));
        assert_eq!(parse("force_n=/wrench:z"), parse("measured_force=/wrench:z"));
        let column = parse("measured_force = Load, left [kN] , unit = KN");
        assert_eq!((column.source.as_str(), column.topic()), ("Load, left [kN]", None));
        assert_eq!(column.to_string(), "measured_force=Load, left [kN],unit=kN");
        assert_eq!(parse("time=t,unit=ms").to_string(), "time=t,unit=ms");
        assert_eq!(parse("displacement=/a,sign=+1,offset=0").to_string(), "displacement=/a");
    }

    #[test]
    fn invalid_mappings_are_refused_with_advice() {
        for (text, why) in [
            (
                "/fl/susp/pos",
                "write CHANNEL=TOPIC or CHANNEL=COLUMN, as in displacement=/fl/susp/pos,unit=mm",
            ),
            ("displacement=", "`displacement=` is not a mapping"),
            ("displacement=,sign=-1", "is not a mapping"),
            (
                "displacment=/x",
                "`displacment` is not a channel; did you mean displacement? Channels are displacement, velocity",
            ),
            ("force=/x", "did you mean measured_force?"),
            ("current=/x", "did you mean coil_current?"),
            (
                "displacement=/x,mm",
                "`mm` is not an option of a mapping; options are sign=-1, offset=NUMBER and unit=UNIT",
            ),
            ("displacement=/x,sgn=-1", "`sgn=-1` is not an option"),
            ("displacement=/x,sign=2", "sign is `2`, but must be 1 or -1"),
            ("displacement=/x,offset=nan", "offset is `nan`, but must be a finite number in m"),
            ("measured_force=/x,offset=", "must be a finite number in N"),
            (
                "displacement=/x,unit=deg",
                "unit `deg` does not fit displacement, which is a length; units that fit are m, cm, mm, um, in",
            ),
            ("displacement=/x,unit=kN", "unit `kN` does not fit displacement"),
            ("case_temperature=/x,unit=mm", "which is a temperature; units that fit are C, F, K"),
            ("displacement=/x,unit=mm,unit=m", "unit is given twice"),
            ("time=t,sign=-1", "time has a unit, but neither sign nor offset: leave out `sign=-1`"),
            ("time=t,unit=mm", "which is a time; units that fit are s, ms, us, ns"),
        ] {
            let message = refused(text);
            assert!(message.contains(why), "{text}: {message}");
        }
        let twice = Map::new(vec![parse("displacement=/a"), parse("displacement_m=/b")]).expect_err("twice");
        assert_eq!(
            twice.to_string(),
            "displacement is mapped twice, to `/a` and to `/b`; leave one of them out"
        );
    }

    #[test]
    fn a_file_holds_the_same_mappings_and_flags_override_it() {
        let file = Map::from_toml(
            "[machine.ranges]\ncoil_lag = [0, 1]\n[map]\ndisplacement = \"/a,sign=-1\"\nforce_n = \"/w:x,unit=kN\"\n",
        )
        .expect("a good file");
        assert_eq!(file.all(), [parse("displacement=/a,sign=-1"), parse("measured_force=/w:x,unit=kN")]);
        let flags = Map::new(vec![parse("displacement=/b")]).expect("distinct");
        let both = file.overridden_by(flags);
        assert_eq!(both.all(), [parse("measured_force=/w:x,unit=kN"), parse("displacement=/b")]);
        for (text, why) in [
            ("displacement = \"/a\"", "there is no table [map]"),
            ("[map]\ndisplacement = 1", "map.displacement is 1, but must be a text"),
            ("[map]\ndisplacment = \"/a\"", "map.displacment: `displacment` is not a channel"),
            ("[map]\ndisplacement = \"/a\"\ndisplacement_m = \"/b\"", "displacement is mapped twice"),
            ("[map", "line 1"),
        ] {
            let message = Map::from_toml(text).expect_err(text).to_string();
            assert!(message.contains(why), "{text}: {message}");
        }
    }

    fn source() -> impl Strategy<Value = String> {
        prop_oneof![
            "/[a-z_]{1,8}(/[a-z_0-9]{1,8}){0,3}(:[a-zA-Z_0-9-]{1,10})?",
            "[A-Za-z][A-Za-z0-9 _.;\\[\\]()°]{0,12}[a-z)](, ?[A-Za-z]{1,5})?",
        ]
    }

    fn mapping() -> impl Strategy<Value = Mapping> {
        let options =
            (any::<bool>(), prop::num::f64::NORMAL | prop::num::f64::ZERO, any::<prop::sample::Index>());
        (0..=Quantity::ALL.len(), source(), options).prop_map(
            |(channel, source, (negative, offset, unit))| {
                let Some(&quantity) = Quantity::ALL.get(channel) else {
                    let unit = TIME.get(unit.index(TIME.len() + 1)).copied();
                    return Mapping { channel: Channel::Time(unit), source, negative: false, offset: 0.0 };
                };
                let units = unit::of(quantity.dimension());
                let unit = units.get(unit.index(units.len() + 1)).copied();
                Mapping { channel: Channel::Known(quantity, unit), source, negative, offset }
            },
        )
    }

    proptest! {
        #[test]
        fn displayed_mappings_are_parsed_back(mapping in mapping()) {
            let text = mapping.to_string();
            prop_assert_eq!(text.parse::<Mapping>(), Ok(mapping.clone()), "{}", text);
            // The same in a file, where the text is everything after the first equals sign.
            let (channel, rest) = text.split_once('=').expect("one");
            let mut table = toml::Table::new();
            table.insert(channel.to_owned(), rest.into());
            let file = toml::Table::from_iter([("map".to_owned(), table.into())]).to_string();
            prop_assert_eq!(Map::from_toml(&file), Ok(Map(vec![mapping])));
        }

        #[test]
        fn no_text_panics(text in ".{0,60}", options in "(,(sign|offset|unit)=.{0,5}){0,3}") {
            let _ = text.parse::<Mapping>();
            let _ = format!("displacement=/x{options}").parse::<Mapping>();
        }
    }
}
