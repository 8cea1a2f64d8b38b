//! The terminal while a screen is shown: it is put into raw mode and always restored.

use super::live_summary::LiveSummary;
use super::{held_log, screen};
use ratatui::crossterm::event::{Event, KeyCode, KeyModifiers, poll, read};
use ratatui::{DefaultTerminal, Frame};
use std::io::IsTerminal;
use std::time::Duration;

/// The meaning of a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// q, Esc or Ctrl-C: end.
    End,
    /// Down or right: select the next one.
    Next,
    /// Up or left: select the previous one.
    Previous,
    /// A digit from 1: select this one, counted from zero.
    Pick(usize),
    /// Space: freeze the screen, or continue.
    Freeze,
}

/// A terminal with a screen on it. Dropping it, or a panic of any thread, restores the terminal.
#[derive(Debug)]
pub struct Terminal {
    inner: DefaultTerminal,
    /// Dropped after the terminal is restored, so that the held lines appear on the ordinary screen.
    _held: held_log::Hold,
}

impl Terminal {
    /// Takes over the terminal; `None` when standard output is not a terminal or it cannot be initialised.
    #[must_use]
    pub fn start() -> Option<Self> {
        if !std::io::stdout().is_terminal() {
            return None;
        }
        let inner = ratatui::try_init().ok()?;
        Some(Self { inner, _held: held_log::hold() })
    }

    /// Draws the summary.
    ///
    /// # Errors
    /// When the terminal is gone.
    pub fn draw(&mut self, summary: &LiveSummary) -> std::io::Result<()> {
        self.draw_with(|frame| screen::draw(frame, summary))
    }

    /// Draws with the function `draw`.
    ///
    /// # Errors
    /// When the terminal is gone.
    pub fn draw_with(&mut self, draw: impl FnOnce(&mut Frame<'_>)) -> std::io::Result<()> {
        self.inner.draw(draw).map(drop)
    }

    /// The next key with a meaning; waits for at most `timeout`.
    #[must_use]
    pub fn key(&self, timeout: Duration) -> Option<Key> {
        let Ok(true) = poll(timeout) else { return None };
        let Ok(Event::Key(key)) = read() else { return None };
        Some(match key.code {
            // In raw mode, Ctrl-C does not reach the signal handler.
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => Key::End,
            KeyCode::Char('q') | KeyCode::Esc => Key::End,
            KeyCode::Down | KeyCode::Right => Key::Next,
            KeyCode::Up | KeyCode::Left => Key::Previous,
            KeyCode::Char(' ') => Key::Freeze,
            KeyCode::Char(digit @ '1'..='9') => Key::Pick(digit as usize - '1' as usize),
            _ => return None,
        })
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        ratatui::restore();
    }
}
