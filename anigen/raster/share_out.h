#pragma once
#include <ATen/Parallel.h>

#include <algorithm>
#include <atomic>
#include <cstdint>

namespace anigen::raster {

/// Calls body(i) for i in [0, count) on all threads; each takes the next i when it is done with one, since some may
/// cost far more than others. Results must not depend on the order.
template <typename Body>
void share_out(std::int64_t count, const Body& body) {
  std::atomic<std::int64_t> next{0};
  const std::int64_t workers = std::min<std::int64_t>(at::get_num_threads(), count);
  at::parallel_for(0, workers, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t worker = begin; worker < end; ++worker) {
      for (std::int64_t i = next.fetch_add(1); i < count; i = next.fetch_add(1)) body(i);
    }
  });
}

}  // namespace anigen::raster
