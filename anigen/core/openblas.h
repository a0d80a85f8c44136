#pragma once
#include <string>

namespace anigen {

/// Name by which OpenBLAS knows the widest kernels for matrix products that this processor runs: SkylakeX, Zen or
/// Haswell; empty where it has none that need to be named. OpenBLAS goes by the model number: it takes a processor
/// newer than itself for one of 2004, and multiplies at a fifth of its speed (0.3.21 on a Xeon of 2023).
std::string openblas_core();

/// Name of the kernels that OpenBLAS chose as it was loaded; empty while none is loaded.
std::string loaded_openblas_core();

/// True if OpenBLAS is loaded and has chosen kernels narrower than openblas_core(), and $OPENBLAS_CORETYPE asks for no
/// others.
bool openblas_is_slow();

/// Has OpenBLAS use openblas_core() when it is loaded later, unless $OPENBLAS_CORETYPE says otherwise. Changes the
/// environment: not while other threads read it.
void name_openblas_core();

/// name_openblas_core() at the start of a program, which may have loaded OpenBLAS with its other libraries: where it is
/// slow, the program starts once more. Returns otherwise, and where it cannot start again. @param argv of main()
void start_with_openblas_core(char** argv);

/// Line for --version: the name in use.
std::string openblas_details();

}  // namespace anigen
