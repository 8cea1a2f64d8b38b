//! Advice for a residual alarm. Log, diagnostics and views give it in the same words.

/// Advice for a raised alarm, as the end of a sentence.
pub const ADVICE: &str = "find what the model lacks with `mr-damper close --live` (action close_loop) or with `mr-damper close` on recorded runs, and load the new model with load_model";
