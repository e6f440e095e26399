//! What images are called.

/// The most characters of a name.
const CHARACTERS_MAX: usize = 255;

/// The name of a file as it is kept: without the folders before it.
///
/// # Errors
/// What is wrong with it, in words for the client.
pub(in crate::http) fn checked(given: &str) -> Result<String, &'static str> {
    let name = given.rsplit(['/', '\\']).next().unwrap_or_default().trim();
    if matches!(name, "" | "." | "..") {
        return Err("it must end with the name of a file");
    }
    if name.chars().any(char::is_control) {
        return Err("it must have no control characters");
    }
    if name.chars().count() > CHARACTERS_MAX {
        return Err("it must have at most 255 characters");
    }
    Ok(name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_the_last_part_of_a_path_and_nothing_strange() {
        for (given, kept) in [
            ("IMG_0042.JPG", "IMG_0042.JPG"),
            ("flights/2024/a b.tif", "a b.tif"),
            ("C:\\scans\\Übersicht.tif", "Übersicht.tif"),
            ("../../etc/x", "x"),
            (" x.png ", "x.png"),
        ] {
            assert_eq!(checked(given).as_deref(), Ok(kept), "{given:?}");
        }
        for given in ["", " ", "/", "a/", "..", "a/.", "a\nb", "a\0", "\u{85}x\u{85}y"] {
            assert!(checked(given).is_err(), "{given:?}");
        }
        assert!(checked(&"ü".repeat(255)).is_ok());
        assert!(checked(&"ü".repeat(256)).is_err());
    }
}
