//! The Rust constants equal the constants of the definitions, and every definition file is used.

use std::collections::BTreeMap;
use std::path::Path;

use mr_damper_msgs::standard::DiagnosticStatus;
use mr_damper_msgs::{
    CurrentCommand, ForceEstimate, LimitedBy, MESSAGES, Message, Mode, Reasons, Validity, msgdef,
};

type Constants = BTreeMap<String, (String, u32)>;

fn defined<M: Message>() -> Constants {
    let mut all = msgdef::parse_all(M::TYPE, M::DEFINITION).expect("readable");
    let constants = all.remove(M::TYPE).expect("itself").constants;
    let count = constants.len();
    let map: Constants = constants
        .into_iter()
        .map(|constant| (constant.name, (constant.type_name, constant.value.parse().expect("a number"))))
        .collect();
    assert_eq!(map.len(), count, "a constant is defined twice");
    map
}

fn constants<'a, V: Into<u32>>(
    prefix: &'a str,
    type_name: &'a str,
    values: impl IntoIterator<Item = (&'a str, V)>,
) -> Constants {
    values
        .into_iter()
        .map(|(name, value)| {
            (format!("{prefix}{}", name.to_uppercase()), (type_name.to_owned(), value.into()))
        })
        .collect()
}

#[test]
fn force_estimate() {
    let mut ours = constants("MODE_", "uint8", Mode::ALL.iter().map(|m| (m.name(), u8::from(*m))));
    ours.extend(constants("VALIDITY_", "uint8", Validity::ALL.iter().map(|v| (v.name(), u8::from(*v)))));
    ours.extend(constants("REASON_", "uint32", Reasons::ALL.iter().map(|(name, r)| (*name, r.bits()))));
    assert_eq!(ours, defined::<ForceEstimate>());
    assert_eq!(ours.len(), 5 + 5 + 23);
}

#[test]
fn reasons_are_one_bit_each() {
    let mut seen = 0;
    for (name, reason) in Reasons::ALL {
        assert_eq!(reason.bits().count_ones(), 1, "{name}");
        assert_eq!(seen & reason.bits(), 0, "{name} shares its bit");
        seen |= reason.bits();
    }
}

#[test]
fn current_command() {
    let ours = constants("LIMITED_BY_", "uint8", LimitedBy::ALL.iter().map(|l| (l.name(), u8::from(*l))));
    assert_eq!(ours, defined::<CurrentCommand>());
    assert_eq!(ours.len(), 7);
}

#[test]
fn diagnostic_status() {
    let levels = [
        ("ok", DiagnosticStatus::OK),
        ("warn", DiagnosticStatus::WARN),
        ("error", DiagnosticStatus::ERROR),
        ("stale", DiagnosticStatus::STALE),
    ];
    assert_eq!(constants("", "byte", levels), defined::<DiagnosticStatus>());
}

/// CMake builds every definition file, and every `.msg` file has a struct.
#[test]
fn every_definition_file_is_used() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let cmake = std::fs::read_to_string(root.join("CMakeLists.txt")).expect("CMakeLists.txt");
    let mut files = 0;
    for folder in ["msg", "srv", "action"] {
        for entry in std::fs::read_dir(root.join(folder)).expect(folder) {
            let name = entry.expect("entry").file_name().into_string().expect("UTF-8");
            assert!(
                cmake.contains(&format!("\"{folder}/{name}\"")),
                "{folder}/{name} is not in CMakeLists.txt"
            );
            if let Some(stem) = name.strip_suffix(".msg") {
                let type_name = format!("mr_damper_msgs/msg/{stem}");
                assert!(MESSAGES.iter().any(|m| m.type_name == type_name), "{type_name} has no struct");
            }
            files += 1;
        }
    }
    assert_eq!(
        files,
        cmake.matches(".msg\"").count()
            + cmake.matches(".srv\"").count()
            + cmake.matches(".action\"").count()
    );
    assert!(files >= 14);
}
