//! Capital letters and digits of three by five dots: enough to tell control points apart in a picture.

/// Columns from one letter to the next.
const ADVANCE: i64 = 4;
const ROWS: u32 = 5;

/// The dots of a text as (column, row), from its top-left corner. Small letters are set as capitals; what there is
/// no letter for, as a question mark.
pub(super) fn dots(text: &str) -> impl Iterator<Item = (i64, i64)> + '_ {
    text.chars().zip(0..).flat_map(|(letter, place)| {
        let glyph = glyph(letter.to_ascii_uppercase());
        (0..ROWS).flat_map(move |row| {
            // five octal digits, a row each; the highest bit of a digit is the left dot
            let bits = glyph >> (3 * (ROWS - 1 - row)) & 0o7;
            (0..3)
                .filter(move |column| bits >> (2 - column) & 1 == 1)
                .map(move |column| (column + ADVANCE * place, i64::from(row)))
        })
    })
}

#[rustfmt::skip]
fn glyph(letter: char) -> u32 {
    match letter {
        'A' => 0o25755, 'B' => 0o65656, 'C' => 0o34443, 'D' => 0o65556, 'E' => 0o74647, 'F' => 0o74644, 'G' => 0o34553,
        'H' => 0o55755, 'I' => 0o72227, 'J' => 0o11152, 'K' => 0o55655, 'L' => 0o44447, 'M' => 0o57755, 'N' => 0o65555,
        'O' => 0o25552, 'P' => 0o65644, 'Q' => 0o25573, 'R' => 0o65655, 'S' => 0o34216, 'T' => 0o72222, 'U' => 0o55557,
        'V' => 0o55552, 'W' => 0o55775, 'X' => 0o55255, 'Y' => 0o55222, 'Z' => 0o71247,
        '0' => 0o75557, '1' => 0o26227, '2' => 0o71747, '3' => 0o71717, '4' => 0o55711, '5' => 0o74717, '6' => 0o74757,
        '7' => 0o71122, '8' => 0o75757, '9' => 0o75717,
        '-' => 0o00700, '_' => 0o00007, '.' => 0o00002, ':' => 0o02020, '/' => 0o11244, '+' => 0o02720, ' ' => 0,
        _ => 0o71202,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_letter_has_the_dots_of_its_shape() {
        let l: Vec<_> = dots("l").collect();
        assert_eq!(l, [(0, 0), (0, 1), (0, 2), (0, 3), (0, 4), (1, 4), (2, 4)]);
        assert_eq!(dots(" 1").next(), Some((5, 0)));
        assert_eq!(dots("ż").collect::<Vec<_>>(), dots("?").collect::<Vec<_>>());
    }

    #[test]
    fn no_two_letters_look_alike() {
        let letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZ123456789-_.:/+ ?";
        for a in letters.chars() {
            assert_eq!(letters.chars().filter(|b| glyph(*b) == glyph(a)).count(), 1, "{a}");
        }
    }
}
