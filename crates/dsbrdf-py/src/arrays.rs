//! NumPy arrays to slices, with errors that name the argument, and numbers to NumPy arrays: by Python's buffer protocol.

use pyo3::buffer::{Element, PyBuffer};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

/// An array of numbers of type `T`, as an argument.
pub struct Array<T> {
    buffer: PyBuffer<T>,
    shape: Vec<usize>,
}

impl<T: Element> FromPyObject<'_, '_> for Array<T> {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, '_, PyAny>) -> PyResult<Self> {
        let refuse =
            |why: String| PyTypeError::new_err(format!("an array of another kind is needed: {why}."));
        let buffer: PyBuffer<T> =
            PyBuffer::get(&object).map_err(|e| refuse(e.value(object.py()).to_string()))?;
        // pyo3 takes big-endian numbers for native ones
        if buffer.format().to_bytes().starts_with(b">") {
            return Err(refuse("the numbers are big-endian".to_string()));
        }
        let shape = buffer.shape().to_vec();
        Ok(Self { buffer, shape })
    }
}

impl<T: Element> Array<T> {
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    pub fn len(&self) -> usize {
        self.buffer.item_count()
    }
}

/// The elements of a C-contiguous array.
pub fn elements<'a, T: Element>(array: &'a Array<T>, name: &str) -> PyResult<&'a [T]> {
    let Some(found) = array.buffer.as_slice_ptr() else {
        // Nothing is contiguous, wherever it is
        if array.len() == 0 {
            return Ok(&[]);
        }
        let need = format!("'{name}' must be C-contiguous. Use numpy.ascontiguousarray.");
        return Err(PyValueError::new_err(need));
    };
    // SAFETY: the buffer keeps the memory, and whoever gives an array does not write to it meanwhile
    Ok(unsafe { found.as_ref() })
}

/// The elements of a C-contiguous array of the given shape.
pub fn shaped<'a, T: Element>(array: &'a Array<T>, shape: &[usize], name: &str) -> PyResult<&'a [T]> {
    if array.shape() != shape {
        let got = array.shape();
        return Err(PyValueError::new_err(format!("'{name}' must have shape {shape:?}, got {got:?}.")));
    }
    elements(array, name)
}

/// A number that arrays are made of.
pub trait Number: Element {
    const DTYPE: &str;
}

impl Number for f64 {
    const DTYPE: &str = "float64";
}

impl Number for u32 {
    const DTYPE: &str = "uint32";
}

/// A new array.
pub fn array<'py, T: Number, const N: usize>(
    py: Python<'py>,
    values: &[T],
    shape: [usize; N],
) -> PyResult<Bound<'py, PyAny>> {
    static EMPTY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let made = EMPTY.import(py, "numpy", "empty")?.call1((shape.to_vec(), T::DTYPE))?;
    PyBuffer::get(&made)?.copy_from_slice(py, values)?;
    Ok(made)
}

/// A new array of one axis.
pub fn vector<'py, T: Number>(py: Python<'py>, values: &[T]) -> PyResult<Bound<'py, PyAny>> {
    array(py, values, [values.len()])
}
