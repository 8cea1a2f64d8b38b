//! Panics in threads of the middlewares. Nobody here joins those, and without them the node looks alive and hears nothing: the
//! first is noted, so that the node ends and says which.

use std::panic::{set_hook, take_hook};
use std::sync::{Once, OnceLock};

/// What the names of their threads begin with: RustDDS' event loop and discovery, Zenoh's runtimes.
const MIDDLEWARES: [&str; 6] = ["RustDDS", "app-", "acc-", "net-", "rx-", "tx-"];

/// The name of the first such thread that panicked.
static FIRST: OnceLock<String> = OnceLock::new();

/// From now on a panic is noted, beside whatever is done on one already. More calls than one do no more.
pub fn watch() {
    static WATCHING: Once = Once::new();
    WATCHING.call_once(|| {
        let before = take_hook();
        set_hook(Box::new(move |panic| {
            before(panic);
            let thread = std::thread::current();
            if let Some(name) = thread.name().filter(|name| is_of_middleware(name)) {
                // The first says what went wrong; more follow from it.
                let _ = FIRST.set(name.to_owned());
            }
        }));
    });
}

/// The name of a middleware's thread that has panicked since [`watch`], if one has.
#[must_use]
pub fn of_middleware() -> Option<&'static str> {
    FIRST.get().map(String::as_str)
}

fn is_of_middleware(thread: &str) -> bool {
    MIDDLEWARES.iter().any(|begin| thread.starts_with(begin))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_of_middlewares_are_told_from_ours() {
        for name in ["RustDDS Participant 0 event loop", "RustDDS discovery thread", "rx-0", "app-12"] {
            assert!(is_of_middleware(name), "{name}");
        }
        for name in ["ros-source", "estimating", "zenoh-mirror", "close-loop", "main"] {
            assert!(!is_of_middleware(name), "{name}");
        }
    }
}
