//! The robot as a stick figure. RT: no.

use super::footing::{Place, Points};
use super::state::State;
use crate::msg::Leg;
use ratatui::style::Color;
use ratatui::symbols::Marker;
use ratatui::widgets::canvas::{Canvas, Circle, Context, Line};
use ratatui::widgets::{Block, Widget};

/// Colour of the inner leg, everywhere on the screen.
pub(super) const INNER: Color = Color::Cyan;
/// Colour of the outer leg.
pub(super) const OUTER: Color = Color::Yellow;

/// Above and below the robot, in leg lengths.
const TOP: f64 = 1.25;
const BOTTOM: f64 = -0.12;

/// The picture, for an area of so many cells (a braille cell has 2 x 4 square dots).
pub(super) fn widget<'a>(state: &'a State, cells: (u16, u16), block: Block<'a>) -> impl Widget + 'a {
    let height = TOP - BOTTOM;
    let width = height * f64::from(cells.0.max(1)) * 2.0 / (f64::from(cells.1.max(1)) * 4.0);
    Canvas::default()
        .block(block)
        .marker(Marker::Braille)
        .x_bounds([-0.5 * width, 0.5 * width])
        .y_bounds([BOTTOM, TOP])
        .paint(move |context| paint(context, state, 0.5 * width))
}

fn paint(context: &mut Context<'_>, state: &State, half_width: f64) {
    let floor = state.footing.floor(half_width);
    for (from, to) in floor.iter().zip(floor.iter().skip(1)) {
        context.draw(&line(*from, *to, Color::DarkGray));
    }
    let estimate = &state.tick.estimate;
    if !estimate.valid {
        return;
    }
    let p = Points::of(&state.config, estimate, &state.tick.snapshot);
    let (stance, swing) = match estimate.stance {
        Leg::Inner => (INNER, OUTER),
        Leg::Outer => (OUTER, INNER),
    };
    context.draw(&line(p.hip, p.head, Color::Gray));
    context.draw(&line(p.hip, p.swing_toe, swing));
    context.draw(&line(p.stance_toe, p.hip, stance));
    context.draw(&Circle { x: p.hip.0, y: p.hip.1, radius: 0.03, color: Color::White });
    context.draw(&Circle { x: p.head.0, y: p.head.1, radius: 0.05, color: Color::Gray });
}

const fn line(from: Place, to: Place, color: Color) -> Line {
    Line { x1: from.0, y1: from.1, x2: to.0, y2: to.1, color }
}
