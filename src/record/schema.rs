//! Descriptions of messages for other programs: `ros2msg` text made from [`Shape`], and named leaves for ours. RT: no.

use super::cdr::Leaves;
use crate::msg::{FieldShape, Kind, Shape, Value};
use std::fmt::Write;

/// Name of a message as ROS 2 writes it.
#[must_use]
pub fn name(shape: &Shape) -> String {
    format!("compass/msg/{}", shape.name)
}

/// The `ros2msg` definition: the message, then each message inside it once. Units stand at the end of field names.
#[must_use]
pub fn ros2msg(shape: &'static Shape) -> String {
    let mut text = fields(shape);
    let mut inner = Vec::new();
    collect(shape, &mut inner);
    for part in inner {
        let rule = "=".repeat(80);
        write!(text, "{rule}\nMSG: compass/{}\n{}", part.name, fields(part)).unwrap_or_default();
    }
    text
}

fn fields(shape: &Shape) -> String {
    let mut text = String::new();
    for field in shape.fields {
        writeln!(text, "#{}\n{} {}", field.doc.replace('\n', "\n#"), type_name(&field.kind), field.name)
            .unwrap_or_default();
    }
    text
}

fn type_name(kind: &Kind) -> String {
    match kind {
        Kind::Bool => "bool".into(),
        Kind::U8 | Kind::Enum(_) => "uint8".into(),
        Kind::U16 => "uint16".into(),
        Kind::U32 => "uint32".into(),
        Kind::U64 => "uint64".into(),
        Kind::I16 => "int16".into(),
        Kind::I32 => "int32".into(),
        Kind::I64 => "int64".into(),
        Kind::F64 => "float64".into(),
        Kind::Bytes(most) => format!("uint8[<={most}]"),
        Kind::Array(element, n) => format!("{}[{n}]", type_name(element)),
        Kind::Struct(shape) => format!("compass/{}", shape.name),
    }
}

/// Messages inside a message, each once, outer ones first.
fn collect(shape: &'static Shape, out: &mut Vec<&'static Shape>) {
    for field in shape.fields {
        let mut kind = &field.kind;
        while let Kind::Array(element, _) = kind {
            kind = element;
        }
        if let Kind::Struct(inner) = kind
            && !out.contains(inner)
        {
            out.push(inner);
            collect(inner, out);
        }
    }
}

/// A leaf with its path, such as `drives[2].torque_permille`.
pub type NamedLeaf = (String, Value);

/// All leaves of an encoded message. `None` if it is not of this shape.
#[must_use]
pub fn leaves(shape: &Shape, bytes: &[u8]) -> Option<Vec<NamedLeaf>> {
    let mut source = Leaves::new(bytes)?;
    let mut out = Vec::new();
    walk_fields(shape.fields, "", &mut source, &mut out)?;
    source.is_empty().then_some(out)
}

fn walk_fields(fields: &[FieldShape], path: &str, source: &mut Leaves<'_>, out: &mut Vec<NamedLeaf>) -> Option<()> {
    let dot = if path.is_empty() { "" } else { "." };
    fields.iter().try_for_each(|field| walk(&field.kind, &format!("{path}{dot}{}", field.name), source, out))
}

fn walk(kind: &Kind, path: &str, source: &mut Leaves<'_>, out: &mut Vec<NamedLeaf>) -> Option<()> {
    match kind {
        Kind::Struct(shape) => walk_fields(shape.fields, path, source, out),
        Kind::Bytes(most) => match source.take(Kind::U32)? {
            Value::U32(n) if usize::try_from(n).is_ok_and(|n| n <= *most) => {
                (0..n).try_for_each(|i| walk(&Kind::U8, &format!("{path}[{i}]"), source, out))
            }
            _ => None,
        },
        Kind::Array(element, n) => (0..*n).try_for_each(|i| walk(element, &format!("{path}[{i}]"), source, out)),
        leaf => {
            out.push((path.to_owned(), source.take(*leaf)?));
            Some(())
        }
    }
}

/// A value as a person reads it. Floats show all their digits.
#[must_use]
pub fn show(value: Value) -> String {
    match value {
        Value::Bool(v) => v.to_string(),
        Value::U8(v) => v.to_string(),
        Value::U16(v) => v.to_string(),
        Value::U32(v) => v.to_string(),
        Value::U64(v) => v.to_string(),
        Value::I16(v) => v.to_string(),
        Value::I32(v) => v.to_string(),
        Value::I64(v) => v.to_string(),
        Value::F64(v) => format!("{v:?}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::{Fault, Status};

    #[test]
    fn definition_holds_inner_messages_once_and_docs_as_comments() {
        let text = ros2msg(&Status::SHAPE);
        assert!(text.contains("compass/Fault first_fault\n"), "{text}");
        assert_eq!(text.matches("MSG: compass/Fault\n").count(), 1);
        assert!(text.contains("# Periods skipped since start.\nuint64 overruns\n"), "{text}");
    }

    #[test]
    fn leaves_are_named_by_their_path() {
        let mut bytes = Vec::new();
        super::super::cdr::encode(
            &Status { first_fault: Fault { value: 1.5, ..Fault::default() }, ..Status::default() },
            &mut bytes,
        );
        let leaves = leaves(&Status::SHAPE, &bytes).unwrap();
        let (_, value) = leaves.iter().find(|(path, _)| path == "first_fault.value").unwrap();
        assert_eq!(show(*value), "1.5");
    }
}
