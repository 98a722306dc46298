//! Lines of plain numbers, as most files of samples are; what is not plain is left to slower code.

/// How the lines of a table are read.
pub struct Layout<'a> {
    /// Byte between cells, or any number of blanks.
    pub delimiter: Option<u8>,
    pub n_columns: usize,
    /// Columns that are wanted, ascending; the others may hold any text.
    pub used: &'a [usize],
    /// Whether numbers have a decimal comma.
    pub comma: bool,
}

/// First bytes of lines that are comments.
const MARKS: &[u8] = b"#%!;*/";
/// Longer cells are no numbers.
const MAX_CELL: usize = 64;

/// Numbers (line, used column) of whole lines, an empty cell as NaN; None if a line is anything but cells of
/// numbers, so that whoever called must look closer.
pub fn plain_numbers(block: &[u8], layout: &Layout<'_>) -> Option<Vec<f64>> {
    let mut numbers = Vec::with_capacity(block.len() / 8);
    let mut rest = block.trim_ascii_end();
    while !rest.is_empty() {
        let end = rest.iter().position(|&byte| byte == b'\n' || byte == b'\r').unwrap_or(rest.len());
        let line = &rest[..end];
        rest = &rest[end..];
        rest = rest.strip_prefix(b"\r\n").or_else(|| rest.get(1..)).unwrap_or(&[]);
        let first = line.trim_ascii_start().first()?;
        if MARKS.contains(first) {
            return None;
        }
        match layout.delimiter {
            Some(mark) => row(line.split(|&byte| byte == mark), layout, &mut numbers)?,
            None => {
                let cells = line.split(|&byte| byte == b' ' || byte == b'\t');
                row(cells.filter(|cell| !cell.is_empty()), layout, &mut numbers)?
            }
        }
    }
    Some(numbers)
}

fn row<'a>(cells: impl Iterator<Item = &'a [u8]>, layout: &Layout<'_>, numbers: &mut Vec<f64>) -> Option<()> {
    let mut wanted = layout.used.iter().peekable();
    let mut count = 0;
    for (index, cell) in cells.enumerate() {
        count += 1;
        if wanted.next_if(|&&i| i == index).is_some() {
            numbers.push(number(unquoted(cell.trim_ascii()), layout.comma)?);
        } else if cell.iter().filter(|&&byte| byte == b'"').count() % 2 == 1 {
            // A delimiter in quotes
            return None;
        }
    }
    (count == layout.n_columns).then_some(())
}

/// A cell without the quotes about it, if it has both.
fn unquoted(cell: &[u8]) -> &[u8] {
    cell.strip_prefix(b"\"").and_then(|inner| inner.strip_suffix(b"\"")).unwrap_or(cell)
}

fn number(cell: &[u8], comma: bool) -> Option<f64> {
    if cell.is_empty() {
        return Some(f64::NAN);
    }
    if !comma {
        return std::str::from_utf8(cell).ok()?.parse().ok();
    }
    if cell.len() > MAX_CELL || cell.contains(&b'.') {
        return None;
    }
    let mut buffer = [0; MAX_CELL];
    let text = &mut buffer[..cell.len()];
    text.copy_from_slice(cell);
    for byte in text.iter_mut().filter(|byte| **byte == b',') {
        *byte = b'.';
    }
    std::str::from_utf8(text).ok()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, delimiter: Option<u8>, comma: bool) -> Option<Vec<f64>> {
        plain_numbers(text.as_bytes(), &Layout { delimiter, n_columns: 3, used: &[0, 2], comma })
    }

    #[test]
    fn any_line_end_and_delimiter() {
        for end in ["\n", "\r\n", "\r"] {
            let text = format!("1,x,2.5{end}-3, y ,4e-1{end}{end}");
            assert_eq!(read(&text, Some(b','), false), Some(vec![1.0, 2.5, -3.0, 0.4]));
        }
        assert_eq!(read(" 1  x\t2 \n3 y 4", None, false), Some(vec![1.0, 2.0, 3.0, 4.0]));
        assert_eq!(read("1,5;x;-2", Some(b';'), true), Some(vec![1.5, -2.0]));
        assert_eq!(read("\"1\",\"x\",\" 2.5\"", Some(b','), false), None);
        assert_eq!(read("\"1\",\"x\",\"2.5\"", Some(b','), false), Some(vec![1.0, 2.5]));
    }

    #[test]
    fn an_empty_cell_is_no_number() {
        let numbers = read("1,x,\n2,y,3\n", Some(b','), false).unwrap();
        assert!(numbers[1].is_nan());
        assert_eq!(numbers[2..], [2.0, 3.0]);
    }

    #[test]
    fn what_is_not_plain_is_refused() {
        for text in [
            "1,2",
            "1,2,3,4",
            "1,2,x",
            "1,2,3\n\n4,5,6",
            "#1,2,3",
            "1,\"2,3",
            "\"1,2\",3",
            "1_0,2,3",
            "1,2,3\n% 4,5,6",
        ] {
            assert_eq!(read(text, Some(b','), false), None, "{text}");
        }
        assert_eq!(read("1.5;2;3", Some(b';'), true), None);
        assert_eq!(read("1,5;2;3", Some(b';'), false), None);
    }
}
