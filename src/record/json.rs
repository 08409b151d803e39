//! Messages as JSON, one a line, for scripts that read along. RT: no.

use super::cdr::Leaves;
use super::stream::Stream;
use crate::base::time::Stamp;
use crate::msg::{FieldShape, Kind, Value};
use std::fmt::Write;

/// Appends a line: the stream's name, the time of validity (ns, the robot's clock) and the message with its fields.
/// Enumerations are their names. A number that is not finite is null. `None` if the bytes are of another message.
pub fn line(stream: Stream, valid_at: Stamp, bytes: &[u8], out: &mut String) -> Option<()> {
    let mut leaves = Leaves::new(bytes)?;
    write!(out, "{{\"stream\":\"{}\",\"valid_at_ns\":{},\"message\":", stream.name(), valid_at.0).ok()?;
    fields(stream.shape().fields, &mut leaves, out)?;
    out.push_str("}\n");
    leaves.is_empty().then_some(())
}

fn fields(fields: &[FieldShape], leaves: &mut Leaves<'_>, out: &mut String) -> Option<()> {
    out.push('{');
    for (i, field) in fields.iter().enumerate() {
        let comma = if i == 0 { "" } else { "," };
        write!(out, "{comma}\"{}\":", field.name).ok()?;
        value(&field.kind, leaves, out)?;
    }
    out.push('}');
    Some(())
}

fn items(kind: &Kind, count: usize, leaves: &mut Leaves<'_>, out: &mut String) -> Option<()> {
    out.push('[');
    for i in 0..count {
        if i > 0 {
            out.push(',');
        }
        value(kind, leaves, out)?;
    }
    out.push(']');
    Some(())
}

fn value(kind: &Kind, leaves: &mut Leaves<'_>, out: &mut String) -> Option<()> {
    match kind {
        Kind::Struct(shape) => fields(shape.fields, leaves, out),
        Kind::Array(element, count) => items(element, *count, leaves, out),
        Kind::Bytes(most) => match leaves.take(Kind::U32)? {
            Value::U32(count) => {
                let count = usize::try_from(count).ok().filter(|count| count <= most)?;
                items(&Kind::U8, count, leaves, out)
            }
            _ => None,
        },
        Kind::Enum(names) => match leaves.take(*kind)? {
            Value::U8(number) => {
                let (name, _) = names.iter().find(|(_, n)| *n == number)?;
                write!(out, "\"{name}\"").ok()
            }
            _ => None,
        },
        leaf => number(leaves.take(*leaf)?, out),
    }
}

fn number(value: Value, out: &mut String) -> Option<()> {
    match value {
        Value::Bool(v) => write!(out, "{v}"),
        Value::U8(v) => write!(out, "{v}"),
        Value::U16(v) => write!(out, "{v}"),
        Value::U32(v) => write!(out, "{v}"),
        Value::U64(v) => write!(out, "{v}"),
        Value::I16(v) => write!(out, "{v}"),
        Value::I32(v) => write!(out, "{v}"),
        Value::I64(v) => write!(out, "{v}"),
        Value::F64(v) if v.is_finite() => write!(out, "{v:?}"),
        Value::F64(_) => write!(out, "null"),
    }
    .ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::{Mode, TickRecord};
    use crate::record::stream::explode;
    use crate::record::stream::tests::random_record;
    use serde_json::Value as Json;

    fn lines(tick: &TickRecord) -> Vec<Json> {
        let mut text = String::new();
        explode(tick, &mut Vec::new(), |stream, at, bytes| line(stream, at, bytes, &mut text).ok_or(())).unwrap();
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    #[test]
    fn every_message_of_any_tick_is_json_with_its_names() {
        for seed in 0..20 {
            let tick = random_record(seed);
            let streams: Vec<String> =
                lines(&tick).iter().map(|line| line["stream"].as_str().unwrap().to_owned()).collect();
            assert_eq!(streams.first().map(String::as_str), Some("tick"));
            assert_eq!(streams.last().map(String::as_str), Some("status"));
            assert_eq!(streams.iter().filter(|s| *s == "imu").count(), usize::from(tick.input.imu.count));
        }
    }

    #[test]
    fn numbers_keep_their_bits_and_what_is_no_number_is_null() {
        let mut tick = TickRecord::default();
        tick.estimate.theta_stance_rad = 0.1 + 0.2;
        tick.estimate.theta_swing_rad = f64::NAN;
        tick.status.mode = Mode::Armed;
        let lines = lines(&tick);
        let of = |name: &str| lines.iter().find(|line| line["stream"] == name).unwrap()["message"].clone();
        let angle = of("estimate")["theta_stance_rad"].as_f64().unwrap();
        assert_eq!(angle.to_bits(), (0.1_f64 + 0.2).to_bits());
        assert!(of("estimate")["theta_swing_rad"].is_null());
        assert_eq!(of("status")["mode"], "Armed");
    }
}
