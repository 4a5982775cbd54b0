//! Structs of settings with a table of their entries: name, default, unit and a line of text of each stand in one place.
//!
//! The pages, headers and `--help` texts that list entries are made of these tables (`tests/tables`).

pub use serde::de::Error;
pub use serde::{Deserialize, Deserializer, Serialize};
pub use serde_json::{Map, Value, to_value};

/// An entry of settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// In the spelling of Rust and JSON, `distance_scale`.
    pub name: &'static str,
    /// What it means.
    pub text: &'static str,
    /// Empty: none.
    pub unit: &'static str,
    /// None: it is required.
    pub default: Option<Value>,
    /// What holds where the default says nothing of itself.
    pub shown: Option<&'static str>,
}

/// The entries of a struct of settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// How the dictionary is called that has them.
    pub name: &'static str,
    /// In the order in which they are documented.
    pub entries: Vec<Entry>,
}

impl Table {
    /// What this entry means, with its unit: the text of an option of a command line.
    ///
    /// # Panics
    /// Without such an entry.
    pub fn help(&self, name: &str) -> String {
        let found = self.entries.iter().find(|e| e.name == name);
        let entry = found.unwrap_or_else(|| panic!("{} has no entry {name}", self.name));
        let unit = if entry.unit.is_empty() { String::new() } else { format!(", {}", entry.unit) };
        format!("{}{unit}", entry.text.trim_end_matches('.').replace('`', ""))
    }
}

/// The entries that are given.
///
/// # Errors
/// For anything but a map.
pub fn read<'de, D: Deserializer<'de>>(from: D) -> Result<Map<String, Value>, D::Error> {
    Map::deserialize(from)
}

/// The entry `name`, taken out of those that are given.
///
/// # Errors
/// For a value of another type.
pub fn take<T: serde::de::DeserializeOwned, E: Error>(
    entries: &mut Map<String, Value>,
    name: &str,
) -> Result<Option<T>, E> {
    entries.remove(name).map(|value| T::deserialize(value).map_err(E::custom)).transpose()
}

/// Declares a struct of settings: `/// text`, `name: type [unit] = default, "what the default means";` for each entry. The unit, and the
/// meaning of a default that shows itself, may be left out. An entry without a default is required; a struct with none of these has
/// [`Default`]. Fields `beside` the entries are the program's own and begin with their type's default.
#[macro_export]
macro_rules! settings {
    (
        $(#[$about:meta])*
        $vis:vis struct $name:ident in $table:literal {
            $(
                $(#[doc = $text:literal])+ $(#[serde($($written:tt)*)])?
                $fvis:vis $field:ident: $type:ty $([$unit:ident])? $(= $default:expr $(, $shown:literal)?)?;
            )*
        }
        $(beside { $($(#[$what:meta])* $bvis:vis $beside:ident: $btype:ty;)* })?
    ) => {
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, $crate::settings::table::Serialize)]
        $vis struct $name {
            $($(#[doc = $text])+ $(#[serde($($written)*)])? $fvis $field: $type,)*
            $($($(#[$what])* #[serde(skip)] $bvis $beside: $btype,)*)?
        }

        impl $name {
            /// The entries, as they are documented.
            $vis fn table() -> $crate::settings::table::Table {
                let entries = vec![$($crate::settings::table::Entry {
                    name: stringify!($field),
                    text: concat!($($text),+).trim(),
                    unit: concat!("" $(, stringify!($unit))?),
                    default: $crate::settings!(@value $type $(, $default)?),
                    shown: $crate::settings!(@shown $($($shown)?)?),
                }),*];
                $crate::settings::table::Table { name: $table, entries }
            }
        }

        impl<'de> $crate::settings::table::Deserialize<'de> for $name {
            fn deserialize<D>(from: D) -> std::result::Result<Self, D::Error>
            where
                D: $crate::settings::table::Deserializer<'de>,
            {
                use $crate::settings::table::{Error as _, read, take};
                let mut entries = read(from)?;
                $(let $field: Option<$type> = take(&mut entries, stringify!($field))?;)*
                if let Some(name) = entries.keys().next() {
                    return Err(D::Error::unknown_field(name, &[$(stringify!($field)),*]));
                }
                Ok($name {
                    $($field: match $field {
                        Some(value) => value,
                        None => $crate::settings!(@or D, $field $(, $default)?),
                    },)*
                    $($($beside: Default::default(),)*)?
                })
            }
        }

        $crate::settings!(@default $name { $($field $(= $default)?;)* } $($($beside)*)?);
    };
    (@value $type:ty) => { None };
    (@value $type:ty, $default:expr) => {{
        let default: $type = $default;
        $crate::settings::table::to_value(default).ok()
    }};
    (@shown) => { None };
    (@shown $shown:literal) => { Some($shown) };
    (@or $error:ident, $field:ident) => { return Err($error::Error::missing_field(stringify!($field))) };
    (@or $error:ident, $field:ident, $default:expr) => { $default };
    (@default $name:ident { $($field:ident = $default:expr;)* } $($beside:ident)*) => {
        impl Default for $name {
            fn default() -> Self {
                $name { $($field: $default,)* $($beside: Default::default(),)* }
            }
        }
    };
    (@default $($required:tt)*) => {};
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    crate::settings! {
        /// Of a walk.
        struct Walk in "walk" {
            /// How far,
            /// there and back.
            length: f64 [m];
            /// With whom.
            company: Vec<String> = Vec::new(), "nobody";
            /// How fast.
            #[serde(skip_serializing_if = "Option::is_none")]
            pace: Option<usize> = Some(3);
        }
        beside {
            /// Its own.
            steps: usize;
        }
    }

    crate::settings! {
        /// Without a required entry.
        struct Rest in "rest" {
            /// How long.
            time: f64 [s] = 0.5;
        }
    }

    #[test]
    fn a_table_says_what_the_struct_does() {
        let entries = Walk::table().entries;
        assert_eq!((entries[0].text, entries[0].unit), ("How far, there and back.", "m"));
        assert_eq!((entries[0].default.clone(), entries[2].default.clone()), (None, Some(json!(3))));
        assert_eq!((entries[1].default.clone(), entries[1].shown), (Some(json!([])), Some("nobody")));
        assert_eq!(Walk::table().help("length"), "How far, there and back, m");
        assert_eq!(Rest::table().entries[0].default, Some(json!(Rest::default().time)));
    }

    #[test]
    fn what_is_given_is_read_and_what_is_required_is_missed() {
        let read = |entries: Value| Walk::deserialize(entries).map_err(|e| e.to_string());
        let walk = read(json!({"length": 2, "pace": null})).unwrap();
        assert_eq!(walk, Walk { length: 2.0, company: Vec::new(), pace: None, steps: 0 });
        assert_eq!(serde_json::to_value(walk).unwrap(), json!({"length": 2.0, "company": []}));
        assert_eq!(read(json!({"pace": 1})).unwrap_err(), "missing field `length`");
        let message = read(json!({"length": 2, "pase": 1})).unwrap_err();
        assert!(
            message.starts_with("unknown field `pase`, expected one of `length`, `company`, `pace`"),
            "{message}"
        );
        assert_eq!(read(json!([])).unwrap_err(), "invalid type: sequence, expected a map");
        assert!(read(json!({"length": "far"})).unwrap_err().contains("expected f64"));
    }
}
