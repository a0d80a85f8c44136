#pragma once
#include <cstddef>
#include <functional>

namespace anigen {

/// Threads that parallel_for uses from now on; 0 means as default_thread_count() says (cores.h). Process-wide.
void set_thread_count(int threads);
int thread_count();

/// Calls body(i) for i in [0, n), in any order, on thread_count() threads; the first exception is rethrown after
/// the others finished. Results must not depend on the order: write to slot i only.
void parallel_for(std::size_t n, const std::function<void(std::size_t)>& body);

}  // namespace anigen
