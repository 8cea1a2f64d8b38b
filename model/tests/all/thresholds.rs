//! The table of the diagnosis' thresholds.

use mr_damper_model::diagnose::{Part, Threshold, Thresholds};

#[test]
fn each_threshold_sets_its_own_field() {
    for row in Thresholds::TABLE {
        let mut changed = Thresholds::default();
        row.set(&mut changed, row.default);
        assert_eq!(changed, Thresholds::default(), "{}: the table and the defaults agree", row.name);
        for factor in [0.5, 2.0] {
            row.set(&mut changed, row.scaled(factor));
            let shown = format!("{}: {:?}", row.name, row.scaled(factor));
            let all = format!("{changed:?}");
            assert!(all.split(['{', ',', '}']).any(|field| field.trim() == shown), "{shown} is in {all}");
        }
    }
}

#[test]
fn the_guide_has_each_threshold_with_its_default_and_source() {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../node/docs/thresholds.md");
    let page = std::fs::read_to_string(page).expect("the page of the thresholds");
    let row = |row: &Threshold| format!("| `{}` | {} | {} |", row.name, row.default, row.source);
    let missing: Vec<String> = Thresholds::TABLE.iter().map(row).filter(|row| !page.contains(row)).collect();
    assert!(missing.is_empty(), "node/docs/thresholds.md lacks these rows:\n{}", missing.join("\n"));
    let parts = [Part::Effects, Part::Verdict, Part::Structures, Part::Pairs, Part::Terms];
    assert!(parts.iter().all(|part| Thresholds::TABLE.iter().any(|row| row.part == *part)));
}
