//! The mechanisms by name: coordinates, parameters, set-ups. RT: yes.

/// Which machine a rig is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MechanismKind {
    /// One link on a pivot.
    Pendulum,
    /// A mass on a rail.
    Slider,
    /// Two links, each driven at its joint.
    DoublePendulum,
    /// The walking robot.
    CompassGait,
}

/// How the compass gait was set up for a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Setup {
    /// Inner toe pinned, no impact.
    InnerStance,
    /// Outer toe pinned, no impact.
    OuterStance,
    /// Inner leg held at angle 0, the outer swings from the hip.
    InnerFixed,
    /// Outer leg held at angle 0, the inner swings from the hip.
    OuterFixed,
    /// Legs together.
    Parallel,
    /// Impacts and stance changes.
    Walk,
}

impl Setup {
    /// All of them.
    pub const ALL: &'static [Self] =
        &[Self::InnerStance, Self::OuterStance, Self::InnerFixed, Self::OuterFixed, Self::Parallel, Self::Walk];

    /// Its name in files.
    #[must_use]
    pub const fn id(self) -> &'static str {
        match self {
            Self::InnerStance => "inner_stance",
            Self::OuterStance => "outer_stance",
            Self::InnerFixed => "inner_fixed",
            Self::OuterFixed => "outer_fixed",
            Self::Parallel => "parallel",
            Self::Walk => "walk",
        }
    }

    /// The set-up with this name.
    #[must_use]
    pub fn from_id(id: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|s| s.id() == id)
    }
}

/// A parameter of a mechanism: name in files and smallest allowed value (exclusive if `positive`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParameterInfo {
    /// As in files; ends in its unit unless it is a pure number.
    pub name: &'static str,
    /// Zero and below make no sense.
    pub positive: bool,
}

const fn positive(name: &'static str) -> ParameterInfo {
    ParameterInfo { name, positive: true }
}
const fn any(name: &'static str) -> ParameterInfo {
    ParameterInfo { name, positive: false }
}

impl MechanismKind {
    /// All of them.
    pub const ALL: &'static [Self] = &[Self::Pendulum, Self::Slider, Self::DoublePendulum, Self::CompassGait];

    /// Its name in files.
    #[must_use]
    pub const fn id(self) -> &'static str {
        match self {
            Self::Pendulum => "pendulum",
            Self::Slider => "slider",
            Self::DoublePendulum => "double_pendulum",
            Self::CompassGait => "compass_gait",
        }
    }

    /// The mechanism with this name.
    #[must_use]
    pub fn from_id(id: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|m| m.id() == id)
    }

    /// Names of its coordinates, in order.
    #[must_use]
    pub const fn coordinates(self) -> &'static [&'static str] {
        match self {
            Self::Pendulum | Self::Slider => &["q1"],
            Self::DoublePendulum => &["q1", "q2"],
            Self::CompassGait => &["inner", "outer", "hip"],
        }
    }

    /// Unit of its coordinates.
    #[must_use]
    pub const fn coordinate_unit(self) -> &'static str {
        match self {
            Self::Slider => "m",
            Self::Pendulum | Self::DoublePendulum | Self::CompassGait => "rad",
        }
    }

    /// Which parameter is the inertia of link and rotor together, of one that has no other inertia.
    #[must_use]
    pub const fn whole_inertia(self) -> Option<usize> {
        match self {
            Self::Pendulum | Self::Slider => Some(0),
            Self::DoublePendulum | Self::CompassGait => None,
        }
    }

    /// Its parameters, in order.
    #[must_use]
    pub const fn parameters(self) -> &'static [ParameterInfo] {
        match self {
            Self::Pendulum => const { &[positive("inertia_kg_m2"), any("gravity_nm")] },
            Self::Slider => const { &[positive("mass_kg")] },
            Self::DoublePendulum => {
                const {
                    &[
                        positive("inertia1_kg_m2"),
                        positive("inertia2_kg_m2"),
                        any("moment1_kg_m"),
                        any("moment2_kg_m"),
                        positive("mass2_kg"),
                        positive("length1_m"),
                        any("gravity_m_s2"),
                    ]
                }
            }
            Self::CompassGait => {
                const {
                    &[
                        positive("leg_length_m"),
                        positive("total_mass_kg"),
                        any("gravity_m_s2"),
                        positive("c1"),
                        positive("c2"),
                        any("c3"),
                        any("c4"),
                        any("c5"),
                        any("c6"),
                    ]
                }
            }
        }
    }

    /// Index of coordinate `name`.
    #[must_use]
    pub fn coordinate_index(self, name: &str) -> Option<usize> {
        self.coordinates().iter().position(|c| *c == name)
    }

    /// Index of parameter `name`.
    #[must_use]
    pub fn parameter_index(self, name: &str) -> Option<usize> {
        self.parameters().iter().position(|p| p.name == name)
    }

    /// True if it stands on the ground.
    #[must_use]
    pub const fn has_ground(self) -> bool {
        matches!(self, Self::CompassGait)
    }
}
