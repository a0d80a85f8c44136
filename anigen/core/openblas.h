#pragma once
#include <string>

namespace anigen {

/// Name by which OpenBLAS knows the widest kernels for matrix products that this processor runs: SkylakeX, Zen or
/// Haswell; empty where it has none that need to be named. OpenBLAS goes by the model number: it takes a processor
/// newer than itself for one of 2004, and multiplies at a fifth of its speed (0.3.21 on a Xeon of 2023).
std::string openblas_core();

/// Has OpenBLAS use these kernels when it is loaded later, unless $OPENBLAS_CORETYPE says otherwise. Changes the
/// environment: not while other threads read it.
void name_openblas_core();

/// Line for --version: the name in use.
std::string openblas_details();

}  // namespace anigen
