#pragma once
#include <string>

namespace anigen::nn {

/// The BLAS that LibTorch's matrix products end up in.
struct Blas {
  std::string library;  ///< path of the shared library that defines sgemm_, "" when there is none
  std::string flavour;  ///< "openblas-openmp", "openblas-pthread", "openblas-serial", "reference", "mkl", "unknown"
  bool good() const { return flavour == "openblas-openmp" || flavour == "mkl"; }
};

Blas find_blas();

/// Says once at start when the BLAS is one that makes everything slow, and which package to install instead.
void warn_about_blas();

/// Lines for --version: LibTorch, BLAS, CUDA.
std::string version_details();

}  // namespace anigen::nn
