//! Command-line flags generated from the parameter table.

use super::table::groups;
use super::{ParameterKind, TABLE, Value};
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};

/// Parameters that were given as flags, in the order of the table.
#[derive(Debug, Clone, Default)]
pub struct ParameterFlags {
    /// Name and value of each.
    pub given: Vec<(&'static str, Value)>,
}

impl FromArgMatches for ParameterFlags {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut flags = Self::default();
        flags.update_from_arg_matches(matches)?;
        Ok(flags)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        for parameter in TABLE.iter() {
            if let Some(texts) = matches.get_many::<String>(parameter.name) {
                let values: Vec<Value> = texts.map(|text| Value::parse(text)).collect();
                self.given.push((parameter.name, joined(values)));
            }
        }
        Ok(())
    }
}

/// The value of a flag. If the flag of a list is given several times, the items are joined.
fn joined(mut values: Vec<Value>) -> Value {
    if values.len() == 1 {
        return values.remove(0);
    }
    let items = values.into_iter().flat_map(|value| match value {
        Value::TextList(items) => items,
        Value::Text(text) => vec![text],
        other => vec![other.to_string()],
    });
    Value::TextList(items.collect())
}

impl Args for ParameterFlags {
    fn augment_args(command: Command) -> Command {
        groups().fold(command, |command, group| {
            let heading: &'static str = Box::leak(format!("Parameters: {group}").into_boxed_str());
            let members = TABLE.iter().filter(|parameter| parameter.group() == group);
            members.fold(command, |command, parameter| {
                let flag: &'static str = Box::leak(parameter.flag().into_boxed_str());
                // The items of a list may be given one by one.
                let action = match parameter.kind {
                    ParameterKind::TextList => ArgAction::Append,
                    _ => ArgAction::Set,
                };
                command.arg(
                    Arg::new(parameter.name)
                        .action(action)
                        .long(flag)
                        .value_name("VALUE")
                        .allow_hyphen_values(true)
                        .help_heading(heading)
                        .help(parameter.help()),
                )
            })
        })
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

/// The same flags for a command that takes the arguments of `node`: its help does not repeat their list.
#[derive(Debug, Clone, Default)]
pub struct UnlistedParameterFlags(pub ParameterFlags);

impl FromArgMatches for UnlistedParameterFlags {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        ParameterFlags::from_arg_matches(matches).map(Self)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        self.0.update_from_arg_matches(matches)
    }
}

impl Args for UnlistedParameterFlags {
    fn augment_args(command: Command) -> Command {
        let command = ParameterFlags::augment_args(command);
        TABLE
            .iter()
            .fold(command, |command, parameter| command.mut_arg(parameter.name, |flag| flag.hide(true)))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_may_be_given_item_by_item_or_as_a_whole() {
        let given = |args: &[&str]| {
            let command = ParameterFlags::augment_args(Command::new("node"));
            let matches = command.try_get_matches_from(["node"].iter().chain(args)).expect("good flags");
            ParameterFlags::from_arg_matches(&matches).expect("good flags").given
        };
        let list = |items: &[&str]| Value::TextList(items.iter().map(|item| (*item).to_owned()).collect());
        for (args, value) in [
            (&["--map", "displacement=A.B"][..], Value::Text("displacement=A.B".to_owned())),
            (
                &["--map", "displacement=A.B,sign=-1", "--map", "coil_current=C"],
                list(&["displacement=A.B,sign=-1", "coil_current=C"]),
            ),
            (&["--map", "[displacement=A.B, coil_current=C]"], list(&["displacement=A.B", "coil_current=C"])),
        ] {
            assert_eq!(given(args), [("can.map", value)], "{args:?}");
        }
        assert_eq!(given(&["--can", "can0", "--dbc", "car.dbc"]).len(), 2);
    }
}
