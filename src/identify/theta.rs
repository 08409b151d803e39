//! The uncertain numbers of a rig as one vector. RT: no.

use crate::model::rig::{Bounds, Rig, Slot};

/// One uncertain number.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// For people and files: `inertia_kg_m2`, `viscous_friction@q1.viscous`, `sensor_bias@q_rad.bias[run.csv]`.
    pub name: String,
    /// Where it stands in the rig.
    pub slot: Slot,
    /// Within which it may move.
    pub bounds: Bounds,
}

/// Which numbers of a rig are free, in a fixed order, and their values.
///
/// The order is that of [`Rig::slots`]: it does not change when effects are appended at the end of `rig.effects`
/// as long as no recording has free numbers of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct Theta {
    /// What each number is.
    pub entries: Vec<Entry>,
    /// The numbers.
    pub values: Vec<f64>,
}

impl Theta {
    /// All numbers of `rig` that have bounds.
    #[must_use]
    pub fn of(rig: &Rig) -> Self {
        Self::of_slots(rig, |_| true)
    }

    /// The numbers of `rig` that have bounds and that `wanted` keeps.
    #[must_use]
    pub fn of_slots(rig: &Rig, wanted: impl Fn(Slot) -> bool) -> Self {
        let mut theta = Self { entries: Vec::new(), values: Vec::new() };
        for slot in rig.slots().into_iter().filter(|s| wanted(*s)) {
            let Some((value, bounds)) = rig.value(slot).and_then(|v| v.bounds.map(|b| (v.value, b))) else { continue };
            theta.entries.push(Entry { name: rig.slot_name(slot), slot, bounds });
            theta.values.push(value);
        }
        theta
    }

    /// How many.
    #[must_use]
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// True if nothing is free.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Index of the entry called `name`.
    #[must_use]
    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.entries.iter().position(|e| e.name == name)
    }

    /// Index of the entry at `slot`.
    #[must_use]
    pub fn index_of_slot(&self, slot: Slot) -> Option<usize> {
        self.entries.iter().position(|e| e.slot == slot)
    }

    /// Writes the numbers into `rig`, which must be the one they came from or a copy of it.
    pub fn apply(&self, rig: &mut Rig) {
        for (entry, value) in self.entries.iter().zip(&self.values) {
            if let Some(slot) = rig.value_mut(entry.slot) {
                slot.value = *value;
            }
        }
    }

    /// `rig` with these numbers.
    #[must_use]
    pub fn applied(&self, rig: &Rig) -> Rig {
        let mut out = rig.clone();
        self.apply(&mut out);
        out
    }

    /// Moves every number into its bounds.
    pub fn clamp(&mut self) {
        for (entry, value) in self.entries.iter().zip(&mut self.values) {
            *value = value.clamp(entry.bounds.min, entry.bounds.max);
        }
    }
}
