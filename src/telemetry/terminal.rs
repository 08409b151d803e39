//! The terminal in full-screen mode, given back on every way out. RT: no.
//!
//! `ratatui::init` would put its own panic hook before ours, and ours must send the stop frames first. So the terminal
//! is restored by `Drop` alone.

use super::screen;
use super::state::State;
use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use ratatui::crossterm::execute;
use ratatui::crossterm::terminal::{
    Clear, ClearType, EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};
use std::io::{self, Stdout};
use std::time::Duration;

/// The full screen.
pub(super) struct Screen {
    terminal: Terminal<CrosstermBackend<Stdout>>,
}

impl Screen {
    /// Takes the terminal.
    pub(super) fn open() -> io::Result<Self> {
        enable_raw_mode()?;
        // From here on Drop gives it back, also when the next line fails.
        let mut screen = Self { terminal: Terminal::new(CrosstermBackend::new(io::stdout()))? };
        // Not `Terminal::clear`: it asks where the cursor is, and one that does not answer (a pipe of `script`, a container
        // without a person) would stop the robot.
        execute!(screen.terminal.backend_mut(), EnterAlternateScreen, Clear(ClearType::All))?;
        Ok(screen)
    }

    /// Draws once.
    pub(super) fn draw(&mut self, state: &State) -> io::Result<()> {
        self.terminal.draw(|frame| screen::draw(frame, state))?;
        Ok(())
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        // Nothing more can be done if the terminal is gone.
        drop(execute!(self.terminal.backend_mut(), LeaveAlternateScreen));
        drop(self.terminal.show_cursor());
        drop(disable_raw_mode());
    }
}

/// Waits so long for a key; true if it was `q`, escape or control-C (raw mode hands it to us).
pub(super) fn quit_pressed(wait: Duration) -> io::Result<bool> {
    if !event::poll(wait)? {
        return Ok(false);
    }
    let Event::Key(key) = event::read()? else { return Ok(false) };
    let control_c = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
    Ok(key.kind == KeyEventKind::Press && (control_c || matches!(key.code, KeyCode::Char('q') | KeyCode::Esc)))
}
