//! Command-line flags generated from the parameter table.

use super::table::groups;
use super::{TABLE, Value};
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};

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
            if let Some(text) = matches.get_one::<String>(parameter.name) {
                self.given.push((parameter.name, Value::parse(text)));
            }
        }
        Ok(())
    }
}

impl Args for ParameterFlags {
    fn augment_args(command: Command) -> Command {
        groups().fold(command, |command, group| {
            let heading: &'static str = Box::leak(format!("Parameters: {group}").into_boxed_str());
            let members = TABLE.iter().filter(|parameter| parameter.group() == group);
            members.fold(command, |command, parameter| {
                let flag: &'static str = Box::leak(parameter.flag().into_boxed_str());
                command.arg(
                    Arg::new(parameter.name)
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
