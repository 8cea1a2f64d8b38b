//! Detects panics in threads of the middlewares. No code of this project joins these threads, and without them the node
//! looks alive but receives nothing. The first panic is noted, so that the node ends and names the thread.

use std::panic::{set_hook, take_hook};
use std::sync::{Once, OnceLock};

/// Start of the names of middleware threads: RustDDS' event loop and discovery, Zenoh's runtimes.
const MIDDLEWARES: [&str; 6] = ["RustDDS", "app-", "acc-", "net-", "rx-", "tx-"];

/// The name of the first middleware thread that panicked.
static FIRST: OnceLock<String> = OnceLock::new();

/// Notes panics from now on, in addition to the present panic hook. Repeated calls have no effect.
pub fn watch() {
    static WATCHING: Once = Once::new();
    WATCHING.call_once(|| {
        let before = take_hook();
        set_hook(Box::new(move |panic| {
            before(panic);
            let thread = std::thread::current();
            if let Some(name) = thread.name().filter(|name| is_of_middleware(name)) {
                // Only the first is kept: it is the cause, later ones are consequences.
                let _ = FIRST.set(name.to_owned());
            }
        }));
    });
}

/// The name of a middleware thread that has panicked since [`watch`], if any.
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
    fn middleware_threads_are_distinguished_from_the_nodes_own() {
        for name in ["RustDDS Participant 0 event loop", "RustDDS discovery thread", "rx-0", "app-12"] {
            assert!(is_of_middleware(name), "{name}");
        }
        for name in ["ros-source", "estimating", "zenoh-mirror", "close-loop", "main"] {
            assert!(!is_of_middleware(name), "{name}");
        }
    }
}
