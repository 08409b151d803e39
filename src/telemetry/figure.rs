//! The robot as a stick figure. RT: no.

use super::state::State;
use crate::config::checked::Config;
use crate::msg::{Estimate, Leg, Snapshot, TOES};
use ratatui::style::Color;
use ratatui::symbols::Marker;
use ratatui::widgets::canvas::{Canvas, Circle, Context, Line};
use ratatui::widgets::{Block, Widget};
use std::collections::VecDeque;

/// Colour of the inner leg, everywhere on the screen.
pub(super) const INNER: Color = Color::Cyan;
/// Colour of the outer leg.
pub(super) const OUTER: Color = Color::Yellow;

/// Above and below the robot, in leg lengths.
const TOP: f64 = 1.25;
const BOTTOM: f64 = -0.12;

/// A place where a foot stood, in leg lengths, stance toe at the origin; x forward, y up.
pub(super) type Foothold = (f64, f64);

/// Points of the robot, in leg lengths, stance toe at the origin; x forward, y up.
#[derive(Debug, PartialEq)]
struct Points {
    stance_toe: (f64, f64),
    hip: (f64, f64),
    head: (f64, f64),
    swing_toe: (f64, f64),
}

/// Model notes, section 1: toe to hip is d(θ) = (-sin θ, cos θ); the body bisects the legs.
fn points(estimate: &Estimate, swing_length: f64) -> Points {
    let along =
        |(x, y): (f64, f64), theta: f64, length: f64| (x - length * libm::sin(theta), y + length * libm::cos(theta));
    let (stance, swing) = (estimate.theta_stance_rad, estimate.theta_swing_rad);
    let stance_toe = (0.0, 0.0);
    let hip = along(stance_toe, stance, 1.0);
    Points {
        stance_toe,
        hip,
        head: along(hip, 0.5 * (stance + swing), 0.15),
        swing_toe: along(hip, swing, -swing_length),
    }
}

/// Length of the swing leg, whose toes are retracted, in lengths of the stance leg.
fn swing_length(config: &Config, snapshot: &Snapshot, stance: Leg) -> f64 {
    let [inner, outer] = [0, TOES / 2].map(|first| snapshot.toe_position_m[first]);
    let retraction_m = match stance {
        Leg::Inner => inner - outer,
        Leg::Outer => outer - inner,
    };
    1.0 - retraction_m / config.robot.model.leg_length_m.value
}

/// Where the swing toe is, in leg lengths from the stance toe.
pub(super) fn swing_toe(config: &Config, estimate: &Estimate, snapshot: &Snapshot) -> Foothold {
    points(estimate, swing_length(config, snapshot, estimate.stance)).swing_toe
}

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

/// The floor as the feet found it: through the footholds; level before the first and after the last.
fn draw_floor(context: &mut Context<'_>, footholds: &VecDeque<Foothold>, half_width: f64) {
    let level = footholds.front().map_or(0.0, |(_, y)| *y);
    let first = footholds.front().map_or(0.0, |(x, _)| x.min(0.0));
    let mut from = (-half_width.max(-first), level);
    for to in footholds.iter().copied().chain([(0.0, 0.0), (half_width, 0.0)]) {
        context.draw(&line(from, to, Color::DarkGray));
        from = to;
    }
}

fn paint(context: &mut Context<'_>, state: &State, half_width: f64) {
    let (config, estimate, snapshot) = (&state.config, &state.tick.estimate, &state.tick.snapshot);
    draw_floor(context, &state.footholds, half_width);
    if !estimate.valid {
        return;
    }
    let p = points(estimate, swing_length(config, snapshot, estimate.stance));
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

const fn line(from: (f64, f64), to: (f64, f64), color: Color) -> Line {
    Line { x1: from.0, y1: from.1, x2: to.0, y2: to.1, color }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positive_angle_leans_back_and_both_feet_meet_the_ground_in_a_symmetric_stand() {
        let estimate = Estimate { theta_stance_rad: 0.2, theta_swing_rad: -0.2, ..Estimate::default() };
        let p = points(&estimate, 1.0);
        assert!(p.hip.0 < 0.0, "walking in +x the stance angle goes from + to -");
        assert!(p.swing_toe.1.abs() < 1e-12, "rounding");
        assert!((p.head.0 - p.hip.0).abs() < 1e-12, "the body bisects the legs");
    }
}
