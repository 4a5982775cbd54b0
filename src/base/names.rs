//! Enums whose variants have names.

/// All variants of an enum in this order, and the name of each in files and texts: `names! { Split: Train "train", Test "test" }`.
#[macro_export]
macro_rules! names {
    ($kind:ident: $($variant:ident $name:literal),* $(,)?) => {
        impl $kind {
            /// All of them, in their order.
            pub const ALL: [$kind; [$($kind::$variant),*].len()] = [$($kind::$variant),*];

            /// Its name in files and texts.
            pub fn name(self) -> &'static str {
                match self {
                    $($kind::$variant => $name,)*
                }
            }
        }
    };
}
