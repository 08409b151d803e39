//! The address of a number inside a rig, and its name for people. RT: no.

use super::{Effect, Rig, Side, Value};

/// Which list of a rig a slot looks into.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Scope {
    /// Holds in all recordings.
    Rig,
    /// Only in the recording with this index.
    Recording(usize),
}

/// The address of one number of a rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Slot {
    /// Parameter of the mechanism: index into [`Rig::parameters`], or into a recording's list.
    Parameter(Scope, usize),
    /// Gain of an actuator.
    Gain(usize),
    /// Back-EMF of an actuator.
    BackEmf(usize),
    /// Key `1` of effect `0` of the scope.
    Effect(Scope, usize, usize),
}

impl Rig {
    /// All numbers of the rig: parameters, gains, effects, then those of single recordings.
    #[must_use]
    pub fn slots(&self) -> Vec<Slot> {
        let mut slots: Vec<Slot> = (0..self.parameters.len()).map(|i| Slot::Parameter(Scope::Rig, i)).collect();
        for (i, actuator) in self.actuators.iter().enumerate() {
            slots.push(Slot::Gain(i));
            if actuator.back_emf.is_some() {
                slots.push(Slot::BackEmf(i));
            }
        }
        push_effects(&mut slots, Scope::Rig, &self.effects);
        for (r, recording) in self.recordings.iter().enumerate() {
            slots.extend((0..recording.parameters.len()).map(|i| Slot::Parameter(Scope::Recording(r), i)));
            push_effects(&mut slots, Scope::Recording(r), &recording.effects);
        }
        slots
    }

    /// The number at `slot`; none if the rig has no such place.
    #[must_use]
    pub fn value(&self, slot: Slot) -> Option<&Value> {
        match slot {
            Slot::Parameter(Scope::Rig, i) => self.parameters.get(i),
            Slot::Parameter(Scope::Recording(r), i) => self.recordings.get(r)?.parameters.get(i).map(|(_, v)| v),
            Slot::Gain(i) => self.actuators.get(i).map(|a| &a.gain),
            Slot::BackEmf(i) => self.actuators.get(i)?.back_emf.as_ref(),
            Slot::Effect(scope, e, k) => self.effects_of(scope).get(e)?.values.get(k),
        }
    }

    /// The number at `slot`, to be changed.
    pub fn value_mut(&mut self, slot: Slot) -> Option<&mut Value> {
        match slot {
            Slot::Parameter(Scope::Rig, i) => self.parameters.get_mut(i),
            Slot::Parameter(Scope::Recording(r), i) => {
                self.recordings.get_mut(r)?.parameters.get_mut(i).map(|(_, v)| v)
            }
            Slot::Gain(i) => self.actuators.get_mut(i).map(|a| &mut a.gain),
            Slot::BackEmf(i) => self.actuators.get_mut(i)?.back_emf.as_mut(),
            Slot::Effect(Scope::Rig, e, k) => self.effects.get_mut(e)?.values.get_mut(k),
            Slot::Effect(Scope::Recording(r), e, k) => {
                self.recordings.get_mut(r)?.effects.get_mut(e)?.values.get_mut(k)
            }
        }
    }

    /// Effects of a scope.
    #[must_use]
    pub fn effects_of(&self, scope: Scope) -> &[Effect] {
        match scope {
            Scope::Rig => &self.effects,
            Scope::Recording(r) => self.recordings.get(r).map_or(&[], |entry| &entry.effects),
        }
    }

    /// Name of a slot for people and for `diagnosis.json`: `inertia_kg_m2`, `gain@u_v`, `viscous_friction@q1.viscous`,
    /// `sensor_bias@q_rad.bias[run.csv]`. Unique within a rig.
    #[must_use]
    pub fn slot_name(&self, slot: Slot) -> String {
        match slot {
            Slot::Parameter(scope, i) => format!("{}{}", self.parameter_name(scope, i), self.scope_suffix(scope)),
            Slot::Gain(i) => format!("gain@{}", self.actuators[i].column),
            Slot::BackEmf(i) => format!("back_emf@{}", self.actuators[i].column),
            Slot::Effect(scope, e, k) => self.effect_slot_name(scope, e, k),
        }
    }

    fn parameter_name(&self, scope: Scope, i: usize) -> &'static str {
        let index = match scope {
            Scope::Rig => i,
            Scope::Recording(r) => self.recordings[r].parameters[i].0,
        };
        self.mechanism.parameters()[index].name
    }

    fn scope_suffix(&self, scope: Scope) -> String {
        match scope {
            Scope::Rig => String::new(),
            Scope::Recording(r) => format!("[{}]", self.recordings[r].file),
        }
    }

    fn effect_slot_name(&self, scope: Scope, e: usize, k: usize) -> String {
        let effects = self.effects_of(scope);
        let effect = &effects[e];
        let side = if effect.side == Side::Motor { ":motor" } else { "" };
        let setup = effect.setup.map(|s| format!("({})", s.id())).unwrap_or_default();
        let only =
            if effect.recordings.is_empty() { String::new() } else { format!("[{}]", effect.recordings.join(",")) };
        // Several of one kind at one place (ripple orders): numbered from the second on.
        let same = |o: &&Effect| {
            o.kind == effect.kind
                && o.at == effect.at
                && o.side == effect.side
                && o.setup == effect.setup
                && o.recordings == effect.recordings
        };
        let before = effects[..e].iter().filter(same).count();
        let number = if before > 0 { format!("#{}", before + 1) } else { String::new() };
        let key = effect.kind.keys()[k].name;
        format!("{}@{}{side}{number}.{key}{setup}{only}{}", effect.kind, effect.at, self.scope_suffix(scope))
    }
}

fn push_effects(slots: &mut Vec<Slot>, scope: Scope, effects: &[Effect]) {
    for (e, effect) in effects.iter().enumerate() {
        slots.extend((0..effect.values.len()).map(|k| Slot::Effect(scope, e, k)));
    }
}
