//! The full-screen view. RT: no.

use super::figure::{self, INNER, OUTER};
use super::plain::microseconds;
use super::state::{HISTORY_POINTS, State, mode_name, terrain_in_words};
use crate::msg::{BusHealth, Drive, DriveState, Leg, Mode, Motion, RecorderState};
use hdrhistogram::Histogram;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::canvas::{Canvas, Line as Stroke};
use ratatui::widgets::{Block, BorderType, Paragraph};

const GOOD: Color = Color::Green;
const WARN: Color = Color::Yellow;
const BAD: Color = Color::Red;
const DIM: Style = Style::new().fg(Color::DarkGray);

/// Draws everything.
pub(super) fn draw(frame: &mut Frame<'_>, state: &State) {
    // On 24 rows the latencies matter more than a fourth event.
    let event_rows = if frame.area().height < 30 { 4 } else { 6 };
    let [head, body, events] =
        Layout::vertical([Constraint::Length(1), Constraint::Min(16), Constraint::Length(event_rows)])
            .areas(frame.area());
    let [left, right] = Layout::horizontal([Constraint::Min(30), Constraint::Length(48)]).areas(body);
    let [robot, torque] = Layout::vertical([Constraint::Min(8), Constraint::Length(7)]).areas(left);
    let [angles, drives, rest] =
        Layout::vertical([Constraint::Length(5), Constraint::Length(9), Constraint::Min(0)]).areas(right);
    draw_head(frame, head, state);
    draw_robot(frame, robot, state);
    draw_torque(frame, torque, state);
    draw_angles(frame, angles, state);
    draw_drives(frame, drives, state);
    draw_loop(frame, rest, state);
    draw_events(frame, events, state);
}

fn block(title: &str) -> Block<'_> {
    Block::bordered().border_type(BorderType::Rounded).border_style(DIM).title(title)
}

fn colored(text: impl Into<String>, color: Color) -> Span<'static> {
    Span::styled(text.into(), Style::new().fg(color))
}

fn dim(text: impl Into<String>) -> Span<'static> {
    Span::styled(text.into(), DIM)
}

fn draw_head(frame: &mut Frame<'_>, area: Rect, state: &State) {
    let mode = state.tick.status.mode;
    let color = match mode {
        Mode::Starting | Mode::Disarmed => Color::Gray,
        Mode::Arming | Mode::Homing => WARN,
        Mode::Armed => GOOD,
        Mode::Faulted => BAD,
    };
    let badge = Style::new().bg(color).fg(Color::Black).add_modifier(Modifier::BOLD);
    let held = if state.tick.snapshot.dead_man { colored("held", GOOD) } else { dim("released") };
    let line = Line::from(vec![
        Span::styled(" compass ", Style::new().add_modifier(Modifier::BOLD)),
        Span::styled(format!(" {:8} ", mode_name(mode)), badge),
        dim("  stance "),
        leg_name(state.tick.estimate.stance),
        dim("  dead-man "),
        held,
        dim("  time "),
        Span::raw(format!("{:.1} s", state.elapsed().as_s())),
        dim("  tick "),
        Span::raw(state.tick.status.ticks.to_string()),
    ]);
    frame.render_widget(Paragraph::new(line), area);
}

fn leg_name(leg: Leg) -> Span<'static> {
    match leg {
        Leg::Inner => colored("inner", INNER),
        Leg::Outer => colored("outer", OUTER),
    }
}

fn draw_robot(frame: &mut Frame<'_>, area: Rect, state: &State) {
    let block = block(" robot ");
    let inner = block.inner(area);
    frame.render_widget(figure::widget(state, (inner.width, inner.height), block), area);
}

fn draw_torque(frame: &mut Frame<'_>, area: Rect, state: &State) {
    let limit = state.config.robot.limits.hip_torque_nm;
    let now = state.tick.allowed.hip_torque_nm;
    let title = format!(" hip {now:+6.2} Nm, limit {limit:.0}, wanted {:+.2} ", state.tick.wanted.hip_torque_nm);
    let block = block(&title);
    let inner = block.inner(area);
    frame.render_widget(block, area);
    let [bar, history] = Layout::vertical([Constraint::Length(1), Constraint::Min(0)]).areas(inner);
    frame.render_widget(Paragraph::new(torque_bar(now / limit, bar.width)), bar);
    draw_history(frame, history, state, limit);
}

/// A bar from the middle: right is +, left is -.
fn torque_bar(share: f64, width: u16) -> Line<'static> {
    let half = usize::from(width.saturating_sub(1) / 2);
    // Saturates: a torque that is not finite draws nothing, beyond the limit the full bar.
    let filled = ((share.abs().min(1.0) * half as f64).round() as usize).min(half);
    let color = if share.abs() > 0.95 {
        BAD
    } else if share.abs() > 0.6 {
        WARN
    } else {
        GOOD
    };
    let (full, empty) = ("█".repeat(filled), "·".repeat(half - filled));
    if share < 0.0 {
        Line::from(vec![dim(empty), colored(full, color), dim("│"), dim("·".repeat(half))])
    } else {
        Line::from(vec![dim("·".repeat(half)), dim("│"), colored(full, color), dim(empty)])
    }
}

fn draw_history(frame: &mut Frame<'_>, area: Rect, state: &State, limit: f64) {
    let last = HISTORY_POINTS as f64 - 1.0;
    let canvas =
        Canvas::default().marker(Marker::Braille).x_bounds([0.0, last]).y_bounds([-limit, limit]).paint(|context| {
            context.draw(&Stroke { x1: 0.0, y1: 0.0, x2: last, y2: 0.0, color: Color::DarkGray });
            let first = last + 1.0 - state.torque_nm.len() as f64;
            let points = state.torque_nm.iter().zip(state.torque_nm.iter().skip(1)).enumerate();
            for (i, (from, to)) in points {
                let x1 = first + i as f64;
                context.draw(&Stroke { x1, y1: *from, x2: x1 + 1.0, y2: *to, color: GOOD });
            }
        });
    frame.render_widget(canvas, area);
}

fn draw_angles(frame: &mut Frame<'_>, area: Rect, state: &State) {
    let e = &state.tick.estimate;
    let row = |name: Span<'static>, angle: f64, rate: f64, innovation: f64| {
        Line::from(vec![
            name,
            Span::raw(format!("  {:+8.3}°  {:+8.2}°/s", angle.to_degrees(), rate.to_degrees())),
            dim(format!("   off {:+7.3}°", innovation.to_degrees())),
        ])
    };
    let lines = vec![
        row(leg_name(e.stance), e.theta_stance_rad, e.theta_stance_rad_s, e.innovation_stance_rad),
        row(leg_name(e.stance.other()), e.theta_swing_rad, e.theta_swing_rad_s, e.innovation_swing_rad),
        Line::from(vec![
            dim("hip    "),
            Span::raw(format!("{:+8.3}°", e.hip_angle_rad.to_degrees())),
            dim(format!("  steps {}  imu {} ms", e.steps, age_ms(state.tick.snapshot.imu_age.as_s()))),
        ]),
    ];
    let doing = &state.tick.control;
    let title = match doing.motion {
        Motion::Stand if doing.speed_m_s > 0.0 => {
            format!(" legs: {}, {:.2} m/s asked ", doing.law.name(), doing.speed_m_s)
        }
        // Pushed since before the arming: it does not count until it was at rest.
        Motion::Stand if state.tick.snapshot.asked_m_s > 0.0 => {
            format!(" legs: {}, stick is pushed: let it rest first ", doing.law.name())
        }
        Motion::Stand => format!(" legs: {} ", doing.law.name()),
        _ => format!(
            " legs: {} by {}, step {}, {:.0} %, {:.2} m/s asked ",
            doing.motion.name(),
            doing.law.name(),
            doing.steps,
            doing.phase * 100.0,
            doing.speed_m_s
        ),
    };
    frame.render_widget(Paragraph::new(lines).block(block(&title)), area);
}

/// An age in ms, or "never".
fn age_ms(seconds: f64) -> String {
    if seconds > 1e6 { "never".into() } else { format!("{:.1}", seconds * 1e3) }
}

fn draw_drives(frame: &mut Frame<'_>, area: Rect, state: &State) {
    let mut lines: Vec<Line<'_>> = Drive::ALL.iter().map(|drive| drive_line(state, *drive)).collect();
    for (bus, health) in state.tick.feedback.health.iter().enumerate() {
        lines.push(bus_line(state, bus, *health));
    }
    frame.render_widget(Paragraph::new(lines).block(block(" drives and buses ")), area);
}

fn drive_line(state: &State, drive: Drive) -> Line<'static> {
    let feedback = &state.tick.feedback.drives[drive as usize];
    let color = match feedback.state {
        DriveState::Enabled => GOOD,
        DriveState::Fault | DriveState::Lost | DriveState::QuickStop => BAD,
        DriveState::Unknown | DriveState::NotReady => Color::DarkGray,
        _ => WARN,
    };
    let permille = f64::from(feedback.torque_permille) * 0.1;
    let error = if feedback.error_code == 0 { String::new() } else { format!(" {:04x}", feedback.error_code) };
    Line::from(vec![
        Span::raw(format!("{:8}", drive.words())),
        colored(format!("{:16}", feedback.state.name()), color),
        Span::raw(format!("{:8}", feedback.position_counts)),
        dim(" cnt"),
        Span::raw(format!("{permille:+6.1} %")),
        colored(error, BAD),
    ])
}

fn bus_line(state: &State, bus: usize, health: BusHealth) -> Line<'static> {
    let color = match health {
        BusHealth::Active => GOOD,
        BusHealth::Passive => WARN,
        BusHealth::Off | BusHealth::Stalled | BusHealth::Down | BusHealth::Contested => BAD,
    };
    let rates = &state.frames[bus];
    let dropped = state.tick.input.received[bus].dropped + state.tick.output.send[bus].dropped;
    Line::from(vec![
        Span::raw(format!("bus {bus}   ")),
        colored(format!("{:8}", health.name()), color),
        Span::raw(format!("{:5}", rates.received_hz)),
        dim(" in/s "),
        Span::raw(format!("{:5}", rates.sent_hz)),
        dim(" out/s  lost "),
        colored(dropped.to_string(), if dropped == 0 { Color::DarkGray } else { BAD }),
    ])
}

fn draw_loop(frame: &mut Frame<'_>, area: Rect, state: &State) {
    let status = &state.tick.status;
    let skipped = if status.overruns == 0 { GOOD } else { WARN };
    let granted =
        if state.tick.input.real_time_missing == 0 { colored("granted", GOOD) } else { colored("MISSING", BAD) };
    let mut lines = vec![
        dim("us          p50      p99    p99.9      max").into(),
        latency_line("wake-up", &state.wake_ns),
        latency_line("step", &state.step_ns),
        Line::from(vec![
            dim("skipped "),
            colored(status.overruns.to_string(), skipped),
            dim("  faults "),
            colored(status.faults.to_string(), if status.faults == 0 { GOOD } else { BAD }),
            dim("  real time "),
            granted,
            dim(if state.missed == 0 { String::new() } else { format!("  unseen {}", state.missed) }),
        ]),
        recorder_line(state),
    ];
    if let Some(terrain) = terrain_in_words(&state.tick.terrain) {
        lines.push(Line::from(vec![dim("terrain "), Span::raw(terrain)]));
    }
    for thread in &state.side.threads {
        let color = if thread.good { GOOD } else { BAD };
        lines.push(Line::from(vec![colored(format!("{:8}", thread.name), color), dim(thread.detail.clone())]));
    }
    frame.render_widget(Paragraph::new(lines).block(block(" loop ")), area);
}

fn latency_line(name: &str, ns: &Histogram<u64>) -> Line<'static> {
    let us = |value: u64| format!("{:9.1}", microseconds(value));
    let at = |quantile| us(ns.value_at_quantile(quantile));
    let values = [at(0.5), at(0.99), at(0.999), us(ns.max())].concat();
    Line::from(vec![dim(format!("{name:7}")), Span::raw(values)])
}

fn recorder_line(state: &State) -> Line<'static> {
    let recorder = &state.side.recorder;
    let (text, color) = match recorder.state {
        RecorderState::Off => ("off", Color::DarkGray),
        RecorderState::Recording => ("on", GOOD),
        RecorderState::Finished => ("closed", Color::Gray),
        RecorderState::DiskFull => ("DISK FULL", BAD),
        RecorderState::DiskError => ("DISK ERROR", BAD),
    };
    Line::from(vec![
        dim("record "),
        colored(text, color),
        Span::raw(format!(" {} MB", recorder.bytes / 1_000_000)),
        dim("  lost "),
        colored(recorder.dropped.to_string(), if recorder.dropped == 0 { Color::DarkGray } else { BAD }),
        dim(format!("  flush {:.0} ms", recorder.flush_time.as_us() * 1e-3)),
    ])
}

fn draw_events(frame: &mut Frame<'_>, area: Rect, state: &State) {
    let block = block(" events ").title_bottom(format!(" {} ", state.quit_means));
    let rows = usize::from(block.inner(area).height);
    let newest = state.events.iter().rev().take(rows);
    let lines: Vec<Line<'_>> = newest
        .map(|(since, text)| {
            let color = if text.starts_with("fault") || text.starts_with("recorder") { BAD } else { Color::Reset };
            Line::from(vec![dim(format!("{:10.3} s  ", since.as_s())), colored(text.clone(), color)])
        })
        .collect();
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::{Span as Time, Stamp};
    use crate::config;
    use crate::msg::{Fault, FaultCode, TickRecord};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    fn state() -> State {
        let mut state = State::new(&config::load(None, &[]).unwrap().config).unwrap();
        for index in 0..2000 {
            let mut tick = TickRecord::default();
            tick.input.index = index;
            tick.input.now = Stamp(1_000_000 * index as i64);
            tick.input.wake_latency = Time::from_us(25);
            tick.estimate.valid = true;
            tick.estimate.theta_stance_rad = 0.05;
            tick.allowed.hip_torque_nm = -12.0;
            tick.status.mode = if index < 1000 { Mode::Armed } else { Mode::Faulted };
            if index >= 1000 {
                tick.status.first_fault = Fault { code: FaultCode::TiltLimit, ..Fault::default() };
            }
            state.take(&tick);
        }
        state
    }

    fn screen(state: &State, width: u16, height: u16) -> String {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(|frame| draw(frame, state)).unwrap();
        terminal.backend().to_string()
    }

    #[test]
    fn everything_that_matters_is_on_a_screen_of_80_by_24() {
        let text = screen(&state(), 80, 24);
        for word in
            ["FAULT", "inner", "-12.00 Nm", "+2.865°", "Unknown", "bus 1", "wake-up", "25.0", "TiltLimit", "q: quit"]
        {
            assert!(text.contains(word), "`{word}` is not on the screen:\n{text}");
        }
    }

    #[test]
    fn no_size_and_no_number_makes_it_panic() {
        let mut state = state();
        let mut broken = state.tick;
        broken.estimate.theta_stance_rad = f64::NAN;
        broken.allowed.hip_torque_nm = f64::INFINITY;
        state.take(&broken);
        for (width, height) in [(1, 1), (10, 3), (79, 23), (80, 24), (200, 60)] {
            screen(&state, width, height);
        }
    }
}
