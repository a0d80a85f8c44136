#pragma once
#include <cstdint>

namespace anigen::prepare {

/// Starts a new measurement of peak_memory_bytes(), where the kernel allows it; otherwise the peak is that of the
/// process since its start.
void reset_peak_memory();

/// Most memory that this process had in RAM, bytes (VmHWM); 0 when the kernel does not tell.
std::uint64_t peak_memory_bytes();

}  // namespace anigen::prepare
