//! What a message is made of, as data. RT: yes.

use crate::base::time::{Span, Stamp};

/// Type of a leaf or of a part of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One byte, 0 or 1.
    Bool,
    /// Unsigned byte.
    U8,
    /// Unsigned byte with these names and numbers.
    Enum(&'static [(&'static str, u8)]),
    /// Unsigned, two bytes.
    U16,
    /// Unsigned, four bytes.
    U32,
    /// Unsigned, eight bytes.
    U64,
    /// Signed, two bytes.
    I16,
    /// Signed, four bytes.
    I32,
    /// Signed, eight bytes.
    I64,
    /// IEEE double.
    F64,
    /// At most so many bytes, with their number (four bytes, unsigned) before them.
    Bytes(usize),
    /// So many of the same.
    Array(&'static Self, usize),
    /// A message inside a message.
    Struct(&'static Shape),
}

/// Description of a message.
#[derive(Debug, PartialEq, Eq)]
pub struct Shape {
    /// Name of the type.
    pub name: &'static str,
    /// Its fields in order.
    pub fields: &'static [FieldShape],
}

/// Description of one field.
#[derive(Debug, PartialEq, Eq)]
pub struct FieldShape {
    /// Name, with the unit at its end.
    pub name: &'static str,
    /// First lines of its documentation.
    pub doc: &'static str,
    /// Its type.
    pub kind: Kind,
}

/// A leaf value.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "one per leaf kind, named alike")]
pub enum Value {
    Bool(bool),
    U8(u8),
    U16(u16),
    U32(u32),
    U64(u64),
    I16(i16),
    I32(i32),
    I64(i64),
    F64(f64),
}

/// Anything that can stand in a message.
pub trait Element: Copy {
    /// Its type as data.
    const KIND: Kind;
    /// Hands over its leaves in order.
    fn put(&self, sink: &mut impl FnMut(Value));
    /// Takes its leaves in order. `None` if a leaf is missing or has another type.
    fn take(source: &mut impl FnMut(Kind) -> Option<Value>) -> Option<Self>;
}

macro_rules! leaf {
    ($($ty:ty => $kind:ident),*) => { $(
        impl Element for $ty {
            const KIND: Kind = Kind::$kind;
            fn put(&self, sink: &mut impl FnMut(Value)) {
                sink(Value::$kind(*self));
            }
            fn take(source: &mut impl FnMut(Kind) -> Option<Value>) -> Option<Self> {
                match source(Kind::$kind)? {
                    Value::$kind(v) => Some(v),
                    _ => None,
                }
            }
        }
    )* };
}
leaf!(bool => Bool, u8 => U8, u16 => U16, u32 => U32, u64 => U64, i16 => I16, i32 => I32, i64 => I64, f64 => F64);

macro_rules! leaf_newtype {
    ($($ty:ident),*) => { $(
        impl Element for $ty {
            const KIND: Kind = Kind::I64;
            fn put(&self, sink: &mut impl FnMut(Value)) {
                self.0.put(sink);
            }
            fn take(source: &mut impl FnMut(Kind) -> Option<Value>) -> Option<Self> {
                i64::take(source).map(Self)
            }
        }
    )* };
}
leaf_newtype!(Stamp, Span);

impl<T: Element + Default, const N: usize> Element for [T; N] {
    const KIND: Kind = Kind::Array(&T::KIND, N);
    fn put(&self, sink: &mut impl FnMut(Value)) {
        for x in self {
            x.put(sink);
        }
    }
    fn take(source: &mut impl FnMut(Kind) -> Option<Value>) -> Option<Self> {
        let mut out = [T::default(); N];
        for x in &mut out {
            *x = T::take(source)?;
        }
        Some(out)
    }
}

/// Declares an enumeration that travels as one byte. The first variant is the default.
macro_rules! wire_enum {
    ($(#[$meta:meta])* pub enum $name:ident { $(#[$fm:meta])* $first:ident = $fv:literal, $($(#[$vm:meta])* $var:ident = $val:literal,)* }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u8)]
        pub enum $name { $(#[$fm])* #[default] $first = $fv, $($(#[$vm])* $var = $val,)* }

        #[expect(unsafe_code, reason = "the derive wants repr(C), which would not fix the size")]
        // SAFETY: one byte without pointers or padding; both sides of a channel share the schema hash, hence the variants.
        unsafe impl ZeroCopySend for $name {}

        impl $name {
            /// All of them, in order.
            pub const ALL: &'static [Self] = &[Self::$first, $(Self::$var,)*];

            /// The one with this number on the wire.
            #[must_use]
            pub const fn from_u8(v: u8) -> Option<Self> {
                match v { $fv => Some(Self::$first), $($val => Some(Self::$var),)* _ => None }
            }

            /// Its name as written in the code.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { Self::$first => stringify!($first), $(Self::$var => stringify!($var),)* }
            }
        }

        impl $crate::msg::Element for $name {
            const KIND: $crate::msg::Kind =
                $crate::msg::Kind::Enum(&[(stringify!($first), $fv), $((stringify!($var), $val),)*]);
            fn put(&self, sink: &mut impl FnMut($crate::msg::Value)) {
                sink($crate::msg::Value::U8(*self as u8));
            }
            fn take(source: &mut impl FnMut($crate::msg::Kind) -> Option<$crate::msg::Value>) -> Option<Self> {
                Self::from_u8(u8::take(source)?)
            }
        }
    };
}

/// Declares a message: the struct, its shape, its walk over leaves.
macro_rules! message {
    ($(#[$meta:meta])* pub struct $name:ident { $($(#[doc = $doc:literal])* pub $field:ident: $ty:ty,)* }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
        #[repr(C)]
        pub struct $name { $($(#[doc = $doc])* pub $field: $ty,)* }

        impl $name {
            /// What it is made of.
            pub const SHAPE: $crate::msg::Shape = $crate::msg::Shape {
                name: stringify!($name),
                fields: &[$($crate::msg::FieldShape {
                    name: stringify!($field),
                    doc: concat!($($doc),*),
                    kind: <$ty as $crate::msg::Element>::KIND,
                },)*],
            };
        }

        impl $crate::msg::Element for $name {
            const KIND: $crate::msg::Kind = $crate::msg::Kind::Struct(&Self::SHAPE);
            fn put(&self, sink: &mut impl FnMut($crate::msg::Value)) {
                $($crate::msg::Element::put(&self.$field, sink);)*
            }
            fn take(source: &mut impl FnMut($crate::msg::Kind) -> Option<$crate::msg::Value>) -> Option<Self> {
                Some(Self { $($field: $crate::msg::Element::take(source)?,)* })
            }
        }
    };
}

/// Gives a message with `count`, `dropped` and an array of items the ways of a list of bounded length.
macro_rules! batch {
    ($name:ident { $items:ident: $item:ty }) => {
        impl $name {
            /// The items that are there.
            #[must_use]
            pub fn as_slice(&self) -> &[$item] {
                self.$items.get(..usize::from(self.count)).unwrap_or(&self.$items)
            }

            /// Adds an item, or counts it as dropped and returns false when there is no room.
            pub fn push(&mut self, item: $item) -> bool {
                match self.$items.get_mut(usize::from(self.count)) {
                    Some(slot) => {
                        *slot = item;
                        self.count += 1;
                        true
                    }
                    None => {
                        self.dropped = self.dropped.saturating_add(1);
                        false
                    }
                }
            }

            /// Adds an item; when there is no room the oldest goes for it. True if none had to.
            pub fn push_newest(&mut self, item: $item) -> bool {
                let full = usize::from(self.count) >= self.$items.len();
                if full {
                    self.$items.rotate_left(1);
                    self.count = self.count.saturating_sub(1);
                }
                self.push(item) && !full
            }

            /// Forgets the items, keeps the count of drops.
            pub fn clear(&mut self) {
                self.count = 0;
            }
        }
    };
}

pub(crate) use batch;
pub(crate) use message;
pub(crate) use wire_enum;
