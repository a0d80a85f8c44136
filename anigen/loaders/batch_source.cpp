#include "anigen/loaders/batch_source.h"

#include <algorithm>

namespace anigen::loaders {

std::vector<std::vector<Draw>> BatchSource::split(const std::vector<Draw>& draws, std::size_t parts) const {
  parts = std::max<std::size_t>(1, std::min(parts, draws.size()));
  std::vector<std::vector<Draw>> result;
  for (std::size_t part = 0; part < parts; ++part) {
    const auto begin = draws.begin() + static_cast<std::ptrdiff_t>(draws.size() * part / parts);
    const auto end = draws.begin() + static_cast<std::ptrdiff_t>(draws.size() * (part + 1) / parts);
    result.emplace_back(begin, end);
  }
  return result;
}

}  // namespace anigen::loaders
