//! NumPy arrays to slices, with errors that name the argument.

use numpy::{Element, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::PyResult;
use pyo3::exceptions::PyValueError;

/// The elements of a C-contiguous array.
pub fn elements<'a, T: Element>(array: &'a PyReadonlyArrayDyn<'_, T>, name: &str) -> PyResult<&'a [T]> {
    array.as_slice().map_err(|_| {
        PyValueError::new_err(format!("'{name}' must be C-contiguous. Use numpy.ascontiguousarray."))
    })
}

/// The elements of a C-contiguous array of the given shape.
pub fn shaped<'a, T: Element>(
    array: &'a PyReadonlyArrayDyn<'_, T>,
    shape: &[usize],
    name: &str,
) -> PyResult<&'a [T]> {
    if array.shape() != shape {
        let got = array.shape();
        return Err(PyValueError::new_err(format!("'{name}' must have shape {shape:?}, got {got:?}.")));
    }
    elements(array, name)
}
