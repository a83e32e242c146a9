#include "base/error.hpp"

#include "python/bindings.hpp"

namespace atomcam {
namespace {

/// Kept for the life of the process; the translator below must not outlive it.
PyObject* error_type = nullptr;

}  // namespace

void bind_error(py::module_& module) {
  error_type = PyErr_NewExceptionWithDoc(
      "atomcam.Error",
      "Bad input: a file, key, value or argument. The text names the place, the value and "
      "what is allowed.\n\nAttributes\n----------\nplace : str\n    The file, key or "
      "argument.",
      PyExc_ValueError, nullptr);
  if (!error_type) throw py::error_already_set();
  module.attr("Error") = py::handle(error_type);
  py::register_exception_translator([](std::exception_ptr pointer) {
    try {
      if (pointer) std::rethrow_exception(pointer);
    } catch (const Error& error) {
      py::object instance = py::handle(error_type)(error.what());
      instance.attr("place") = error.place();
      PyErr_SetObject(error_type, instance.ptr());
    }
  });
}

}  // namespace atomcam
