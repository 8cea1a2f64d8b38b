//! Keyboard control while a run is played.

use super::Rate;
use super::control::Control;
use crate::settings::interrupt::Interrupt;
use ratatui::crossterm::event::{Event, KeyCode, KeyModifiers, poll, read};
use ratatui::crossterm::terminal::{disable_raw_mode, enable_raw_mode};
use std::cell::Cell;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// The keyboard of the terminal. Space pauses and resumes, right arrow or s plays one sample while paused, up and down
/// change the speed by a tenth, q and Ctrl-C end the replay.
pub struct Keys {
    last_look: Cell<Instant>,
}

impl Keys {
    /// Interval at which the keyboard is polled: one system call per sample would cost too much.
    const LOOK_EVERY: Duration = super::LOOK_EVERY;

    /// Puts the terminal into raw mode; `None` if stdin or stderr is not a terminal.
    #[must_use]
    pub fn start(quiet: bool) -> Option<Self> {
        let terminal = !quiet && std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
        (terminal && enable_raw_mode().is_ok()).then(|| Self { last_look: Cell::new(Instant::now()) })
    }

    /// Polls the keyboard and carries out the pressed keys.
    pub fn look(&self, control: &Control, interrupt: &Interrupt) {
        if self.last_look.get().elapsed() < Self::LOOK_EVERY {
            return;
        }
        self.last_look.set(Instant::now());
        while let Ok(true) = poll(Duration::ZERO) {
            match Self::pressed() {
                Some(Key::Pause) => control.toggle_paused(),
                Some(Key::Step) => control.nudge(),
                Some(Key::Speed(factor)) => {
                    if let Rate::Times(rate) = control.rate() {
                        control.set_rate(rate * factor);
                    }
                }
                Some(Key::End) => interrupt.raise(),
                None => {}
            }
        }
    }

    /// The pressed key, if it has a meaning.
    fn pressed() -> Option<Key> {
        let Ok(Event::Key(key)) = read() else { return None };
        match key.code {
            KeyCode::Char(' ') => Some(Key::Pause),
            KeyCode::Char('s') | KeyCode::Right => Some(Key::Step),
            KeyCode::Up => Some(Key::Speed(1.1)),
            KeyCode::Down => Some(Key::Speed(1.0 / 1.1)),
            KeyCode::Char('q') | KeyCode::Esc => Some(Key::End),
            // In raw mode, Ctrl-C does not reach the signal handler.
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => Some(Key::End),
            _ => None,
        }
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        // An error means that the terminal is lost; nothing can be done then.
        let _ = disable_raw_mode();
    }
}

/// Meaning of a key.
enum Key {
    Pause,
    Step,
    Speed(f64),
    End,
}
