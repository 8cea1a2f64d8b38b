//! Effect of jittering stamps and lost samples on estimates: changes of mode, error, and its ratio to the
//! error with exact stamps.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example jitter -- [--raw] [--steps] [--seed N]
//!     --steps   a stepped current instead of a sine
//!     --raw     models without the low-pass on displacement
//!     --seed N  seed of jitter, losses and noise (default 1)
//! ```

#[path = "../tests/all/jitter_support/mod.rs"]
mod jitter_support;

use jitter_support::{Case, Current, Jitter, Loss, Truth, models, outcome, samples};
use mr_damper_model::condition::Conditioning;
use mr_damper_model::pipeline::Settings;

fn main() {
    let mut words = std::env::args().skip_while(|word| word != "--seed").skip(1);
    let seed = words.next().map_or(1, |word| word.parse().expect("--seed takes a number"));
    let raw = std::env::args().any(|word| word == "--raw");
    let current = if std::env::args().any(|word| word == "--steps") { Current::Steps } else { Current::Sine };
    let conditioning = if raw { Conditioning::default() } else { Conditioning::THESIS };
    println!(
        "rate  jitter            stamps      channels    arrive    loss           changes    RMS N  ratio  worst N  VALID"
    );
    for rate_hz in [100.0, 200.0, 500.0, 512.0, 1000.0, 2000.0] {
        let both = models(rate_hz, current, conditioning);
        let clean =
            outcome(both, Settings::default(), &samples(&Case { rate_hz, current, seed, ..Case::CLEAN }));
        println!(
            "{rate_hz:4} clean: {:.2} N, worst {:.1} N, {:.3} valid",
            clean.rms_n, clean.worst_n, clean.valid
        );
        for jitter in [
            Jitter::None,
            Jitter::Uniform(0.2),
            Jitter::Uniform(0.5),
            Jitter::Normal(0.2),
            Jitter::Publisher(0.1),
        ] {
            for truth in [Truth::ReadOnTime, Truth::ReadAtStamp] {
                for (shared, by_stamp) in [(true, true), (false, true), (false, false)] {
                    for loss in [Loss::Each(0.0), Loss::Each(0.02), Loss::All(0.02), Loss::Bursts(5)] {
                        let case = Case { rate_hz, current, jitter, truth, shared, loss, by_stamp, seed };
                        let got = outcome(both, Settings::default(), &samples(&case));
                        println!(
                            "{rate_hz:4}  {:<16}  {:<11} {:<11} {:<9} {:<13} {:7} {:9.2} {:6.2} {:8.1} {:6.3} {:8.2}",
                            format!("{jitter:?}"),
                            format!("{truth:?}"),
                            if shared { "shared" } else { "independent" },
                            if by_stamp { "by stamp" } else { "in order" },
                            format!("{loss:?}"),
                            got.changes,
                            got.rms_n,
                            got.rms_n / clean.rms_n,
                            got.worst_n,
                            got.valid,
                            got.valid_rms_n,
                        );
                    }
                }
            }
        }
    }
}
