// The extension module palpate._palpate; the package palpate (python/palpate) is what people import.

#include "owners.h"
#include "palpate/common/error.h"

namespace palpate::python {
namespace {

// What is wrong with input names file, key and cause; a failed run is an error of its own.
void bindErrors(py::module_& module) {
  static py::exception<RunError> run_error(module, "RunError", PyExc_RuntimeError);
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const InputError& e) {
      PyErr_SetString(PyExc_ValueError, e.what());
    } catch (const RunError& e) {
      run_error(e.what());
    } catch (const pybind11::cast_error& e) {
      PyErr_SetString(PyExc_TypeError, e.what());
    }
  });
}

}  // namespace
}  // namespace palpate::python

PYBIND11_MODULE(_palpate, module) {
  using namespace palpate::python;
  module.doc() = "Palpate's rooms for Python; import palpate instead.";
  bindErrors(module);
  bindValues(module);
  bindWorld(module);
  bindHaptics(module);
  bindRuns(module);
  module.attr("__version__") = PALPATE_VERSION;
}
