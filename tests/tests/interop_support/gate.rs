//! Decides which tests run at the same time, and reports their outcomes.

use super::Lab;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};
use std::sync::{PoisonError, RwLock};

/// Prints a line that the test runner does not capture.
pub(crate) fn say(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// Every running test reads this; a test that must run alone writes it.
static RUNNING: RwLock<()> = RwLock::new(());

/// Runs an interop test in a new lab, at the same time as others. `body` returns the text to print.
///
/// The tests are ignored by default, so that `cargo test` needs neither Python nor ROS. A test that is run, but whose requirement is
/// missing, fails.
pub(crate) fn interop(name: &str, body: impl FnOnce(&Lab) -> Outcome) {
    let _together = RUNNING.read().unwrap_or_else(PoisonError::into_inner);
    in_a_lab(name, body);
}

/// Like [`interop`], for a test that runs alone: it measures delays of milliseconds, or it loads the machine so much that others
/// could fail. `.ci/run` lists these tests, to run them after the others.
pub(crate) fn interop_alone(name: &str, body: impl FnOnce(&Lab) -> Outcome) {
    let _alone = RUNNING.write().unwrap_or_else(PoisonError::into_inner);
    in_a_lab(name, body);
}

fn in_a_lab(name: &str, body: impl FnOnce(&Lab) -> Outcome) {
    let lab = Lab::new();
    match catch_unwind(AssertUnwindSafe(|| body(&lab))) {
        Ok(Outcome::Passed(figures)) => {
            say(&format!("interop ok {name}: {figures}"));
            record("passed", name);
        }
        Ok(Outcome::DoesNotApply(why)) => {
            say(&format!("interop does not apply, {name}: {why}"));
            record("skipped", name);
        }
        Ok(Outcome::Missing(why)) => {
            record("failed", name);
            panic!("interop test {name} lacks what it needs: {why}");
        }
        Err(panic) => {
            say(&format!("interop FAILED {name}"));
            // Captured by the test runner, which prints it again with the failure at the end.
            eprint!("{}", lab.logs());
            record("failed", name);
            resume_unwind(panic);
        }
    }
}

/// Outcome of a test that did not panic.
pub(crate) enum Outcome {
    /// The test passed; the text is printed.
    Passed(String),
    /// Something that the test needs is missing.
    Missing(String),
    /// The test is for another build of the binary under test.
    DoesNotApply(String),
}

/// Appends to the results file that `.ci/run` counts.
fn record(outcome: &str, name: &str) {
    if let Ok(path) = std::env::var("MR_DAMPER_INTEROP_RESULTS") {
        let file = std::fs::OpenOptions::new().create(true).append(true).open(&path);
        // One write, because tests append at the same time.
        let line = format!("{outcome} {name}\n");
        let written = file.and_then(|mut file| file.write_all(line.as_bytes()));
        written.unwrap_or_else(|error| panic!("MR_DAMPER_INTEROP_RESULTS={path}: {error}"));
    }
}

/// The `mr-damper` binary: `MR_DAMPER_BIN`, or the release build in this test's target directory.
pub(crate) fn binary() -> PathBuf {
    built("MR_DAMPER_BIN", "mr-damper", "cargo build --release")
}

/// The echo: `MR_DAMPER_ECHO`, or the release build in this test's target directory.
pub(crate) fn echo_binary() -> PathBuf {
    built("MR_DAMPER_ECHO", "echo_peer", "cargo build --release --workspace --bins")
}

/// The peer under faults: `MR_DAMPER_FAULT_PEER`, or the release build in this test's target directory.
pub(crate) fn fault_peer_binary() -> PathBuf {
    built("MR_DAMPER_FAULT_PEER", "fault_peer", "cargo build --release --workspace --bins")
}

/// The ECU for tests of failing readers: `MR_DAMPER_ECU_PEER`, or the release build in this test's target directory.
pub(crate) fn ecu_peer_binary() -> PathBuf {
    built("MR_DAMPER_ECU_PEER", "ecu_peer", "cargo build --release --workspace --bins")
}

/// An `mr-damper` with the feature `security`: `MR_DAMPER_SECURE_BIN`, or target/secure/release/mr-damper.
pub(crate) fn secure_binary() -> Result<PathBuf, String> {
    let beside = || target().join("secure/release/mr-damper");
    let path = std::env::var_os("MR_DAMPER_SECURE_BIN").map_or_else(beside, PathBuf::from);
    if path.is_file() {
        Ok(path)
    } else {
        Err(format!(
            "{} is missing; build it with `cargo build --release --features security --target-dir target/secure`, or name \
             another in MR_DAMPER_SECURE_BIN",
            path.display()
        ))
    }
}

/// An `mr-damper` of the hardened build: `MR_DAMPER_HARDENED_BIN`.
pub(crate) fn hardened_binary() -> Result<PathBuf, String> {
    let path = std::env::var_os("MR_DAMPER_HARDENED_BIN").map(PathBuf::from).unwrap_or_default();
    if path.is_file() {
        assert!(is_hardened(&path), "MR_DAMPER_HARDENED_BIN: {} is a default build", path.display());
        Ok(path)
    } else {
        Err(format!(
            "MR_DAMPER_HARDENED_BIN does not name a file ({:?}); `node/hardened/build build --release --bins` builds \
             target/hardened/release/mr-damper",
            path.display()
        ))
    }
}

/// True if an `mr-damper` is a hardened build, according to its version text.
fn is_hardened(binary: &Path) -> bool {
    let version = std::process::Command::new(binary).arg("--version").output();
    let version = version.unwrap_or_else(|error| panic!("{} --version: {error}", binary.display()));
    String::from_utf8_lossy(&version.stdout).contains("hardened")
}

/// The reason to skip a test of faults that the default build does not survive; `None` if the binary under test is a default
/// build.
pub(crate) fn survives() -> Option<Outcome> {
    let why =
        "the binary under test is a hardened build, which survives this: see interop_faults/hardened.rs";
    is_hardened(&binary()).then(|| Outcome::DoesNotApply(why.to_owned()))
}

/// An `mr-damper` with the feature `security` and the edits of node/hardened: `MR_DAMPER_HARDENED_SECURE_BIN`.
pub(crate) fn hardened_secure_binary() -> Result<PathBuf, String> {
    let path = std::env::var_os("MR_DAMPER_HARDENED_SECURE_BIN").map(PathBuf::from).ok_or(
        "MR_DAMPER_HARDENED_SECURE_BIN is not set; `node/hardened/build build -p mr-damper-node -p \
         mr-damper-tests --bins --features mr-damper-node/security` builds it",
    )?;
    assert!(path.is_file(), "{} is missing; MR_DAMPER_HARDENED_SECURE_BIN names it", path.display());
    Ok(path)
}

/// The directory of an optional part of tests/interop/setup.sh.
pub(crate) fn optional_environment(part: &str) -> Result<PathBuf, String> {
    let path = environments().join(part);
    if path.join("stamp").is_file() {
        Ok(path)
    } else {
        Err(format!("{} is not prepared; run tests/interop/setup.sh {part}", path.display()))
    }
}

fn environments() -> PathBuf {
    std::env::var_os("MR_DAMPER_INTEROP_DIR")
        .map_or_else(|| PathBuf::from("/var/tmp/mr-damper-interop"), PathBuf::from)
}

/// An example of the node, built in this test's target directory.
pub(crate) fn example(name: &str) -> PathBuf {
    let me = std::env::current_exe().expect("the path of this test");
    let path = me
        .ancestors()
        .nth(2)
        .expect("a test is two levels inside its profile's directory")
        .join("examples")
        .join(name);
    assert!(
        path.is_file(),
        "{} is missing; build it with `cargo build --workspace --examples`",
        path.display()
    );
    path
}

fn built(variable: &str, file: &str, how: &str) -> PathBuf {
    let path = std::env::var_os(variable).map_or_else(|| target().join("release").join(file), PathBuf::from);
    assert!(
        path.is_file(),
        "{} is missing; build it with `{how}`, or set {variable} to another file",
        path.display()
    );
    path
}

/// The target directory of this test's build: the test is TARGET/PROFILE/deps/interop-HASH.
fn target() -> PathBuf {
    let me = std::env::current_exe().expect("the path of this test");
    me.ancestors().nth(3).expect("a test is three levels inside the target directory").to_owned()
}

/// The directory of a part prepared by tests/interop/setup.sh.
pub(crate) fn environment(part: &str) -> PathBuf {
    optional_environment(part).unwrap_or_else(|why| panic!("{why}"))
}

/// Measured runs, if they exist on this machine: `MR_DAMPER_DATA`, or shared/data next to the repository.
pub(crate) fn data(set: &str) -> Result<PathBuf, String> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let path = std::env::var_os("MR_DAMPER_DATA").map_or(beside, PathBuf::from).join(set);
    if path.is_dir() {
        Ok(path)
    } else {
        Err(format!("no measured runs in {}; set MR_DAMPER_DATA to their folder", path.display()))
    }
}

/// True if the long tests are requested: `MR_DAMPER_LONG=1`.
pub(crate) fn long() -> bool {
    std::env::var("MR_DAMPER_LONG").as_deref() == Ok("1")
}
