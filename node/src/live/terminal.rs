//! The terminal while a screen is on it: put into raw mode, and always put back.

use super::board::Board;
use super::{held_log, screen};
use ratatui::crossterm::event::{Event, KeyCode, KeyModifiers, poll, read};
use ratatui::{DefaultTerminal, Frame};
use std::io::IsTerminal;
use std::time::Duration;

/// What a key means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// q, Esc or Ctrl-C: end.
    End,
    /// Down or right: the next one.
    Next,
    /// Up or left: the one before.
    Previous,
    /// A digit from 1: this one, counted from zero.
    Pick(usize),
    /// Space: stop the picture, or go on.
    Freeze,
}

/// A terminal with a screen on it. Dropping it, and a panic of any thread, puts the terminal back as it was.
#[derive(Debug)]
pub struct Terminal {
    inner: DefaultTerminal,
    /// Dropped after the terminal is back, so that the lines it held come out on the ordinary screen.
    _held: held_log::Hold,
}

impl Terminal {
    /// Takes over the terminal; `None` when standard output is none, or it cannot be had.
    #[must_use]
    pub fn start() -> Option<Self> {
        if !std::io::stdout().is_terminal() {
            return None;
        }
        let inner = ratatui::try_init().ok()?;
        Some(Self { inner, _held: held_log::hold() })
    }

    /// Draws the board.
    ///
    /// # Errors
    /// When the terminal is gone.
    pub fn draw(&mut self, board: &Board) -> std::io::Result<()> {
        self.draw_with(|frame| screen::draw(frame, board))
    }

    /// Draws what `draw` does.
    ///
    /// # Errors
    /// When the terminal is gone.
    pub fn draw_with(&mut self, draw: impl FnOnce(&mut Frame<'_>)) -> std::io::Result<()> {
        self.inner.draw(draw).map(drop)
    }

    /// The next key that means something, waiting for at most `timeout`.
    #[must_use]
    pub fn key(&self, timeout: Duration) -> Option<Key> {
        let Ok(true) = poll(timeout) else { return None };
        let Ok(Event::Key(key)) = read() else { return None };
        Some(match key.code {
            // Raw mode takes Ctrl-C away from the signal handler.
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
