//! Reads whether DDS-Security is requested, and with which files: from the environment and `--enclave`, as in any ROS 2
//! node.
//!
//! | variable | meaning |
//! |---|---|
//! | `ROS_SECURITY_ENABLE` | `true`: join the domain with security, or fail |
//! | `ROS_SECURITY_KEYSTORE` | directory created by `ros2 security create_keystore` |
//! | `ROS_SECURITY_ENCLAVE_OVERRIDE` | enclave; overrides `--enclave`; without both: `/` |
//! | `ROS_SECURITY_STRATEGY` | `Enforce` or `Permissive`: no difference here |
//!
//! In rcl, `Permissive` (its default) continues without security when files are missing. Here the node refuses to
//! start, because a user who requests security would not notice its absence. `docs/decisions/0004-dds-security.md`
//! lists the peers that it works with.

use crate::settings::error::NodeError;
use rustdds::DomainParticipantBuilder;
use std::path::{Path, PathBuf};

/// Files written by `ros2 security create_enclave` and read by RustDDS.
const FILES: [&str; 6] = [
    "identity_ca.cert.pem",
    "cert.pem",
    "key.pem",
    "permissions_ca.cert.pem",
    "governance.p7s",
    "permissions.p7s",
];

/// The message for a program built without the feature `security`.
const ABSENT: &str = "ROS_SECURITY_ENABLE is true, but this mr-damper was built without DDS-Security. Build one with \
                      `cargo build --release --features security` (needs libssl-dev), or set ROS_SECURITY_ENABLE=false \
                      to run without it";

/// The enclave named by the environment or `--enclave` (`argument`), with or without security.
#[must_use]
pub fn name_of_enclave(argument: Option<&str>) -> String {
    enclave_of(argument, |name| std::env::var(name).ok().filter(|text| !text.is_empty()))
}

fn enclave_of(argument: Option<&str>, variable: impl Fn(&str) -> Option<String>) -> String {
    variable("ROS_SECURITY_ENCLAVE_OVERRIDE")
        .or_else(|| argument.map(str::to_owned))
        .unwrap_or_else(|| "/".to_owned())
}

/// An existing enclave of a keystore: the identity of this process and its permissions.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Enclave {
    directory: PathBuf,
}

impl Enclave {
    /// The enclave requested by the environment and `--enclave` (`argument`); `None` if no security is requested.
    ///
    /// # Errors
    /// When security is requested but not compiled in, or the enclave lacks a file; when the settings contradict each
    /// other.
    pub fn asked_for(argument: Option<&str>) -> Result<Option<Self>, NodeError> {
        Self::asked_for_in(argument, |name| std::env::var(name).ok().filter(|text| !text.is_empty()))
    }

    fn asked_for_in(
        argument: Option<&str>,
        variable: impl Fn(&str) -> Option<String>,
    ) -> Result<Option<Self>, NodeError> {
        match (variable("ROS_SECURITY_ENABLE").as_deref(), argument) {
            (Some("true"), _) => {}
            (Some("false"), None) | (None, None) => return Ok(None),
            (Some("false"), Some(enclave)) => {
                tracing::warn!(enclave, "ROS_SECURITY_ENABLE is false: the enclave is not used");
                return Ok(None);
            }
            (None, Some(enclave)) => {
                return Err(refused(format!(
                    "--enclave {enclave} was given, but ROS_SECURITY_ENABLE is not set; set it to true, or to false to \
                     go without security"
                )));
            }
            (Some(other), _) => {
                return Err(refused(format!("ROS_SECURITY_ENABLE is \"{other}\"; it must be true or false")));
            }
        }
        if !cfg!(feature = "security") {
            return Err(refused(ABSENT.to_owned()));
        }
        let keystore = variable("ROS_SECURITY_KEYSTORE").ok_or_else(|| {
            refused(
                "ROS_SECURITY_ENABLE is true, but ROS_SECURITY_KEYSTORE is not set; name the directory that `ros2 security \
                 create_keystore` created"
                    .to_owned(),
            )
        })?;
        let name = enclave_of(argument, variable);
        Self::open(Path::new(&keystore), &name).map(Some)
    }

    fn open(keystore: &Path, name: &str) -> Result<Self, NodeError> {
        let Some(below) = name.strip_prefix('/').filter(|below| !below.split('/').any(|part| part == ".."))
        else {
            return Err(refused(format!(
                "\"{name}\" is not a valid enclave; enclave names look like /front_left"
            )));
        };
        let directory = keystore.join("enclaves").join(below);
        for file in FILES {
            let path = directory.join(file);
            if let Err(error) = std::fs::File::open(&path) {
                return Err(refused(format!(
                    "{}: {error}; create it with `ros2 security create_enclave {} {name}`. The node does not start without \
                     security, even if ROS_SECURITY_STRATEGY is Permissive",
                    path.display(),
                    keystore.display(),
                )));
            }
        }
        Ok(Self { directory })
    }

    /// Directory of the enclave's files.
    #[must_use]
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Makes the participant of `builder` authenticate itself and its peers with this enclave.
    ///
    /// # Errors
    /// In a program without the feature `security`.
    #[cfg(feature = "security")]
    pub fn secure(&self, builder: DomainParticipantBuilder) -> Result<DomainParticipantBuilder, NodeError> {
        // sros2 does not encrypt its private keys.
        let files = rustdds::DomainParticipantSecurityConfigFiles::with_ros_default_names(
            &self.directory,
            String::new(),
        );
        Ok(builder.builtin_security(files))
    }

    /// Returns an error, because this program is built without DDS-Security.
    ///
    /// # Errors
    /// Always.
    #[cfg(not(feature = "security"))]
    pub fn secure(&self, _: DomainParticipantBuilder) -> Result<DomainParticipantBuilder, NodeError> {
        Err(refused(ABSENT.to_owned()))
    }
}

fn refused(why: String) -> NodeError {
    NodeError::Ros { what: "DDS-Security".to_owned(), why }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The result when the environment is `variables` (NAME=VALUE) and `--enclave` is `argument`.
    fn requested(variables: &str, argument: Option<&str>) -> Result<Option<Enclave>, NodeError> {
        let all: Vec<(&str, &str)> = variables.split_whitespace().filter_map(|v| v.split_once('=')).collect();
        let of = |name: &str| all.iter().find(|(n, _)| *n == name).map(|(_, value)| (*value).to_owned());
        Enclave::asked_for_in(argument, |name| of(name.trim_start_matches("ROS_SECURITY_")))
    }

    fn message(variables: &str, argument: Option<&str>) -> String {
        requested(variables, argument).expect_err(variables).to_string()
    }

    #[test]
    fn security_is_off_unless_requested() {
        for (variables, argument) in [("", None), ("ENABLE=false", None), ("ENABLE=false", Some("/a"))] {
            assert_eq!(requested(variables, argument).expect("insecure"), None, "{variables}");
        }
    }

    #[test]
    fn incomplete_settings_are_refused() {
        for (variables, argument, says) in [
            ("", Some("/left"), "--enclave /left was given, but ROS_SECURITY_ENABLE is not set"),
            ("ENABLE=True", None, "\"True\"; it must be true or false"),
            ("ENABLE=1", Some("/left"), "\"1\"; it must be true or false"),
        ] {
            let message = message(variables, argument);
            assert!(message.contains(says), "{message}");
        }
    }

    #[cfg(not(feature = "security"))]
    #[test]
    fn security_that_is_not_compiled_in_is_refused() {
        for variables in ["ENABLE=true", "ENABLE=true STRATEGY=Permissive KEYSTORE=/tmp"] {
            let message = message(variables, None);
            assert!(message.contains("built without DDS-Security"), "{message}");
            assert!(message.contains("--features security"), "{message}");
        }
    }

    #[cfg(feature = "security")]
    #[test]
    fn an_enclave_must_have_all_its_files() {
        let keystore = tempfile::tempdir().expect("a temporary directory");
        let directory = keystore.path().join("enclaves/vehicle/left");
        std::fs::create_dir_all(&directory).expect("created");
        assert!(message("ENABLE=true", None).contains("ROS_SECURITY_KEYSTORE is not set"));
        let enabled = format!("ENABLE=true STRATEGY=Permissive KEYSTORE={}", keystore.path().display());
        for file in FILES {
            let message = message(&enabled, Some("/vehicle/left"));
            assert!(message.contains(&format!("left/{file}: No such file")), "{message}");
            std::fs::write(directory.join(file), "").expect("written");
        }
        let expected = Some(Enclave { directory });
        assert_eq!(requested(&enabled, Some("/vehicle/left")).expect("complete"), expected);
        let renamed = format!("{enabled} ENCLAVE_OVERRIDE=/vehicle/left");
        assert_eq!(requested(&renamed, Some("/right")).expect("complete"), expected);
        for name in ["left", "/../left"] {
            assert!(message(&enabled, Some(name)).contains("is not a valid enclave"), "{name}");
        }
    }
}
