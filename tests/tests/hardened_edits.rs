//! The edits of the hardened build and its script: each edit applies to the source versions that Cargo.lock names, and the script
//! explains why an edit does not apply.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// `node/hardened/build --apply` with the edits of a directory, or with the repository's own.
fn apply(target: &Path, edits: Option<&Path>) -> Output {
    let mut command = Command::new(repository().join("node/hardened/build"));
    command.arg("--apply").env("CARGO_TARGET_DIR", target);
    if let Some(edits) = edits {
        command.env("MR_DAMPER_HARDENED_EDITS", edits);
    }
    command.output().expect("the script starts: it needs Python 3.11")
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn every_edit_applies_and_the_repositorys_lock_is_unchanged() {
    let target = tempfile::tempdir().expect("a temporary directory");
    let lock = || std::fs::read(repository().join("Cargo.lock")).expect("Cargo.lock");
    let before = lock();
    let applied = apply(target.path(), None);
    assert!(
        applied.status.success(),
        "an edit of node/hardened/edits no longer applies:\n{}",
        said(&applied)
    );
    assert_eq!(lock(), before);
    // A second run writes nothing, so that cargo rebuilds nothing.
    let fragment = target.path().join("hardened/src/rustdds-0.15.1/src/rtps/fragment_assembler.rs");
    let written = || fragment.metadata().and_then(|file| file.modified()).expect("an edited file");
    let first = written();
    assert!(apply(target.path(), None).status.success());
    assert_eq!(written(), first);
}

#[test]
fn an_edit_that_does_not_apply_is_named_with_its_place_and_advice() {
    let edit = |version: &str, edits: &str| {
        format!(
            "crate = \"rustdds\"\nversion = \"{version}\"\nwhy = \"\"\ndecision = \"0011\"\nupstream = \"\"\n{edits}"
        )
    };
    let change = |anchor: &str, text: &str| {
        format!("[[edit]]\nfile = \"src/lib.rs\"\nanchor = \"{anchor}\"\nreplace = \"{text}\"\n")
    };
    let cases = [
        (
            edit("0.15.1", &change("no such text", "neither is this")),
            ["occurs 0 times in src/lib.rs", "move the anchor"],
        ),
        (edit("0.15.1", &change("no such text", "mod network;")), ["src/lib.rs", "unnecessary. Delete it"]),
        (edit("0.15.1", &change("mod ", "module ")), ["times in src/lib.rs", "Make the anchor longer"]),
        (edit("0.1.0", &change("mod network;", "")), ["is for rustdds 0.1.0", "--check"]),
        (
            edit("0.15.1", &(change("mod network;", "") + &change("\\nmod network;\\n", ""))),
            ["overlap in src/lib.rs", "one edit"],
        ),
        (
            edit("0.15.1", "[[edit]]\nfile = \"src/lib.rs\"\nanchor = \"x\"\n"),
            ["[[edit]] 1", "replace, before, after"],
        ),
        (edit("0.15.1", "") + "misspelt = 1\n", ["misspelt", "an edit has"]),
    ];
    for (text, words) in cases {
        let edits = tempfile::tempdir().expect("a temporary directory");
        std::fs::write(edits.path().join("10-tried.toml"), &text).expect("written");
        let refused = apply(edits.path(), Some(edits.path()));
        assert_eq!(refused.status.code(), Some(1), "{text}");
        let said = said(&refused);
        assert!(said.contains("10-tried"), "{said}");
        assert!(words.iter().all(|word| said.contains(word)), "{words:?} in: {said}");
        assert!(!said.contains("Traceback"), "{said}");
    }
}
