//! Binding of `text`.

use dsbrdf_core::text::{self, Layout};
use pyo3::prelude::*;

use crate::arrays::array;

/// Numbers (line, used column) of a block of whole lines, None if they are not plain.
#[pyfunction]
pub fn plain_numbers<'py>(
    py: Python<'py>,
    block: &[u8],
    delimiter: Option<u8>,
    n_columns: usize,
    used: Vec<usize>,
    comma: bool,
) -> PyResult<Option<Bound<'py, PyAny>>> {
    let width = used.len();
    let layout = Layout { delimiter, n_columns, used: &used, comma };
    let Some(numbers) = py.detach(|| text::plain_numbers(block, &layout)) else {
        return Ok(None);
    };
    let n = numbers.len() / width.max(1);
    Ok(Some(array(py, &numbers, [n, width])?))
}
