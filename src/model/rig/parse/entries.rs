//! Effects and recordings of a rig file. RT: no.

use super::fields::{Fields, Reader};
use super::parameter_names;
use crate::model::effect::{EffectKind, SiteKind};
use crate::model::rig::{Effect, MechanismKind, RecordingEntry, Rig, Setup, Side, Use, Value};
use std::ops::Range;

impl Reader<'_> {
    fn setup(&mut self, fields: &mut Fields<'_>, mechanism: MechanismKind) -> Option<Setup> {
        let (id, span) = self.optional_string(fields, "setup")?;
        if !mechanism.has_ground() {
            self.complain(&span, "setup", "only the compass gait has set-ups");
            return None;
        }
        let setup = Setup::from_id(&id);
        if setup.is_none() {
            let known: Vec<&str> = Setup::ALL.iter().map(|s| s.id()).collect();
            self.complain(&span, "setup", format!("`{id}` is not one of {}", known.join(", ")));
        }
        setup
    }

    /// `scoped`: it may say in which set-up or recordings it acts.
    pub(super) fn effect(&mut self, mut fields: Fields<'_>, rig: &Rig, scoped: bool) -> Option<Effect> {
        let (id, id_span) = self.required_string(&mut fields, "effect")?;
        let Some(kind) = EffectKind::from_id(&id) else {
            let known: Vec<&str> = EffectKind::ALL.iter().map(|k| k.id()).collect();
            self.complain(&id_span, "effect", format!("`{id}` is not one of {}", known.join(", ")));
            return None;
        };
        let at = self.required_string(&mut fields, "at");
        if let Some((at, span)) = &at {
            self.place(rig, kind, at, span);
        }
        let values: Vec<Option<Value>> =
            kind.keys().iter().map(|key| self.required_value(&mut fields, key.name)).collect();
        let side = if kind.has_side() { self.side(&mut fields) } else { Side::Link };
        let setup = if scoped { self.setup(&mut fields, rig.mechanism) } else { None };
        let recordings = if scoped { self.names(&mut fields, "recordings") } else { Vec::new() };
        let keys: Vec<&str> = kind.keys().iter().map(|key| key.name).collect();
        self.finish(fields, &format!("effect, at, {}, side (friction), setup, recordings", keys.join(", ")));
        let values = values.into_iter().collect::<Option<Vec<Value>>>()?;
        for (key, value) in kind.keys().iter().zip(&values).filter(|(key, value)| !key.allows(value.value)) {
            let text = format!("{} is not within {} to {} {}", value.value, key.min, key.max, key.unit);
            self.complain(&id_span, key.name, text);
        }
        let effect = Effect { kind, at: at?.0, values, side, setup, recordings };
        self.lighter_than_the_whole(rig, &effect, &id_span);
        Some(effect)
    }

    /// The recordings that an effect names must be of this file, if it names any.
    pub(super) fn recordings_exist(&mut self, rig: &Rig, spans: &[Range<usize>]) {
        // What is wrong with a recording is told already.
        if rig.recordings.is_empty() || !self.errors.is_empty() {
            return;
        }
        let known: Vec<&str> = rig.recordings.iter().map(|entry| entry.file.as_str()).collect();
        for (effect, span) in rig.effects.iter().zip(spans) {
            for name in effect.recordings.iter().filter(|name| !known.contains(&name.as_str())) {
                self.complain(span, "recordings", format!("`{name}` is not one of {}", known.join(", ")));
            }
        }
    }

    /// A rotor is a part of the inertia of a pendulum or slider.
    fn lighter_than_the_whole(&mut self, rig: &Rig, effect: &Effect, span: &Range<usize>) {
        let Some((rotor, index)) = effect.get("rotor_inertia").zip(rig.mechanism.whole_inertia()) else { return };
        let Some(whole) = rig.parameters.get(index).filter(|whole| rotor.value >= whole.value) else { return };
        let (name, whole) = (rig.mechanism.parameters()[index].name, whole.value);
        let text = format!("{} must be below {name} = {whole}, which is rotor and link together", rotor.value);
        self.complain(span, "rotor_inertia", text);
    }

    fn place(&mut self, rig: &Rig, kind: EffectKind, at: &str, span: &Range<usize>) {
        if rig.site(kind, at).is_some() {
            return;
        }
        let what = match kind.site() {
            SiteKind::Joint => "a coordinate",
            SiteKind::Actuator => "the column of an actuator",
            SiteKind::Sensor => "the column of a sensor",
            SiteKind::Ground => "`ground`, of a mechanism that stands on it",
        };
        let places = rig.places(kind).join(", ");
        self.complain(span, "at", format!("`{at}`: {kind} stands at {what}; here: {places}"));
    }

    pub(super) fn recording(&mut self, mut fields: Fields<'_>, rig: &Rig) -> Option<RecordingEntry> {
        let span = fields.span.clone();
        let file = self.required_string(&mut fields, "file");
        let usage = self.usage(&mut fields);
        let window_s = self.window(&mut fields);
        let setup = self.setup(&mut fields, rig.mechanism);
        if rig.mechanism.has_ground() && setup.is_none() {
            self.complain(&span, "setup", "missing: a recording of the compass gait says how it was set up");
        }
        let stance_column = self.optional_string(&mut fields, "stance_column").map(|(c, _)| c);
        let toe_columns = self.toe_columns(&mut fields, setup);
        let window_column = self.optional_string(&mut fields, "window_column").map(|(c, _)| c);
        let parameters = self.overrides(&mut fields, rig.mechanism);
        let mut effects = Vec::new();
        for table in self.tables(&mut fields, "effects", "effects of a recording") {
            let effect = self.effect(table, rig, false);
            effects.extend(effect);
        }
        let known = "file, use, window_s, window_column, setup, stance_column, toe_columns, parameters, effects";
        self.finish(fields, known);
        Some(RecordingEntry {
            file: file?.0,
            usage: usage?,
            window_s,
            setup,
            stance_column,
            toe_columns,
            window_column,
            parameters,
            effects,
        })
    }

    /// Columns of both toes: only a robot that walks has its toes in the equations.
    fn toe_columns(&mut self, fields: &mut Fields<'_>, setup: Option<Setup>) -> Option<[String; 2]> {
        let span = fields.table.get("toe_columns")?.span();
        let names = self.names(fields, "toe_columns");
        if setup != Some(Setup::Walk) {
            self.complain(&span, "toe_columns", "are for `setup = \"walk\"` only");
            return None;
        }
        let columns: Result<[String; 2], _> = names.try_into();
        if columns.is_err() {
            self.complain(&span, "toe_columns", "must name two columns, of the inner and of the outer leg");
        }
        columns.ok()
    }

    fn usage(&mut self, fields: &mut Fields<'_>) -> Option<Use> {
        let (word, span) = self.required_string(fields, "use")?;
        match word.as_str() {
            "fit" => Some(Use::Fit),
            "heldout" => Some(Use::Heldout),
            _ => {
                self.complain(&span, "use", format!("`{word}` is neither \"fit\" nor \"heldout\""));
                None
            }
        }
    }

    fn window(&mut self, fields: &mut Fields<'_>) -> Option<f64> {
        let item = fields.take("window_s")?;
        let window_s = self.float("window_s", &item)?;
        if window_s <= 0.0 {
            self.complain(&item.span(), "window_s", format!("is {window_s}, must be above 0"));
            return None;
        }
        Some(window_s)
    }

    fn overrides(&mut self, fields: &mut Fields<'_>, mechanism: MechanismKind) -> Vec<(usize, Value)> {
        let Some(item) = fields.take("parameters") else { return Vec::new() };
        let Some(mut fields) = self.table(item, "parameters", "parameters of a recording") else { return Vec::new() };
        let mut out = Vec::new();
        for (i, info) in mechanism.parameters().iter().enumerate() {
            if let Some(item) = fields.take(info.name) {
                let span = item.span();
                if let Some(value) = self.value(info.name, item) {
                    self.positive(&span, info.name, info.positive, value);
                    out.push((i, value));
                }
            }
        }
        self.finish(fields, &parameter_names(mechanism));
        out
    }
}
