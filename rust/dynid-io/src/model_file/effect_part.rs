//! One effect in `model.json`: its kind, its shape parameters by name, its coefficients. The catalogue says which names
//! belong to a kind, so a new kind needs no line here.

use std::fmt;

use dynid_core::effects::catalogue::find;
use dynid_core::{Effect, EffectTerm};
use serde::de::{self, MapAccess, Visitor};
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

const KIND: &str = "kind";
const COEFFICIENTS: &str = "coefficients";

/// As it stands in the file; every other key is a shape parameter with one value per joint.
pub struct EffectPart {
    kind: String,
    shape: Vec<(String, Vec<f64>)>,
    coefficients: Vec<Vec<f64>>,
}

impl EffectPart {
    /// What is written for `term`.
    pub fn from_term(term: &EffectTerm) -> Self {
        let effect = term.effect();
        Self {
            kind: effect.kind().to_owned(),
            shape: effect
                .shape_to_write()
                .into_iter()
                .map(|(name, values)| (name.to_owned(), values))
                .collect(),
            coefficients: term
                .coefficients()
                .chunks_exact(effect.n_columns())
                .map(<[f64]>::to_vec)
                .collect(),
        }
    }

    /// Kind of the effect, as the file says it.
    pub fn kind(&self) -> &str {
        &self.kind
    }

    /// A shape parameter of the file that versions before 6 did not have.
    pub fn since_version_6(&self) -> Option<&str> {
        let entry = find(&self.kind)?;
        let mut names = self.shape.iter().map(|(name, _)| name.as_str());
        names.find(|name| entry.where_absent(name).is_some())
    }

    /// The term, every name, length and number checked.
    pub fn into_term(self, n_joints: usize) -> Result<EffectTerm, String> {
        let effect = Effect::new(&self.kind, &self.shape).map_err(|e| e.to_string())?;
        let (kind, width) = (effect.kind(), effect.n_columns());
        let rows = self.coefficients;
        if rows.len() != n_joints || rows.iter().any(|row| row.len() != width) {
            return Err(format!(
                "{kind}: coefficients are not {n_joints} rows of {width}"
            ));
        }
        EffectTerm::new(effect, rows.concat(), n_joints).map_err(|e| format!("{kind}: {e}"))
    }
}

impl Serialize for EffectPart {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.shape.len() + 2))?;
        map.serialize_entry(KIND, &self.kind)?;
        for (name, values) in &self.shape {
            map.serialize_entry(name, values)?;
        }
        map.serialize_entry(COEFFICIENTS, &self.coefficients)?;
        map.end()
    }
}

impl<'de> Deserialize<'de> for EffectPart {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(Parts)
    }
}

struct Parts;

impl<'de> Visitor<'de> for Parts {
    type Value = EffectPart;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "an effect with kind, shape parameters and {COEFFICIENTS}"
        )
    }

    fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<EffectPart, M::Error> {
        let (mut kind, mut coefficients, mut shape) = (None, None, Vec::new());
        while let Some(name) = map.next_key::<String>()? {
            match name.as_str() {
                KIND if kind.is_some() => return Err(de::Error::duplicate_field(KIND)),
                KIND => kind = Some(map.next_value()?),
                COEFFICIENTS if coefficients.is_some() => {
                    return Err(de::Error::duplicate_field(COEFFICIENTS))
                }
                COEFFICIENTS => coefficients = Some(map.next_value()?),
                // A name that comes twice is one too many for its kind.
                _ => shape.push((name, map.next_value()?)),
            }
        }
        Ok(EffectPart {
            kind: kind.ok_or_else(|| de::Error::missing_field(KIND))?,
            shape,
            coefficients: coefficients.ok_or_else(|| de::Error::missing_field(COEFFICIENTS))?,
        })
    }
}
