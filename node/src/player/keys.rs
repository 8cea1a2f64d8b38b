//! The keyboard while a run plays.

use crate::interrupt::Interrupt;
use ratatui::crossterm::event::{Event, KeyCode, KeyModifiers, poll, read};
use ratatui::crossterm::terminal::{disable_raw_mode, enable_raw_mode};
use std::cell::Cell;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// The keyboard, when there is one: space pauses and resumes, q and Ctrl-C end.
pub struct Keys {
    last_look: Cell<Instant>,
}

impl Keys {
    /// Spacing of looks at the keyboard: a system call a sample would be too many.
    const LOOK_EVERY: Duration = Duration::from_millis(50);

    /// Puts the terminal into raw mode, if there is one on both ends.
    #[must_use]
    pub fn start(quiet: bool) -> Option<Self> {
        let terminal = !quiet && std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
        (terminal && enable_raw_mode().is_ok()).then(|| Self { last_look: Cell::new(Instant::now()) })
    }

    /// Looks at the keyboard; while paused, waits. Returns how long the pause was.
    pub(super) fn wait_while_paused(&self, interrupt: &Interrupt) -> Duration {
        if self.last_look.get().elapsed() < Self::LOOK_EVERY {
            return Duration::ZERO;
        }
        self.last_look.set(Instant::now());
        let start = Instant::now();
        let mut paused = false;
        loop {
            match Self::pressed(if paused { Self::LOOK_EVERY } else { Duration::ZERO }) {
                Some(Key::Pause) => paused = !paused,
                Some(Key::End) => interrupt.raise(),
                None if !paused => break,
                None => {}
            }
            if interrupt.is_raised() {
                break;
            }
        }
        start.elapsed()
    }

    /// The next key that means something, waiting for at most `timeout`.
    fn pressed(timeout: Duration) -> Option<Key> {
        let Ok(true) = poll(timeout) else { return None };
        let Ok(Event::Key(key)) = read() else { return None };
        match key.code {
            KeyCode::Char(' ') => Some(Key::Pause),
            KeyCode::Char('q') | KeyCode::Esc => Some(Key::End),
            // Raw mode takes Ctrl-C away from the signal handler.
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => Some(Key::End),
            _ => None,
        }
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        // Nothing can be done about a terminal that is gone.
        let _ = disable_raw_mode();
    }
}

/// What a key means.
enum Key {
    Pause,
    End,
}
