//! Numbers of `tests/oracles/oracles.py`, which computes them with numpy, scipy and scikit-fuzzy from the published equations.

/// The numbers called `name`.
pub(crate) fn numbers(name: &str) -> Vec<f64> {
    let line =
        include_str!("numbers.txt").lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    let line =
        line.unwrap_or_else(|| panic!("numbers.txt has no {name}; run tests/oracles/oracles.py again"));
    line.split(' ').map(|number| number.parse().expect("a number")).collect()
}

/// Fails if `found` differs from the numbers called `name` by more than `tolerance` of their size or of one.
#[track_caller]
pub(crate) fn agrees(name: &str, found: &[f64], tolerance: f64) {
    let expected = numbers(name);
    assert_eq!(found.len(), expected.len(), "{name}");
    for (j, (found, expected)) in found.iter().zip(expected).enumerate() {
        // A difference that is not a number fails.
        let close = (found - expected).abs() <= tolerance * expected.abs().max(1.0);
        assert!(close, "{name}[{j}]: {found}, but the oracle gives {expected}");
    }
}
