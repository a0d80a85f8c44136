#include "anigen/io/rigs/skin_rows.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::io {

SkinRows::SkinRows(std::size_t vertices, std::size_t joints, std::string file)
    : file_(std::move(file)), joints_(joints), rows_(vertices) {}

void SkinRows::add(std::int64_t vertex, std::int64_t joint, float weight, const std::string& place) {
  if (vertex < 0 || static_cast<std::size_t>(vertex) >= rows_.size())
    throw InputError(file_, place, "weights vertex " + std::to_string(vertex) + " of " + std::to_string(rows_.size()));
  if (joint < 0 || static_cast<std::size_t>(joint) >= joints_)
    throw InputError(file_, place, "weights joint " + std::to_string(joint) + " of " + std::to_string(joints_));
  if (!std::isfinite(weight)) throw InputError(file_, place, "a weight is not finite");
  if (weight < 0.0f) ++negative_;
  if (weight > 0.0f) rows_[static_cast<std::size_t>(vertex)].push_back({static_cast<std::int32_t>(joint), weight});
}

SkinWeights SkinRows::finish(std::int32_t fallback, std::vector<std::string>& notes) {
  constexpr double kRounding = 0.01;
  SkinWeights skin;
  std::size_t rescaled = 0;
  for (std::vector<Influence>& row : rows_) {
    double sum = 0.0;
    for (const Influence& i : row) sum += i.weight;
    if (row.empty()) {
      ++unweighted_;
      row.push_back({fallback, 1.0f});
    } else {
      lowest_sum_ = std::min(lowest_sum_, sum);
      if (std::abs(sum - 1.0) > kRounding) ++rescaled;
    }
    skin.append_row(std::move(row));
  }
  rows_.clear();
  const auto tell = [&notes](std::size_t count, const std::string& what) {
    if (count > 0) notes.push_back(std::to_string(count) + what);
  };
  tell(unweighted_, " vertices without a weight are bound to joint " + std::to_string(fallback));
  tell(rescaled, " vertices' weights did not sum to 1 and were divided by their sum");
  tell(negative_, " negative weights were left out");
  return skin;
}

}  // namespace anigen::io
